"""Settings by name: presets of plugins, YAML files and registered components, with `key.path=value` overrides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from salframe.framework.component import ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.registry import OTHERWISE, check_preset, registry
from salframe.framework.config import merge, read_yaml
from salframe.framework.errors import ConfigError, UnknownName, unknown, unknown_key
from salframe.framework.overrides import Override
from salframe.framework.validation import validate

SUFFIXES = (".yaml", ".yml")
"""Suffixes that distinguish a YAML file of settings from the name of a preset or component."""

Pairs = Iterable[tuple[tuple[str, ...], Any]]
"""Settings as pairs (path, value). A path is a dotted key that `parse_override` has split at its dots."""


def preset_names(role: str) -> dict[str, str]:
    """Return the presets of a role, sorted: name -> package that provides the preset."""
    folder = registry().roles[role].presets
    return {} if folder is None else registry().list_presets(folder)


def names(role: str) -> list[str]:
    """Return the names of the presets and registered components of a role, sorted."""
    return sorted({*preset_names(role), *registry().names(role)})


def short_name(name: str) -> str:
    """Return the name used in tables: the name of a preset or component, or of a file without its suffix."""
    return Path(name).stem if name.endswith(SUFFIXES) else name


def settings(role: str, name: str) -> dict[str, Any]:
    """Return the settings in the YAML file or preset `name`. If `name` is a component, return only its `kind`.

    Raises:
        UnknownName: There is no such name. The message suggests the closest name.
        PluginFailed: A plugin that may provide the name failed to load.
        ConfigError: The file is invalid.
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
    """Return the preset to use if the preset `name` cannot run on this machine; None if it declares no such preset."""
    content = _preset(role, name)
    return None if content is None else content.get(OTHERWISE)


def _preset(role: str, name: str) -> dict[str, Any] | None:
    """Return the content of a YAML file or of a preset, or None if there is neither."""
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
    overrides: Sequence[Mapping[str, Any]] = (),
    choice: Choice | None = None,
) -> ComponentConfig:
    """Return the validated configuration of a component.

    Args:
        role: The role of the component.
        name: The preset, component or YAML file of the settings. It is the name of the component if `content` has no
            `kind`.
        content: The settings.
        overrides: Settings that replace those of `content`. For `Override`, see `validate`.
        choice: Chooses the components of slots (settings that hold a component) with the value `auto`. Without it,
            these slots keep the placeholder `Undecided`.

    Raises:
        ConfigError: A setting is invalid.
        InputMissing: No component can fill a slot with the value `auto`.
    """
    for override in overrides:
        content = merge(content, override)
    model = registry().get(role, content.get("kind", name)).Config
    return validate(model, content, f"{name}:" if name.endswith(SUFFIXES) else name, choice, overrides)


def configure_default(
    role: str, name: str, overrides: Sequence[Mapping[str, Any]] = (), choice: Choice | None = None
) -> ComponentConfig:
    """Return the validated configuration of a component, preset or YAML file: its settings, changed by `overrides`. See
    `configure`."""
    return configure(role, name, settings(role, name), overrides, choice)


def nest_for(pairs: Pairs, scopes: Sequence[str]) -> dict[str, list[Override]]:
    """Return settings as nested mappings, grouped by the first part of their dotted key, which becomes their scope.

    Raises:
        ConfigError: The first part of a key is not one of `scopes`, or the key has only one part.
    """
    by_scope: dict[str, list[Override]] = {scope: [] for scope in scopes}
    for path, value in pairs:
        if path[0] not in by_scope or len(path) < 2:
            expected = " or ".join(f"{scope}.KEY" for scope in scopes)
            raise ConfigError(
                f"received the setting {'.'.join(path)!r}, expected {expected}, where KEY is the name of a setting"
            )
        by_scope[path[0]].append(Override(path[1:], value, path[0]))
    return by_scope


class Overrides:
    """Settings by dotted key, assigned to scopes and methods.

    A key that starts with a scope (`data.…`, `engine.…`) is assigned to that scope, and `METHOD.…` to that method. Any
    other key is assigned to every method that has it.

    Attributes:
        scopes: For each scope the list of its settings as nested mappings.
        methods: For each method the list of its settings as nested mappings.
    """

    def __init__(
        self, pairs: Pairs, methods: Mapping[str, Mapping[str, Any]], *, role: str, scopes: Sequence[str]
    ) -> None:
        """Assign settings to scopes and methods.

        Args:
            pairs: The settings.
            methods: Mapping from names of methods to settings of components of `role`.
            role: The role of the methods.
            scopes: The names of the scopes.

        Raises:
            ConfigError: A key does not start with a scope or method, and no method has a setting of this name.
        """
        self.scopes: dict[str, list[Override]] = {scope: [] for scope in scopes}
        self.methods: dict[str, list[Override]] = {name: [] for name in methods}
        self._role = role
        for path, value in pairs:
            scope, rest = path[0], path[1:]
            if scope in self.scopes and rest:
                self.scopes[scope].append(Override(rest, value, scope))
            elif scope in methods and rest:
                self.methods[scope].append(Override(rest, value, scope))
            else:
                self._assign_to_all(path, value, methods)

    def _assign_to_all(self, path: tuple[str, ...], value: Any, methods: Mapping[str, Mapping[str, Any]]) -> None:
        keys = {name: self._keys(name, content) for name, content in methods.items()}
        receivers = [name for name in methods if path[0] in keys[name]]
        if not receivers:
            scopes = [f"{scope}.KEY" for scope in (*self.scopes, *methods)]
            known = sorted({*scopes, *(key for method_keys in keys.values() for key in method_keys)})
            raise ConfigError(unknown_key("setting", ".".join(path), known, part=path[0]))
        for name in receivers:
            self.methods[name].append(Override(path, value))

    def _keys(self, name: str, content: Mapping[str, Any]) -> list[str]:
        model = registry().get(self._role, content.get("kind", name)).Config
        return [key for key in model.model_fields if key != "kind"]
