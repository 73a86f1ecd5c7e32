"""Base class of settings, and validation with one-line errors."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from salframe.framework.errors import ConfigError, SalframeError, counted, one_line, shorten

MAX_PROBLEMS = 3
"""Maximum number of validation errors to report. Messages have only the number of further errors."""


MIN_POSITIVE, MAX_NUMBER, MAX_INTEGER = 1e-12, 1e12, 2**63 - 1
"""Limits of numbers in settings and files: the minimum of a number that must be positive, and the maximum magnitudes of
floats and of integers. Within these limits, squares and ratios are finite, and integers fit into int64."""
Seed = Annotated[int, Field(ge=0, le=MAX_INTEGER, strict=True)]
"""Seed of random numbers."""


class Settings(BaseModel):
    """Base class of all settings. Instances are frozen. Unknown keys and numbers of excessive magnitude are errors.

    Field names contain their units.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _check_size(cls, value: Any, info: ValidationInfo) -> Any:
        check_size(value)
        if isinstance(value, float) and 0 < value < MIN_POSITIVE:
            rules = cls.model_fields[str(info.field_name)].metadata
            if any(getattr(rule, "gt", None) == 0 for rule in rules):  # other code divides by such a number
                raise ValueError(f"received {value:g}, expected at least {MIN_POSITIVE:g}")
        return value


def check_size(value: Any, key: str = "") -> None:
    """Raise ValueError if the magnitude of a number exceeds its limit. Numbers in lists and mappings are also checked.

    `key` is the dotted key of the value, for the message.
    """
    where = f"{key}: " if key else ""
    if isinstance(value, float):
        if abs(value) > MAX_NUMBER:
            raise ValueError(f"{where}received {value:g}, expected a number from {-MAX_NUMBER:g} to {MAX_NUMBER:g}")
    elif isinstance(value, int):
        if abs(value) > MAX_INTEGER:
            raise ValueError(f"{where}received {shorten(str(value), 40)}, expected an integer of at most 63 bits")
    elif isinstance(value, Mapping | tuple | list):
        items = value.items() if isinstance(value, Mapping) else enumerate(value)
        for name, part in items:
            check_size(part, f"{key}.{name}" if key else str(name))


def validate(model: type[BaseModel], settings: Mapping[str, Any], where: str, choice: object = None) -> Any:
    """Return an instance of `model` with validated settings.

    Args:
        model: The model of the settings.
        settings: The settings.
        where: Location of the settings for messages: the dotted key that holds them, or a file name and a colon.
        choice: The `Choice` that selects the components of slots (settings that hold a component) with the value
            `auto`. Without it, these slots keep the placeholder `Undecided`.

    Raises:
        ConfigError: A setting is invalid. The message names the key, the received value and the expected value.
    """
    try:
        return model.model_validate(settings, context=choice)
    except ValidationError as error:
        raise ConfigError(describe_faults(error, where, model)) from None
    except OSError as error:  # a path among the settings is invalid for the file system
        reason = f"{error.strerror or one_line(error)}: {shorten(str(error.filename))}"
        raise ConfigError(f"{where.rstrip(':')}: {reason}, expected the path of a file or folder") from None


_EXPECTED = {
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "an integer"),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    **dict.fromkeys(("list_type", "tuple_type", "set_type", "frozen_set_type"), "a list"),
    **dict.fromkeys(("dict_type", "mapping_type", "model_type", "model_attributes_type"), "a dictionary"),
    "string_type": "a string",
    "path_type": "a path",
}
"""Expected value by type of error, in words that hold for YAML, JSON and Python."""
_NOUNS = {
    "too_short": "item",
    "too_long": "item",
    "string_too_short": "character",
    "string_too_long": "character",
    "bytes_too_short": "byte",
    "bytes_too_long": "byte",
}
"""Name of the counted items, by the type of an error about a length."""
_TYPE_TAG = re.compile(r"[a-z-]+\[.*\]|constrained-\w+|str|int|float|bool")
"""Parts that pydantic adds to the location of an error in a value that may have several types."""
_COMPARISONS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal", "multiple_of")
"""Types of errors whose message compares with a number."""


