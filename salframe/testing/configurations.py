"""Random configurations of a component, for rules that must hold with every valid setting."""

from __future__ import annotations

import types
import typing
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from salframe.framework.component import ROLE, Component, ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import changed_settings, shorten_value
from salframe.framework.errors import SalframeError
from salframe.framework.validation import validate
from salframe.testing.rooms import PARTS

CHANGED_SHARE = 0.3
"""Probability of each setting to be changed. The others keep their value."""
MAX_FACTOR = 2.0
"""A number is drawn between its value divided and multiplied by this factor."""
MAX_DRAWS = 20
"""Maximum number of configurations to draw until the component can be created with one of them."""


def random_config(config: ComponentConfig, seed: int) -> ComponentConfig:
    """Return a configuration with random valid settings, with which the component can be created.

    The draw changes booleans, choices, optional values, and numbers (to values near the original). A setting whose
    value is another component gets a component that needs no weights. The new component is part of salframe, or of
    the package that defines the component of `config`. Files and texts do not change. The draw of a setting depends
    on the seed, its key and its value only.

    Args:
        config: The configuration to start from. It is returned if no draw is usable.
        seed: Seed of the draw.
    """
    packages = {"salframe", *(package for component, package in registry() if component is config.component)}
    for attempt in range(MAX_DRAWS):
        try:
            drawn = on_rooms(_drawn(config, "", (seed, attempt), packages))
            if drawn != config:
                drawn.component(drawn)
                return drawn
        except SalframeError:
            continue
    return config


def differences(config: ComponentConfig, other: ComponentConfig) -> str:
    """Return the settings of `other` that differ from those of `config`, as "key=value" separated by commas."""
    return ", ".join(f"{key}={shorten_value(value)}" for key, value in changed_settings(other, config))


def on_rooms(config: ComponentConfig) -> ComponentConfig:
    """Return the configuration rebuilt from its JSON. Settings with the value `auto` are replaced by the components
    that `auto` selects for the rooms of the test suite, whose panoramas have colour, range and annotations."""
    choice = Choice("the suite's rooms", lambda: PARTS)
    rebuilt: ComponentConfig = validate(type(config), config.model_dump(mode="json"), config.kind, choice)
    return rebuilt


def with_setting(config: Any, name: str, value: Any) -> Any:
    """Return a copy of a config whose setting `name` has another value; None if the value is invalid."""
    try:
        return type(config).model_validate({**dict(config), name: value})
    except (ValidationError, SalframeError):
        return None


def alternatives(annotation: Any) -> list[Any]:
    """Return the types in a union, or the type itself."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return alternatives(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return [kind for argument in arguments for kind in alternatives(argument)]
    return [annotation]


def _drawn(model: Any, prefix: str, seed: tuple[int, ...], packages: set[str]) -> Any:
    """Return the model with random values of some settings, also in nested models and components."""
    for name, field in type(model).model_fields.items():
        if name == "kind":
            continue
        key = f"{prefix}{name}"
        rng = np.random.default_rng((*seed, zlib.crc32(key.encode())))
        value = getattr(model, name)
        if rng.random() < CHANGED_SHARE:
            options = _components(field, packages) or list(_values(field, value, rng))
            value = options[int(rng.integers(len(options)))] if options else value
        changed = with_setting(model, name, value) or model
        value = getattr(changed, name)
        if isinstance(value, BaseModel):
            changed = with_setting(changed, name, _drawn(value, f"{key}.", seed, packages)) or changed
        model = changed
    return model


def _components(field: FieldInfo, packages: set[str]) -> list[str | None]:
    """Return the names of the components that can fill a slot, and None if it may be empty; [] if it is no slot."""
    extra = field.json_schema_extra
    if not isinstance(extra, dict) or ROLE not in extra:
        return []
    usable: list[str | None] = [
        component.name
        for component, package in registry()
        if component.role == extra[ROLE] and package in packages and _is_usable(component)
    ]
    return [*usable, *([None] if types.NoneType in alternatives(field.annotation) else [])]


def _is_usable(component: type[Component]) -> bool:
    try:
        component.check(component.Config())
    except SalframeError:
        return False
    return not component.weights


def _values(field: FieldInfo, value: Any, rng: np.random.Generator) -> Iterator[Any]:
    """Yield a value of each type that a setting may have. Its bounds may reject some of them."""
    factor = MAX_FACTOR ** rng.uniform(-1, 1)
    for kind in alternatives(field.annotation):
        start = value if isinstance(value, int | float) and value else 1
        if kind is bool:
            yield not value
        elif kind is float:
            yield _rounded(start * factor)
        elif kind is int:
            yield round(start * factor)
        elif kind is types.NoneType:
            yield None
        elif typing.get_origin(kind) is typing.Literal:
            yield rng.choice(typing.get_args(kind)).item()
        elif typing.get_origin(kind) is tuple and isinstance(value, tuple) and value and _are_floats(value):
            yield tuple(_rounded(number * factor) for number in value)


def _are_floats(values: tuple[Any, ...]) -> bool:
    return all(isinstance(value, float) for value in values)


def _rounded(number: float) -> float:
    """Return the number with three significant digits, so that a message states the drawn value."""
    return float(f"{number:.3g}")
