"""A configuration as rows to read: every setting with its value, default, type and help."""

from __future__ import annotations

import json
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from salframe.framework.component import ROLE, ComponentConfig, holds_components

BOUNDS = {"ge": "at least", "gt": "over", "le": "at most", "lt": "under"}


@dataclass(frozen=True)
class Setting:
    """One setting: its dotted key as `--set` takes it, its value, its default, its type, and its help.

    Of a slot, value and default are names of components and the type is their role ("ROLE | null" of an empty one); the
    settings of the component in it come next. Where a field holds several components their settings follow too, under
    `key[0]` and so on, which are set in the list.
    """

    key: str
    value: Any
    default: Any
    type: str
    help: str


def list_settings(config: BaseModel, prefix: str = "") -> Iterator[Setting]:
    """The settings of a configuration and of what is nested in it. Values are as in YAML."""
    plain = config.model_dump(mode="json")
    defaults = type(config).model_construct().model_dump(mode="json", warnings=False)
    for name, field in type(config).model_fields.items():
        if name == "kind":
            continue
        key, value, help = prefix + name, getattr(config, name), field.description or ""
        if isinstance(value, ComponentConfig):
            yield Setting(key, value.kind, _kind(defaults[name]), _slot_type(field, value.component.role), help)
        elif holds_components(value):
            chosen = [one.kind for one in value]
            yield Setting(key, chosen, [one["kind"] for one in defaults[name]], f"{value[0].component.role}, ...", help)
            for number, one in enumerate(value):
                yield from list_settings(one, f"{key}[{number}].")
        elif not isinstance(value, BaseModel):
            yield Setting(key, plain[name], _kind(defaults.get(name)), _type(field), help)
        if isinstance(value, BaseModel):
            yield from list_settings(value, f"{key}.")


def spell_value(value: Any) -> str:
    """A value of a setting in words: strings as they are, otherwise JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def _kind(default: Any) -> Any:
    """A default, of a slot the name of its component."""
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
    if origin is not None:
        inside = ", ".join("..." if argument is Ellipsis else _spell(argument) for argument in arguments)
        return f"{_spell(origin)}[{inside}]"
    return getattr(annotation, "__name__", str(annotation))
