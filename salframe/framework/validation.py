"""Models of settings, and their validation with one-line errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from salframe.framework.errors import ConfigError, SalframeError, describe_error, shorten

MAX_PROBLEMS = 3
"""Maximum number of validation errors to report; the others are counted."""


class Settings(BaseModel):
    """Base of every model of settings: frozen, no key that is not known, no number that is not finite. Units stand in
    the field names."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def validate(model: type[BaseModel], settings: Mapping[str, Any], where: str, choice: object = None) -> Any:
    """An instance of `model`, or a ConfigError that names the key, what was received and what was expected.

    `where` the settings stand: the dotted key that holds them, or a file's name and a colon; `choice`: the
    `Choice` that decides slots that say `auto`, which stay undecided without.
    """
    try:
        return model.model_validate(settings, context=choice)
    except ValidationError as error:
        raise ConfigError(describe_faults(error, where, model)) from None
    except OSError as error:  # of a path among the settings that no file system takes
        raise ConfigError(f"{where.rstrip(':')}: {describe_error(error)}") from None


def describe_faults(error: ValidationError, where: str, model: type[BaseModel] | None = None) -> str:
    """Describe validation errors in one line: the first MAX_PROBLEMS, and how many more there are."""
    problems = list(dict.fromkeys(_problem(model, problem, where) for problem in error.errors()))
    more = f"; and {len(problems) - MAX_PROBLEMS} more such faults" if len(problems) > MAX_PROBLEMS else ""
    return "; ".join(problems[:MAX_PROBLEMS]) + more


def _problem(model: type[BaseModel] | None, problem: Any, where: str) -> str:
    prefix = f"{where} " if where.endswith(":") else f"{where}."
    key = prefix + ".".join(map(str, problem["loc"])) if problem["loc"] else where.rstrip(":")
    if problem["type"] == "extra_forbidden":
        known = ", ".join(name for name in model.model_fields if name != "kind") if model else ""
        return f"unknown key {key}" + (f" (known: {known})" if known and len(problem["loc"]) == 1 else "")
    if problem["type"] == "missing":
        return f"{key} is missing"
    if isinstance(cause := problem.get("ctx", {}).get("error"), Exception):
        return str(cause) if isinstance(cause, SalframeError) else f"{key}: {cause}"
    return (
        f"{key}: received {shorten(repr(problem['input']))}, expected {problem['msg'].removeprefix('Input should be ')}"
    )
