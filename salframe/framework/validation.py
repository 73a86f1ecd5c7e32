"""Base class of settings, and validation with one-line errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from salframe.framework.errors import ConfigError, SalframeError, describe_error, shorten

MAX_PROBLEMS = 3
"""Maximum number of validation errors to report; the others are counted."""


class Settings(BaseModel):
    """Base class of all settings: frozen, without unknown keys, and with finite numbers only.

    Field names contain their units.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def validate(model: type[BaseModel], settings: Mapping[str, Any], where: str, choice: object = None) -> Any:
    """Return an instance of `model` with validated settings.

    Args:
        model: The model of the settings.
        settings: The settings.
        where: Location of the settings for messages: the dotted key that holds them, or a file name and a colon.
        choice: The `Choice` that fills the slots with `auto`. Without it, these slots remain undecided.

    Raises:
        ConfigError: A setting is invalid. The message names the key, the received value and the expected value.
    """
    try:
        return model.model_validate(settings, context=choice)
    except ValidationError as error:
        raise ConfigError(describe_faults(error, where, model)) from None
    except OSError as error:  # a path among the settings is invalid for the file system
        raise ConfigError(f"{where.rstrip(':')}: {describe_error(error)}") from None


def describe_faults(error: ValidationError, where: str, model: type[BaseModel] | None = None) -> str:
    """Describe validation errors in one line: the first MAX_PROBLEMS, and how many more there are."""
    problems = list(dict.fromkeys(_problem(model, problem, where) for problem in error.errors()))
    more = f"; and {len(problems) - MAX_PROBLEMS} more errors" if len(problems) > MAX_PROBLEMS else ""
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
