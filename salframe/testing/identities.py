"""Rules of a component's identity: settings that affect its output change the identity, all others do not."""

from __future__ import annotations

import math
import tempfile
import types
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePath
from typing import Any

from pydantic import BaseModel

from salframe.framework.component import Component, ComponentConfig, holds_components
from salframe.framework.components.identity import UserFile, identity, matters_to_matching_only
from salframe.framework.files.hashes import digest
from salframe.testing.configurations import alternatives, with_setting
from salframe.testing.expectations import attempt, expect, same


def check_files(config: ComponentConfig) -> None:
    """Check that the identity depends on the content of a UserFile and not on its name, and that no setting is a Path.

    The content of a plain Path is not part of the identity. Data sets may have one, because they have a fingerprint.
    The component is not created, because it may reject a file that the suite writes.
    """
    component = config.component
    plain = [] if component.role == "dataset" else list(_plain_paths(component.Config))
    expect(
        not plain, f"setting {', '.join(plain)}", "a plain Path", "a UserFile, whose content is part of the identity"
    )
    for file in _user_files(config):
        checks: list[tuple[str, bool]] = [("identity", False)]
        checks += [] if file.match_only else [("identity for describing", True)]
        for what, describing in checks:
            _check_file(lambda changed: changed, partial(identity, describing=describing), file, what)


def check_identities(
    make: Callable[[], Any], cache_key: Callable[[Any], Any], describe: Callable[[Any], Any], what: str
) -> None:
    """Check that the cache key ignores `match_only` settings (which affect only matching) and depends on the content of
    user files.

    A `match_only` setting must not change the description of a panorama either.

    Args:
        make: Creates the component.
        cache_key: Returns the key under which the descriptions of a component are cached.
        describe: Returns a description by a component.
        what: Name of the cache key in messages.
    """
    component = make()
    for name, field in type(component.config).model_fields.items():
        if matters_to_matching_only(field):
            other = another_config(component.config, name)
            if other is not None:
                _check_match_only(component, type(component)(other), cache_key, describe, f"{what} with another {name}")
    for file in _user_files(component.config):
        if not file.match_only:
            _check_file(type(component), cache_key, file, what)


def _check_match_only(
    component: Component,
    other: Component,
    cache_key: Callable[[Any], Any],
    describe: Callable[[Any], Any],
    checked: str,
) -> None:
    before, after = (attempt(checked, lambda made: digest(cache_key(made)), made) for made in (component, other))
    expect(before == after, checked, "another value", "the same value: the setting is match_only")
    before, after = (attempt(checked, describe, made) for made in (component, other))
    expect(same(before, after), checked, "another description", "the same description: the setting is match_only")


@dataclass(frozen=True)
class _FileSetting:
    """A setting that takes a UserFile.

    Attributes:
        key: Dotted key of the setting.
        match_only: Whether the setting affects matching only.
        put: Returns the model with another file in this setting, None if the model rejects the file.
    """

    key: str
    match_only: bool
    put: Callable[[UserFile], Any]


def _user_files(model: BaseModel) -> Iterator[_FileSetting]:
    """Yield the settings that take a UserFile, of a model, its nested models and the components in its slots."""

    def inside(name: str, wrap: Callable[[UserFile], Any]) -> Callable[[UserFile], Any]:
        def put(file: UserFile) -> Any:
            value = wrap(file)
            return None if value is None else with_setting(model, name, value)

        return put

    for name, field in type(model).model_fields.items():
        value, match_only = getattr(model, name), matters_to_matching_only(field)
        if isinstance(value, BaseModel):
            for inner in _user_files(value):
                yield _FileSetting(f"{name}.{inner.key}", match_only or inner.match_only, inside(name, inner.put))
            continue
        if holds_components(value):
            for number, config in enumerate(value):
                for inner in _user_files(config):
                    put = inside(name, partial(_put_at, value, number, inner.put))
                    yield _FileSetting(f"{name}[{number}].{inner.key}", match_only or inner.match_only, put)
            continue
        for kind in alternatives(field.annotation):
            parts = typing.get_args(kind) if typing.get_origin(kind) in (tuple, list) else ()
            if _is_user_file(kind):
                yield _FileSetting(name, match_only, inside(name, lambda file: file))
            elif any(_is_user_file(kind) for part in parts for kind in alternatives(part)):
                count = 1 if typing.get_origin(kind) is list or Ellipsis in parts else len(parts)
                yield _FileSetting(name, match_only, inside(name, partial(_repeat, count)))


