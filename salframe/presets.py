"""Names and settings from the command line: presets in configs/, registered components, `key.path=value` overrides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from salframe.config import ComponentConfig, merge, nest, read_yaml, validate
from salframe.errors import ConfigError, UnknownName
from salframe.registry import registry, unknown

CONFIGS = Path(__file__).with_name("configs")
FOLDERS = {"localizer": "methods", "dataset": "data"}
WORDS = {"localizer": "method", "dataset": "dataset"}

OTHERWISE = "otherwise"
"""The key under which a preset names another one."""

MANIFEST = "manifest.json"
"""What makes a folder a dataset in the folder format."""


def preset_names(role: str) -> list[str]:
    """Names of the presets shipped for a role, sorted."""
    return sorted(path.stem for path in (CONFIGS / FOLDERS[role]).glob("*.yaml")) if role in FOLDERS else []


def names(role: str) -> list[str]:
    """Every name that `settings` takes for a role: presets and registered components, sorted."""
    return sorted({*preset_names(role), *registry().names(role)})


def settings(role: str, name: str) -> dict[str, Any]:
    """The settings a name stands for: those of a preset, or the bare component.

    Raises UnknownName with the closest name, PluginFailed where a broken plugin may hold it.
    """
    if name in preset_names(role):
        return {key: value for key, value in _preset(role, name).items() if key != OTHERWISE}
    try:
        registry().get(role, name)
    except UnknownName:
        raise UnknownName(unknown(WORDS.get(role, role), name, names(role), registry().failures)) from None
    return {"kind": name}


def _preset(role: str, name: str) -> dict[str, Any]:
    return read_yaml(CONFIGS / FOLDERS[role] / f"{name}.yaml")


def otherwise(role: str, name: str) -> str | None:
    """The preset that takes the place of one that cannot run here, where that one names it."""
    return _preset(role, name).get(OTHERWISE) if name in preset_names(role) else None


def configure(role: str, name: str, content: Mapping[str, Any], overrides: Iterable[Mapping[str, Any]] = ()) -> ComponentConfig:
    """The validated configuration of `content`, the settings that `name` stands for, with overrides laid on top. Raises ConfigError."""
    for override in overrides:
        content = merge(content, override)
    return validate(registry().get(role, content.get("kind", name)).Config, content, name)


def dataset_settings(data: str, data_dir: Path | None) -> tuple[str, dict[str, Any]]:
    """The dataset's short name and settings: `data` is a name, or a folder with a manifest.json; `data_dir` sets its `root`."""
    folder = Path(data)
    if (folder / MANIFEST).exists():
        name, content = folder.resolve().name, {**settings("dataset", "folder"), "root": str(folder.resolve())}
    elif data not in names("dataset") and (folder.is_dir() or "/" in data):
        raise UnknownName(f"{data} is no dataset: expected a folder with a {MANIFEST}, or one of {', '.join(names('dataset'))}")
    else:
        name, content = data, settings("dataset", data)
    if data_dir is not None:
        content = merge(content, {"root": str(data_dir.resolve())})
    return name, content


def nest_for(given: Iterable[tuple[tuple[str, ...], Any]], scopes: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """Settings given by dotted key as nested mappings, by the first word of the key. Raises ConfigError where that is none of `scopes`."""
    nested: dict[str, list[dict[str, Any]]] = {scope: [] for scope in scopes}
    for path, value in given:
        if path[0] not in nested or len(path) < 2:
            raise ConfigError(f"received the setting {'.'.join(path)}, expected {' or '.join(f'{scope}.KEY' for scope in scopes)}")
        nested[path[0]].append(nest(path[1:], value))
    return nested


class Overrides:
    """Settings given by dotted key, sorted by whom they are for: `data`, `engine`, and `methods` by name, each a list of nested mappings.

    `data.…` goes to the dataset, `engine.…` to the engine, `METHOD.…` to that method, anything else to every method that has such a key.
    """

    def __init__(self, given: Iterable[tuple[tuple[str, ...], Any]], methods: Mapping[str, Mapping[str, Any]]) -> None:
        """`given`: (path, value) as parse_override gives it; `methods`: the settings by name. Raises ConfigError on a key nobody has."""
        self.data: list[dict[str, Any]] = []
        self.engine: list[dict[str, Any]] = []
        self.methods: dict[str, list[dict[str, Any]]] = {name: [] for name in methods}
        for path, value in given:
            scope, rest = path[0], path[1:]
            if scope in ("data", "engine") and rest:
                (self.data if scope == "data" else self.engine).append(nest(rest, value))
            elif scope in methods and rest:
                self.methods[scope].append(nest(rest, value))
            else:
                self._give_all(path, value, methods)

    def _give_all(self, path: tuple[str, ...], value: Any, methods: Mapping[str, Mapping[str, Any]]) -> None:
        keys = {name: _keys(name, content) for name, content in methods.items()}
        takers = [name for name in methods if path[0] in keys[name]]
        if not takers:
            scopes = [f"{scope}.KEY" for scope in ("data", "engine", *methods)]
            known = sorted({*scopes, *(key for of_method in keys.values() for key in of_method)})
            raise ConfigError(f"received the setting {'.'.join(path)}: {unknown('key', path[0], known)}")
        for name in takers:
            self.methods[name].append(nest(path, value))


def _keys(name: str, content: Mapping[str, Any]) -> list[str]:
    return [key for key in registry().get("localizer", content.get("kind", name)).Config.model_fields if key != "kind"]