def describe_faults(error: ValidationError, where: str, model: type[BaseModel] | None = None) -> str:
    """Describe validation errors in one line: the first MAX_PROBLEMS errors, and the number of the others."""
    problems: dict[str, list[str]] = {}  # a value that may have several types has one error for each type
    for fault in error.errors():
        if not _follows_from_items(fault):
            received, expected = _problem(model, fault, where)
            problems.setdefault(received, []).extend([expected] if expected else [])
    lines = [
        f"{received}, expected {' or '.join(dict.fromkeys(expected))}" if expected else received
        for received, expected in problems.items()
    ]
    rest = len(lines) - MAX_PROBLEMS
    more = f"; and {rest} more {'error' if rest == 1 else 'errors'}" if rest > 0 else ""
    return "; ".join(lines[:MAX_PROBLEMS]) + more


def _follows_from_items(problem: Any) -> bool:
    """Return whether a list counts as too short because only its valid items were counted."""
    received = problem["input"]
    return (
        problem["type"] == "too_short"
        and hasattr(received, "__len__")
        and len(received) >= problem["ctx"]["min_length"]
    )


def _problem(model: type[BaseModel] | None, problem: Any, where: str) -> tuple[str, str]:
    """Return a validation error as two texts: the key and the received value, and the expected value or ""."""
    file, key = _place([str(part) for part in problem["loc"] if not _TYPE_TAG.fullmatch(str(part))], where)
    noun = "key" if file else "setting"
    prefix = f"{file}: " if file else ""
    if problem["type"] == "extra_forbidden":
        *above, name = map(str, problem["loc"])
        fields = [field for field in _fields_below(model, above) if field != "kind"]
        close = difflib.get_close_matches(name, fields, 1)
        hint = f", did you mean {close[0]!r}" if close else ""
        known = f" (known {noun}s: {', '.join(fields)})" if fields else ""
        return f"{prefix}unknown {noun} {key}{hint}{known}", ""
    if problem["type"] == "missing":
        return f"{prefix}the required {noun} {key} is missing", ""
    start = f"{prefix}{noun} {key}" if key else file
    if isinstance(cause := problem.get("ctx", {}).get("error"), Exception):
        return str(cause) if isinstance(cause, SalframeError) else f"{start}: {cause}", ""
    return f"{start}: received {shorten(repr(problem['input']))}{_count(problem)}", _expected(problem)


def _place(keys: Sequence[str], where: str) -> tuple[str, str]:
    """Return the file of a setting, "" for none, and the dotted key of the setting. For `where`, see `validate`."""
    file, _, above = (where[:-1], "", "") if where.endswith(":") else where.rpartition(": ")
    return file, ".".join([above, *keys] if above else keys)


def _count(problem: Any) -> str:
    """Return the number of received items in words if the error is about this number, else ""."""
    wrong = problem["type"] in ("too_short", "too_long")
    return f" ({counted(problem['ctx']['actual_length'], 'item')})" if wrong else ""


def _expected(problem: Any) -> str:
    """Return the value that was expected, as a noun phrase."""
    kind, limits = problem["type"], problem.get("ctx", {})
    if kind.endswith("too_short"):
        return f"at least {counted(limits['min_length'], _NOUNS[kind])}"
    if kind.endswith("too_long"):
        return f"at most {counted(limits['max_length'], _NOUNS[kind])}"
    if kind == "string_pattern_mismatch":
        return f"a string that matches {limits['pattern']}"
    text = str(problem["msg"]).removeprefix("Input should be ").replace("an instance of Path", "a path")
    return f"a number {text}" if kind in _COMPARISONS else _EXPECTED.get(kind, text)


def _fields_below(model: type[BaseModel] | None, keys: Sequence[str]) -> list[str]:
    """Return the names of the fields of the model at nested keys; an empty list if it is not known."""
    for key in keys:
        field = model.model_fields.get(key) if model else None
        parts = [] if field is None else [field.annotation, *get_args(field.annotation)]
        models = [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]
        model = models[0] if len(models) == 1 else model if key.isdecimal() else None
    return list(model.model_fields) if model else []
