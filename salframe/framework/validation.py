"""Base class of settings, and validation with one-line errors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from salframe.framework.errors import ConfigError, SalframeError, counted, one_line, shorten, unknown_key
from salframe.framework.overrides import Override

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


def validate(
    model: type[BaseModel],
    settings: Mapping[str, Any],
    where: str,
    choice: object = None,
    overrides: Sequence[Mapping[str, Any]] = (),
) -> Any:
    """Return an instance of `model` with validated settings.

    Args:
        model: The model of the settings.
        settings: The settings.
        where: Location of the settings for messages: the dotted key that holds them, or a file name and a colon.
        choice: The `Choice` that selects the components of slots (settings that hold a component) with the value
            `auto`. Without it, these slots keep the placeholder `Undecided`.
        overrides: Mappings that were merged into the settings. For each `Override` among them, messages show the key
            that the user wrote, instead of `where` and the key.

    Raises:
        ConfigError: A setting is invalid. The message names the key, the received value and the expected value.
    """
    try:
        return model.model_validate(settings, context=choice)
    except ValidationError as error:
        raise ConfigError(describe_faults(error, where, model, overrides)) from None
    except OSError as error:
        raise ConfigError(f"{where.rstrip(':')}: {_path_fault(error)}".removeprefix(": ")) from None


class InvalidComponent(ValueError):
    """Settings of a component in a slot (a setting that holds a component) are invalid.

    Attributes:
        error: The errors of the settings.
        model: The model of the settings.
        keys: The keys of the component below the slot: its number in a list of components, otherwise none.
        note: A remark on the choice of the component, or "".
    """

    def __init__(
        self, error: ValidationError, model: type[BaseModel], keys: tuple[str, ...] = (), note: str = ""
    ) -> None:
        super().__init__(describe_faults(error, "", model))
        self.error, self.model, self.keys, self.note = error, model, keys, note


def validate_component(
    model: type[BaseModel], settings: Mapping[str, Any], choice: object, keys: tuple[str, ...] = (), note: str = ""
) -> Any:
    """Validate the settings of a component in a slot, inside the validation of the settings with the slot.

    Args:
        model: The model of the settings.
        settings: The settings.
        choice: As in `validate`.
        keys: See InvalidComponent.
        note: See InvalidComponent.

    Raises:
        ValueError: A setting is invalid. `validate` reports it with the key of the slot.
    """
    try:
        return model.model_validate(settings, context=choice)
    except ValidationError as error:
        raise InvalidComponent(error, model, keys, note) from None
    except OSError as error:
        raise ValueError(_path_fault(error)) from None


def _path_fault(error: OSError) -> str:
    """Describe the error of a path among the settings that is invalid for the file system."""
    reason = f"{error.strerror or one_line(error)}: {shorten(str(error.filename))}"
    return f"{reason}, expected the path of a file or folder"


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


def describe_faults(
    error: ValidationError,
    where: str,
    model: type[BaseModel] | None = None,
    overrides: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Describe validation errors in one line: the first MAX_PROBLEMS errors, and the number of the others.

    For the arguments, see `validate`.
    """
    notes: dict[str, None] = {}
    faults = list(_list_faults(error, model, notes))
    inside = {union for location, _ in faults for union in location.unions}
    problems: dict[str, list[str]] = {}  # a value that may have several types has one error for each type
    for location, fault in faults:
        if location.mismatch not in inside:
            received, expected = _problem(location, fault, where, overrides)
            problems.setdefault(received, []).extend([expected] if expected else [])
    lines = [
        f"{received}, expected {' or '.join(dict.fromkeys(expected))}" if expected else received
        for received, expected in problems.items()
    ]
    rest = len(lines) - MAX_PROBLEMS
    more = f"; and {rest} more {'error' if rest == 1 else 'errors'}" if rest > 0 else ""
    return "; ".join(lines[:MAX_PROBLEMS]) + more + "".join(f" ({note})" for note in notes)


