"""The rules of a component's identity: what it leaves out does not matter, and what it stands for changes it."""

from __future__ import annotations

import math
import tempfile
import types
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from salframe.framework.component import Component
from salframe.framework.config import ComponentConfig
from salframe.framework.identity import UserFile, digest, matters_to_matching_only
from salframe.testing.asking import attempt, expect, same


def check_identities(
    make: Callable[[], Any], known_by: Callable[[Any], Any], describe: Callable[[Any], Any], what: str
) -> None:
    """Another value of a `match_only` setting leaves the identity and the description of a panorama as they are;
    another content of a UserFile gives another identity.

    known_by(component): what its descriptions are kept under; describe(component): a description; `what` the former is
    called.
    """
    component = make()
    for name, field in type(component.config).model_fields.items():
        if matters_to_matching_only(field):
            other = another_config(component.config, name)
            if other is not None:
                _check_match_only(component, type(component)(other), known_by, describe, f"{what} with another {name}")
        elif UserFile in _alternatives(field.annotation):
            _check_file(component, name, known_by, what)


def _check_match_only(
    component: Component, other: Component, known_by: Callable[[Any], Any], describe: Callable[[Any], Any], checked: str
) -> None:
    before, after = (attempt(checked, lambda one: digest(known_by(one)), one) for one in (component, other))
    expect(before == after, checked, "another one", "the same: the setting is match_only")
    before, after = (attempt(checked, describe, one) for one in (component, other))
    expect(same(before, after), checked, "another description", "the same: the setting is match_only")


def _check_file(component: Component, name: str, known_by: Callable[[Any], Any], what: str) -> None:
    checked = f"{what} with another content of the file {name}"
    with tempfile.TemporaryDirectory() as folder:
        received = []
        for content in ("one", "another"):
            path = Path(folder, content)
            path.write_text(content)
            config = _with(component.config, name, UserFile(path))
            if config is None:
                return  # a setting that takes no such file
            try:
                made = type(component)(config)
            except Exception:
                return  # the suite cannot write a file of the component's own format
            received.append(attempt(checked, lambda one: digest(known_by(one)), made))
    expect(received[0] != received[1], checked, "the same one", "another one")


def another_config(config: ComponentConfig, name: str) -> ComponentConfig | None:
    """The configuration with another valid value of one setting, None where the suite knows none: it varies truth
    values, numbers, choices and whether there is a value at all."""
    value = getattr(config, name)
    for candidate in _candidates(type(config).model_fields[name].annotation, value):
        other = None if candidate == value else _with(config, name, candidate)
        if other is not None and getattr(other, name) != value:
            return other
    return None


def _with(config: ComponentConfig, name: str, value: Any) -> ComponentConfig | None:
    try:
        return type(config).model_validate({**dict(config), name: value})
    except ValidationError:
        return None


def _candidates(annotation: Any, value: Any) -> Iterator[Any]:
    """Values that a setting of this type may take; its bounds may refuse some."""
    for kind in _alternatives(annotation):
        if kind is bool:
            yield not value
        elif kind in (int, float):
            start = value if isinstance(value, int | float) and math.isfinite(value) else 1
            yield from (kind(number) for number in (start + 1, start - 1, 2 * start, start / 2))
        elif kind is types.NoneType:
            yield None
        elif typing.get_origin(kind) is typing.Literal:
            yield from typing.get_args(kind)


def _alternatives(annotation: Any) -> list[Any]:
    """The types that a value of this type may have, one by one."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _alternatives(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return [kind for argument in arguments for kind in _alternatives(argument)]
    return [annotation]
