"""Names and settings from outside: presets that plugins ship, YAML files, registered components, `key.path=value`
overrides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from salframe.framework.component import ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.registry import OTHERWISE, check_preset, registry
from salframe.framework.config import merge, nest, read_yaml
from salframe.framework.errors import ConfigError, UnknownName, unknown
from salframe.framework.validation import validate

SUFFIXES = (".yaml", ".yml")
"""A name that ends so is a file of settings."""

Pairs = Iterable[tuple[tuple[str, ...], Any]]
"""Settings given by dotted key, as `parse_override` reads them."""


def preset_names(role: str) -> dict[str, str]:
    """Name -> package of the presets shipped for a role, sorted."""
    folder = registry().roles[role].presets
    return {} if folder is None else registry().list_presets(folder)


def names(role: str) -> list[str]:
    """Every name that `settings` takes for a role: presets and registered components, sorted."""
    return sorted({*preset_names(role), *registry().names(role)})


def short_name(name: str) -> str:
    """What a preset, a component or a file of settings is called in tables: the file's name without its suffix."""
    return Path(name).stem if name.endswith(SUFFIXES) else name


def settings(role: str, name: str) -> dict[str, Any]:
    """The settings a name stands for: those of a YAML file, those of a preset, or the bare component.

    Raises UnknownName with the closest name, PluginFailed where a broken plugin may hold it, ConfigError on a bad file.
    """
    content = _preset(role, name)
    if content is not None:
        return {key: value for key, value in content.items() if key != OTHERWISE}
    try:
        registry().get(role, name)
    except UnknownName:
        word = registry().roles[role].word or role
        raise UnknownName(unknown(word, name, names(role), registry().failures)) from None
    return {"kind": name}


def otherwise(role: str, name: str) -> str | None:
    """The preset that takes the place of one that cannot run here, where that one names it."""
    content = _preset(role, name)
    return None if content is None else content.get(OTHERWISE)


def _preset(role: str, name: str) -> dict[str, Any] | None:
    """The content of a YAML file or of the preset of this name, None where there is neither."""
    if name.endswith(SUFFIXES):
        content = read_yaml(Path(name))
        check_preset(content, name, role)
        return content
    folder = registry().roles[role].presets
    path = None if folder is None else registry().find_preset(folder, name)
    return None if path is None else read_yaml(path)


def configure(
    role: str,
    name: str,
    content: Mapping[str, Any],
    overrides: Iterable[Mapping[str, Any]] = (),
    choice: Choice | None = None,
) -> ComponentConfig:
    """The validated configuration of `content`, the settings that `name` stands for, with overrides laid on top.

    `choice` decides slots that say `auto`, which stay undecided without. Raises ConfigError, and InputMissing where
    nothing that `auto` may become can run.
    """
    for override in overrides:
        content = merge(content, override)
    return validate(registry().get(role, content.get("kind", name)).Config, content, short_name(name), choice)


def configure_default(
    role: str, name: str, overrides: Iterable[Mapping[str, Any]] = (), choice: Choice | None = None
) -> ComponentConfig:
    """`configure` with the settings that `name` itself stands for."""
    return configure(role, name, settings(role, name), overrides, choice)


def nest_for(given: Pairs, scopes: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """Settings given by dotted key as nested mappings, by the first word of the key. Raises ConfigError on another."""
    nested: dict[str, list[dict[str, Any]]] = {scope: [] for scope in scopes}
    for path, value in given:
        if path[0] not in nested or len(path) < 2:
            expected = " or ".join(f"{scope}.KEY" for scope in scopes)
            raise ConfigError(f"received the setting {'.'.join(path)}, expected {expected}")
        nested[path[0]].append(nest(path[1:], value))
    return nested


class Overrides:
    """Settings given by dotted key, sorted by whom they are for, each a list of nested mappings.

    A key that begins with one of the `scopes` (`data.…`, `engine.…`) is for what that names, `METHOD.…` for that
    method, anything else for every method that has such a key.
    """

    def __init__(
        self, given: Pairs, methods: Mapping[str, Mapping[str, Any]], *, role: str, scopes: Sequence[str]
    ) -> None:
        """`methods`: settings of components of `role` by name. Raises ConfigError on a key nobody has."""
        self.scopes: dict[str, list[dict[str, Any]]] = {scope: [] for scope in scopes}
        self.methods: dict[str, list[dict[str, Any]]] = {name: [] for name in methods}
        self._role = role
        for path, value in given:
            scope, rest = path[0], path[1:]
            if scope in self.scopes and rest:
                self.scopes[scope].append(nest(rest, value))
            elif scope in methods and rest:
                self.methods[scope].append(nest(rest, value))
            else:
                self._give_all(path, value, methods)

    def _give_all(self, path: tuple[str, ...], value: Any, methods: Mapping[str, Mapping[str, Any]]) -> None:
        keys = {name: self._keys(name, content) for name, content in methods.items()}
        takers = [name for name in methods if path[0] in keys[name]]
        if not takers:
            scopes = [f"{scope}.KEY" for scope in (*self.scopes, *methods)]
            known = sorted({*scopes, *(key for of_method in keys.values() for key in of_method)})
            raise ConfigError(f"received the setting {'.'.join(path)}: {unknown('key', path[0], known)}")
        for name in takers:
            self.methods[name].append(nest(path, value))

    def _keys(self, name: str, content: Mapping[str, Any]) -> list[str]:
        model = registry().get(self._role, content.get("kind", name)).Config
        return [key for key in model.model_fields if key != "kind"]