class _Location(NamedTuple):
    """Location of a validation error.

    Attributes:
        keys: Nested keys of the value.
        model: Model of the settings beside the last key; None if it is not known.
        unions: The keys of each value that may have several types, and that has one of them, because the error is
            inside the value.
        mismatch: The keys of a value that may have several types, if it has none of them or not the one that the error
            is about.
    """

    keys: tuple[str, ...]
    model: type[BaseModel] | None
    unions: frozenset[tuple[str, ...]]
    mismatch: tuple[str, ...] | None

    def below(self, keys: tuple[str, ...]) -> _Location:
        """Return the location with more keys before its own."""
        unions = frozenset((*keys, *union) for union in self.unions)
        return _Location(
            (*keys, *self.keys), self.model, unions, None if self.mismatch is None else (*keys, *self.mismatch)
        )


def _list_faults(
    error: ValidationError, model: type[BaseModel] | None, notes: dict[str, None]
) -> Iterator[tuple[_Location, Any]]:
    """Yield validation errors with their locations, also those of components in slots, and add their notes."""
    for fault in error.errors():
        location, cause = _walk(model, fault["loc"]), fault.get("ctx", {}).get("error")
        if isinstance(cause, InvalidComponent):
            notes |= {cause.note: None} if cause.note else {}
            for inner, inner_fault in _list_faults(cause.error, cause.model, notes):
                yield inner.below((*location.keys, *cause.keys)), inner_fault
        elif not _follows_from_items(fault):
            yield location, fault


def _walk(model: type[BaseModel] | None, loc: Sequence[int | str]) -> _Location:
    """Return a location in a model, without the names of types that pydantic adds."""
    types: list[Any] = [model] if model else []
    beside: type[BaseModel] | None = None
    keys: list[str] = []
    tagged: list[tuple[str, ...]] = []
    for part in loc:
        models = [one for one in types if isinstance(one, type) and issubclass(one, BaseModel)]
        alike = [one for one in models if one.__name__ == part and len(types) > 1]
        if alike or _TYPE_TAG.fullmatch(str(part)):
            types = alike or types
            tagged.append(tuple(keys))
            continue
        beside = models[0] if len(models) == 1 else None
        types = [inner for one in types for inner in _types_below(one, part)]
        keys.append(str(part))
    here = tuple(keys)
    return _Location(here, beside, frozenset(tagged) - {here}, here if here in tagged else None)


def _types_below(kind: Any, key: int | str) -> list[Any]:
    """Return the types that a value may have at a key of a model, mapping or list; an empty list if unknown."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        field = kind.model_fields.get(str(key))
        return [] if field is None else _alternatives(field.annotation)
    origin, parts = get_origin(kind), get_args(kind)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _alternatives(parts[1])
    return [one for part in parts for one in _alternatives(part)] if origin in (list, tuple) else []


def _alternatives(kind: Any) -> list[Any]:
    """Return the types of a union, or the type alone."""
    if get_origin(kind) is Annotated:
        return _alternatives(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return [one for part in get_args(kind) for one in _alternatives(part) if one is not type(None)]
    return [kind]


def _follows_from_items(problem: Any) -> bool:
    """Return whether a list counts as too short because only its valid items were counted."""
    received = problem["input"]
    return (
        problem["type"] == "too_short"
        and hasattr(received, "__len__")
        and len(received) >= problem["ctx"]["min_length"]
    )


def _problem(location: _Location, problem: Any, where: str, overrides: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Return a validation error as two texts: the key and the received value, and the expected value or ""."""
    file, key = _place(location.keys, where, overrides)
    noun = "key" if file else "setting"
    prefix = f"{file}: " if file else ""
    if problem["type"] == "extra_forbidden":
        model = location.model
        names = None if model is None else [name for name in model.model_fields if name != "kind"]
        component = getattr(model, "component", None)
        owner = component.name if component else key.rpartition(".")[0]
        return prefix + unknown_key(noun, key, names, owner=owner), ""
    if problem["type"] == "missing":
        return f"{prefix}the required {noun} {key} is missing", ""
    start = f"{prefix}{noun} {key}" if key else file
    if isinstance(cause := problem.get("ctx", {}).get("error"), Exception):
        return str(cause) if isinstance(cause, SalframeError) else f"{start}: {cause}".removeprefix(": "), ""
    return f"{start}: received {shorten(repr(problem['input']))}{_count(problem)}", _expected(problem)


def _place(keys: tuple[str, ...], where: str, overrides: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Return the file of a setting, "" for none, and the dotted key of the setting. For the arguments, see
    `validate`."""
    for override in reversed(overrides):
        if isinstance(override, Override) and (key := override.spell(keys)):
            return "", key
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
