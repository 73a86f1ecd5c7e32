"""Registry of roles, components and presets. It loads plugins, catches their errors, and checks what they register."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, cast

import pluggy
from pydantic import BaseModel
from pydantic_core import PydanticSerializationError

from salframe.framework import hookspecs
from salframe.framework.component import Component, ComponentConfig, Role, is_role
from salframe.framework.components.defaults import AUTO, auto_order
from salframe.framework.components.entry_points import COMMANDS, GROUP, discover
from salframe.framework.config import read_yaml
from salframe.framework.errors import (
    ConfigError,
    PluginFailed,
    SalframeError,
    UnknownName,
    describe_error,
    unknown,
    with_article,
)
from salframe.framework.files.weights import NetworkWeights
from salframe.framework.hookspecs import Presets

BUILTIN = "salframe.builtin"
"""Module of the built-in plugin of salframe, which is always loaded."""
KEBAB = r"[a-z0-9]+(-[a-z0-9]+)*"
"""Pattern of the names of components and commands."""
FOLDERS = ("methods", "data", "ablations")
"""Folders of presets that come first in listings."""
OTHERWISE = "otherwise"
"""Key in a preset. Its value is the name of the preset to use if this preset cannot run."""


@dataclass(frozen=True)
class Failure:
    """A plugin or preset that failed to load.

    Attributes:
        plugin: The name of the entry point of the plugin, or FOLDER/NAME.yaml of the preset.
        package: The package that declares it.
        reason: The exception in one line.
    """

    plugin: str
    package: str
    reason: str

    def __str__(self) -> str:
        return f"{self.plugin} ({self.reason})"


class Registry:
    """The roles, components and presets of all loaded plugins.

    Attributes:
        roles: The roles by name.
        failures: The plugins and presets that failed to load.
    """

    def __init__(self) -> None:
        self.roles: dict[str, type[Role]] = {}
        self.failures: list[Failure] = []
        self._presets: dict[tuple[str, str], tuple[Path, str]] = {}
        self._components: dict[tuple[str, str], tuple[type[Component], str]] = {}
        self._manager = pluggy.PluginManager("salframe")
        self._manager.add_hookspecs(hookspecs)

    def load(self, entry_point: EntryPoint) -> None:
        """Import a plugin and register its items. An exception is added to `failures` and not raised."""
        package = _package(entry_point)
        try:
            for item in self.call(entry_point, "salframe_provides"):
                self.add(item, package)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # an error of one plugin must not affect the others
            self.failures.append(Failure(entry_point.name, package, describe_error(error)))

    def call(self, entry_point: EntryPoint, hook: str) -> Any:
        """Return the result of a hook of a plugin, or an empty list if the plugin has no such hook.

        Raises:
            SalframeError: A function has the name of the hook, but is not marked as a hook.
            BaseException: Any exception of the plugin.
        """
        plugin: Any = entry_point.load()
        if not self._manager.is_registered(plugin):
            self._manager.register(plugin, name=f"{_package(entry_point)}:{entry_point.name}")
        for implementation in getattr(self._manager.hook, hook).get_hookimpls():
            if implementation.plugin is plugin:
                return cast(Any, implementation.function())
        if hasattr(plugin, hook):
            raise SalframeError(
                f"the function {plugin.__name__}.{hook} is not marked as a plugin hook: decorate it with "
                "@salframe.hookimpl"
            )
        return []

    def add(self, item: type[Component] | Presets, package: str) -> None:
        """Register a component, a role or presets.

        An invalid preset is added to `failures`.

        Raises:
            SalframeError: The item is invalid, or its name is already registered.
        """
        if isinstance(item, Presets):
            self._add_presets(item, package)
        elif is_role(item):
            self._add_role(cast(type[Role], item), package)
        else:
            for base in getattr(item, "__mro__", ()):
                if is_role(base):  # plugins load in the order of their names, so that of the role may load later
                    self.add(base, package)
            check_declaration(item, self.roles)
            key = (item.role, item.name)
            if key in self._components and self._components[key][0] is not item:
                provider = self._components[key][1]
                raise SalframeError(
                    f"the package {package} registers the {key[0]} {key[1]!r}, a name that the package {provider} "
                    "already uses: choose another name"
                )
            self._components[key] = (item, package)

    def _add_role(self, role: type[Role], package: str) -> None:
        if self.roles.get(getattr(role, "role", "")) is role:
            return
        for attribute in ("role", "word", "conformance", "presets"):
            value = getattr(role, attribute, None)
            if not (isinstance(value, str) or (attribute == "presets" and value is None)):
                raise SalframeError(
                    f"the class attribute {role.__qualname__}.{attribute} in the package {package} is {value!r}, "
                    "expected a string"
                )
        if role.role in self.roles:
            raise SalframeError(
                f"the package {package} registers the role {role.role!r}, a name that the role class "
                f"{self.roles[role.role].__qualname__} already uses: choose another name"
            )
        self.roles[role.role] = role
        for (folder, name), (path, owner) in list(
            self._presets.items()
        ):  # its presets may be registered before the role
            if folder == role.presets:
                del self._presets[folder, name]
                self._add_preset(path, owner)

    def _add_presets(self, presets: Presets, package: str) -> None:
        paths = sorted(presets.folder.glob("*/*.yaml"))
        for path in paths:
            if (key := (path.parent.name, path.stem)) in self._presets:
                raise SalframeError(
                    f"the package {package} registers the preset {path}, which has the same name as the preset "
                    f"{self._presets[key][0]}: choose another name"
                )
        for path in paths:
            self._add_preset(path, package)

    def _add_preset(self, path: Path, package: str) -> None:
        folder = path.parent.name
        try:
            content = read_yaml(path)
            for role in self.roles.values():
                if role.presets == folder:
                    check_preset(content, str(path), role.role)
        except SalframeError as error:
            self.failures.append(Failure(f"{folder}/{path.name}", package, describe_error(error)))
        else:
            self._presets[folder, path.stem] = path, package

    def find_preset(self, folder: str, name: str) -> Path | None:
        """Return the file of a preset in a folder such as methods/ or data/, or None if there is none.

        Raises:
            PluginFailed: The file is invalid.
        """
        if (folder, name) in self._presets:
            return self._presets[folder, name][0]
        for failure in self.failures:
            if failure.plugin == f"{folder}/{name}.yaml":
                raise PluginFailed(
                    f"the preset {failure.plugin} of the package {failure.package} is invalid: {failure.reason}"
                )
        return None

    def preset_files(self) -> list[tuple[Path, str]]:
        """Return (file, package) of every preset, sorted by folder and name. The folders in FOLDERS come first."""
        order = {folder: number for number, folder in enumerate(FOLDERS)}
        keys = sorted(self._presets, key=lambda key: (order.get(key[0], len(order)), key))
        return [self._presets[key] for key in keys]

    def list_presets(self, folder: str) -> dict[str, str]:
        """Return the presets in a folder such as methods/, sorted: name -> package that provides the preset."""
        return {path.stem: package for path, package in self.preset_files() if path.parent.name == folder}

    def __iter__(self) -> Iterator[tuple[type[Component], str]]:
        """Iterate over (class, package) of every component, sorted by role and name."""
        order = list(self.roles)
        return iter(sorted(self._components.values(), key=lambda entry: (order.index(entry[0].role), entry[0].name)))

    def names(self, role: str) -> list[str]:
        """Return the names of the components of a role, sorted."""
        return sorted(name for kind, name in self._components if kind == role)

    def get(self, role: str, name: str) -> type[Component]:
        """Return the component class of a role and name.

        Raises:
            PluginFailed: A plugin that may provide the component failed to load.
            ConfigError: The name is `auto`, which cannot be resolved without data.
            UnknownName: No plugin provides the component.
        """
        if not isinstance(name, str):  # the `kind` in a YAML file may have any type
            raise UnknownName(
                f"the key `kind` is {name!r}, expected the name of {with_article(role)}: {', '.join(self.names(role))}"
            )
        if (role, name) in self._components:
            return self._components[role, name][0]
        if name == AUTO and (order := auto_order(role)):
            raise ConfigError(
                f"{AUTO!r} selects {with_article(role)} only when the dataset is known: choose {with_article(role)} by "
                f"name ({', '.join(order)}, ...), or specify the dataset"
            )
        for failure in self.failures:
            if name in (failure.plugin, failure.package):
                raise PluginFailed(
                    f"{role} {name!r}: the plugin {failure.plugin} of the package {failure.package} failed to load "
                    f"({failure.reason}); try: pip install --force-reinstall {failure.package}"
                )
        raise UnknownName(unknown(role, name, self.names(role), self.failures))

    def build(self, role: str, config: ComponentConfig) -> Any:
        """Return an instance of the component that a configuration names."""
        return self.get(role, config.kind)(config)


def _package(entry_point: EntryPoint) -> str:
    """Return the package that declares an entry point."""
    if entry_point.value == BUILTIN:
        return "salframe"
    return entry_point.dist.name if entry_point.dist else entry_point.value


def check_declaration(component: Any, roles: dict[str, type[Role]]) -> None:
    """Raise SalframeError if the declaration of a component is invalid."""
    if not (
        isinstance(component, type) and issubclass(component, Component) and getattr(component, "role", None) in roles
    ):
        expected = ", ".join(role.__name__ for role in roles.values())
        raise SalframeError(
            f"a plugin registers {component!r}, which is not a component, expected a subclass of one of {expected}"
        )
    where = component.__qualname__
    absent = [attribute for attribute in ("name", "version") if not hasattr(component, attribute)]
    if absent:
        raise SalframeError(
            f"the component class {where} has no class attribute {' and no class attribute '.join(absent)}, expected "
            "both `name` and `version`"
        )
    if not isinstance(component.name, str) or re.fullmatch(KEBAB, component.name) is None:
        raise SalframeError(
            f"the class attribute {where}.name is {component.name!r}, expected words of lower-case letters and digits, "
            "joined by hyphens, such as my-detector"
        )
    if component.name == AUTO:
        raise SalframeError(
            f"the class attribute {where}.name is {AUTO!r}, a reserved word for automatic selection: choose another "
            "name"
        )
    for attribute in ("version", "extra"):
        if not isinstance(getattr(component, attribute), str):
            raise SalframeError(
                f"the class attribute {where}.{attribute} is {getattr(component, attribute)!r}, expected a string"
            )
    for attribute in ("requires", "weights"):
        if not isinstance(getattr(component, attribute), tuple):
            raise SalframeError(
                f"the class attribute {where}.{attribute} has the type {type(getattr(component, attribute)).__name__}, "
                "expected a tuple"
            )
    for package in component.requires:
        if not (isinstance(package, str) and package.isidentifier()):
            raise SalframeError(
                f"the class attribute {where}.requires contains {package!r}, expected the import name of a top-level "
                "package, such as torch"
            )
    for weights in component.weights:
        if not isinstance(weights, NetworkWeights):
            raise SalframeError(
                f"the class attribute {where}.weights contains {weights!r}, expected objects of type NetworkWeights"
            )
    _check_settings(component, where)


def _check_settings(component: type[Component], where: str) -> None:
    model = component.Config
    if not (isinstance(model, type) and issubclass(model, ComponentConfig)):
        raise SalframeError(f"the class attribute {where}.Config is {model!r}, expected a subclass of ComponentConfig")
    required = [name for name, field in model.model_fields.items() if field.is_required()]
    if required:
        raise SalframeError(
            f"the settings class {where}.Config has no default for {', '.join(required)}, expected a default for every "
            "setting"
        )
    defaults = model.model_construct()
    unordered = [name for name in model.model_fields if _holds_set(getattr(defaults, name))]
    if unordered:
        raise SalframeError(
            f"the settings class {where}.Config has a Python set as the default of {', '.join(unordered)}, expected a "
            "tuple: sets have no order"
        )
    try:
        json.dumps(defaults.model_dump(mode="json", warnings=False))
    except (PydanticSerializationError, TypeError, ValueError) as error:
        raise SalframeError(
            f"the settings class {where}.Config has a default that cannot be written as JSON: {describe_error(error)}"
        ) from None


def _holds_set(value: Any) -> bool:
    if isinstance(value, BaseModel):
        return any(_holds_set(getattr(value, name, None)) for name in type(value).model_fields)
    if isinstance(value, Mapping):
        return any(map(_holds_set, value.values()))
    if isinstance(value, tuple | list):
        return any(map(_holds_set, value))
    return isinstance(value, set | frozenset)


def check_preset(content: Mapping[str, Any], where: str, role: str) -> None:
    """Raise ConfigError if `kind` or `otherwise` of a preset is not a name.

    Args:
        content: The settings.
        where: The file, for messages.
        role: The role of the component.
    """
    if not isinstance(content.get("kind"), str):
        received = f"is {content['kind']!r}" if "kind" in content else "is missing"
        raise ConfigError(f"{where}: the key `kind` {received}, expected the name of {with_article(role)}")
    other = content.get(OTHERWISE)
    if not (other is None or isinstance(other, str)):
        raise ConfigError(f"{where}: the key `{OTHERWISE}` is {other!r}, expected the name of another {role}")


@cache
def registry() -> Registry:
    """Return the registry of all installed plugins.

    The environment variable `SALFRAME_PLUGINS=module,...` replaces the installed plugins by modules. The built-in
    plugin is always loaded.
    """
    plugins = Registry()
    for entry_point in [EntryPoint("builtin", BUILTIN, GROUP), *discover(GROUP)]:
        plugins.load(entry_point)
    return plugins


def load_commands() -> tuple[dict[str, tuple[Any, str]], list[Failure]]:
    """Return name -> (function or typer app, package) of the commands of all plugins, and the plugins that failed."""
    plugins = Registry()
    commands: dict[str, tuple[Any, str]] = {}
    for entry_point in discover(COMMANDS):
        package = _package(entry_point)
        try:
            for name, command in dict(plugins.call(entry_point, "salframe_commands")).items():
                if not (isinstance(name, str) and re.fullmatch(KEBAB, name) and callable(command)):
                    raise SalframeError(
                        f"the package {package} registers the command {name!r} as {command!r}, expected a name of "
                        "lower-case words joined by hyphens, and a function"
                    )
                if name in commands:
                    raise SalframeError(
                        f"the package {package} registers the command {name!r}, a name that {commands[name][1]} "
                        "already uses: choose another name"
                    )
                commands[name] = command, package
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            plugins.failures.append(Failure(entry_point.name, package, describe_error(error)))
    return commands, plugins.failures