def _is_user_file(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, UserFile)


def _put_at(
    configs: tuple[ComponentConfig, ...], number: int, put: Callable[[UserFile], Any], file: UserFile
) -> tuple[ComponentConfig, ...] | None:
    """Return the configurations with the file set in configuration `number`. None if it rejects the file."""
    changed = put(file)
    return None if changed is None else (*configs[:number], changed, *configs[number + 1 :])


def _repeat(count: int, file: UserFile) -> tuple[UserFile, ...]:
    return (file,) * count


def _plain_paths(model: type[BaseModel], parents: tuple[type[BaseModel], ...] = ()) -> Iterator[str]:
    """Yield the settings of a model and its nested models whose type allows a Path that is no UserFile."""
    for name, field in model.model_fields.items():
        for kind in _types_in(field.annotation):
            if issubclass(kind, PurePath) and not issubclass(kind, UserFile):
                yield name
            elif issubclass(kind, BaseModel) and not issubclass(kind, ComponentConfig) and kind not in parents:
                yield from (f"{name}.{key}" for key in _plain_paths(kind, (*parents, model)))


def _types_in(annotation: Any) -> Iterator[type]:
    """Yield every class that an annotation mentions."""
    arguments = typing.get_args(annotation)
    if typing.get_origin(annotation) is typing.Annotated:
        arguments = arguments[:1]
    if arguments and typing.get_origin(annotation) is not typing.Literal:
        for argument in arguments:
            yield from _types_in(argument)
    elif isinstance(annotation, type):
        yield annotation


def _check_file(
    make: Callable[[ComponentConfig], Any], cache_key: Callable[[Any], Any], setting: _FileSetting, what: str
) -> None:
    """Check that the cache key depends on the content of a file, and not on its name.

    Do nothing if the setting rejects such a file or the component cannot be created with it.
    """
    checked = f"{what} with another content of the file {setting.key}"
    with tempfile.TemporaryDirectory() as folder:
        received = []
        for name, content in (("file", "one"), ("file", "another"), ("copy", "another")):
            path = Path(folder, name)
            path.write_text(content, encoding="utf-8")
            config = setting.put(UserFile(path))
            if config is None:
                return
            try:
                made = make(config)
            except Exception:
                return  # the suite cannot write a file of the component's own format
            received.append(attempt(checked, lambda component: digest(cache_key(component)), made))
    first, other, copy = received
    expect(other != first, checked, "the same value", "another value")
    expect(copy == other, f"{what} with another name of the file {setting.key}", "another value", "the same value")


def another_config(config: ComponentConfig, name: str) -> ComponentConfig | None:
    """Return the configuration with another valid value of one setting, None if the suite has no candidate.

    The suite varies booleans, numbers, choices and optional values.
    """
    value = getattr(config, name)
    for candidate in _candidates(type(config).model_fields[name].annotation, value):
        other = None if candidate == value else with_setting(config, name, candidate)
        if other is not None and getattr(other, name) != value:
            return other
    return None


def _candidates(annotation: Any, value: Any) -> Iterator[Any]:
    """Yield candidate values for a setting of this type. Its bounds may reject some of them."""
    for kind in alternatives(annotation):
        if kind is bool:
            yield not value
        elif kind in (int, float):
            start = value if isinstance(value, int | float) and math.isfinite(value) else 1
            yield from (kind(number) for number in (start + 1, start - 1, 2 * start, start / 2))
        elif kind is types.NoneType:
            yield None
        elif typing.get_origin(kind) is typing.Literal:
            yield from typing.get_args(kind)
