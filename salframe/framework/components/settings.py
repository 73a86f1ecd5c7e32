"""Listing of a configuration: every setting with its value, default, type and help."""

from __future__ import annotations

import enum
import json
import re
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from salframe.framework.component import ROLE, ComponentConfig, holds_components
from salframe.framework.files.bounded import parse_yaml

BOUNDS = {"ge": "at least", "gt": "over", "le": "at most", "lt": "under"}


@dataclass(frozen=True)
class Setting:
    """One setting of a configuration.

    A slot is a setting that holds a component. Its value and default are names of components. Its type is the role, or
    "ROLE | null" for an optional slot. Listings show the settings of the component after the slot. If a setting holds
    several components, listings show their settings under `key[0]`, `key[1]` and so on. `--set` does not accept these
    keys: replace the whole list instead.

    Attributes:
        key: The dotted key for `--set`.
        value: The value, as in YAML.
        default: The default.
        type: The type and bounds, in words.
        help: The description of the setting.
    """

    key: str
    value: Any
    default: Any
    type: str
    help: str


def list_settings(config: BaseModel, prefix: str = "") -> Iterator[Setting]:
    """Yield the settings of a configuration, and of the models and components in it. `prefix` starts each key."""
    plain = config.model_dump(mode="json")
    defaults = type(config).model_construct().model_dump(mode="json", warnings=False)
    for name, field in type(config).model_fields.items():
        if name == "kind":
            continue
        key, value, help = prefix + name, getattr(config, name), field.description or ""
        if isinstance(value, ComponentConfig):
            yield Setting(key, value.kind, _kind(defaults[name]), _slot_type(field, value.component.role), help)
        elif holds_components(value):
            kinds, default_kinds = [item.kind for item in value], [item["kind"] for item in defaults[name]]
            yield Setting(key, kinds, default_kinds, f"{value[0].component.role}, ...", help)
            for number, item in enumerate(value):
                yield from list_settings(item, f"{key}[{number}].")
        elif keys := _keys_of(config, name):
            default, kind = defaults.get(name) or {}, _spell(typing.get_args(field.annotation)[1])
            for inner, help in keys.items():
                yield Setting(f"{key}.{inner}", plain[name][inner], default.get(inner), kind, help)
        elif not isinstance(value, BaseModel):
            yield Setting(key, plain[name], _kind(defaults.get(name)), _type(field), help)
        if isinstance(value, BaseModel):
            yield from list_settings(value, f"{key}.")


def spell_value(value: Any) -> str:
    """Return the value of a setting as text: a string unchanged, a list of names as [a, b], any other value as JSON."""
    if isinstance(value, list | tuple) and all(map(_is_name, value)):
        return f"[{', '.join(value)}]"
    return value if isinstance(value, str) else json.dumps(value)


def _is_name(value: Any) -> bool:
    """Return whether a value is text that YAML reads as the same text without quotes."""
    return isinstance(value, str) and bool(re.fullmatch(r"[\w.-]+", value)) and bool(parse_yaml(value) == value)


def shorten_value(value: Any, max_length: int = 60) -> str:
    """Return the value of a setting in at most `max_length` characters. A path is reduced to its last part."""
    text = Path(value).name if isinstance(value, str) and "/" in value else spell_value(value)
    return text if len(text) <= max_length else f"{text[: max_length - 1]}…"


def flatten(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings by dotted key."""
    flat: dict[str, Any] = {}
    for key, value in settings.items():
        if isinstance(value, Mapping) and value:
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


def changed_settings(
    config: BaseModel, reference: BaseModel | None = None, prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield the settings that differ from those of a reference, by dotted key.

    If a slot holds another component than the reference, the name of the component is the value. The settings of this
    component are compared with its defaults, because the reference has no values for them.

    Args:
        config: The configuration.
        reference: The configuration to compare with. None for the defaults.
        prefix: Start of the keys.
    """
    values = config.model_dump(mode="json")
    base = reference if type(reference) is type(config) else type(config).model_construct()
    base_values = base.model_dump(mode="json", warnings=False)
    for name in type(config).model_fields:
        value, key = getattr(config, name), prefix + name
        if isinstance(value, ComponentConfig):
            if value.kind != _kind(base_values.get(name)):
                yield key, value.kind
            yield from changed_settings(value, getattr(base, name, None), f"{key}.")
        elif holds_components(value):
            before = getattr(base, name, ()) or ()
            kinds = [item.kind for item in value]
            if kinds != [_kind(item) for item in base_values.get(name) or ()]:
                yield key, kinds
            for number, item in enumerate(value):
                yield from changed_settings(item, before[number] if number < len(before) else None, f"{key}[{number}].")
        elif name != "kind":
            new, old = flatten({key: values[name]}), flatten({key: base_values.get(name)})
            if old.keys() <= new.keys() or _keys_of(config, name):
                yield from ((inner, one) for inner, one in new.items() if inner not in old or old[inner] != one)
            else:
                yield key, values[name]


def _keys_of(config: BaseModel, name: str) -> Mapping[str, str]:
    return config.keys_of(name) if isinstance(config, ComponentConfig) else {}


def _kind(default: Any) -> Any:
    """Return the default of a setting. The default of a slot is returned as the name of its component."""
    return default["kind"] if isinstance(default, Mapping) and "kind" in default else default


def _slot_type(field: FieldInfo, role: Any) -> str:
    return f"{role} | null" if type(None) in typing.get_args(field.annotation) else role


def _type(field: FieldInfo) -> str:
    if isinstance(field.json_schema_extra, Mapping) and (role := field.json_schema_extra.get(ROLE)):
        return _slot_type(field, role)
    bounds = [
        f"{words} {getattr(rule, bound):g}"
        for rule in field.metadata
        for bound, words in BOUNDS.items()
        if hasattr(rule, bound)
    ]
    return ", ".join([_spell(field.annotation), *bounds])


def _spell(annotation: Any) -> str:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Literal:
        return " | ".join(map(str, arguments))
    if origin in (typing.Union, types.UnionType):
        return " | ".join("null" if argument is type(None) else _spell(argument) for argument in arguments)
    if origin is typing.Annotated:
        return _spell(arguments[0])
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        return " | ".join(str(member.value) for member in annotation)
    if isinstance(annotation, type) and issubclass(annotation, Path):
        return "path"
    if origin is not None:
        inside = ", ".join("..." if argument is Ellipsis else _spell(argument) for argument in arguments)
        return f"{_spell(origin)}[{inside}]"
    return getattr(annotation, "__name__", str(annotation))
