"""Finding what plugins bring: guarded discovery, checks at registration, and errors that say what to do."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, cast

import pluggy
from pydantic_core import PydanticSerializationError

from salframe.framework.component import Component, Role, is_role
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import PluginFailed, SalframeError, UnknownName, describe_error, unknown

GROUP, COMMANDS = "salframe", "salframe.commands"
"""Entry points: modules with the hook `salframe_provides`, and modules with the hook `salframe_commands`."""
BUILTIN = "salframe.builtin"
"""The core as a plugin; it is always there."""
KEBAB = r"[a-z0-9]+(-[a-z0-9]+)*"

hookspec = pluggy.HookspecMarker("salframe")


@dataclass(frozen=True)
class Presets:
    """A folder of YAML files that a plugin ships: NAME.yaml in methods/, data/ and ablations/."""

    folder: Path


class _Hooks:
    @hookspec
    def salframe_provides(self) -> list[type[Component] | Presets]:
        """What this plugin brings: component classes, roles of its own (before their components), collections of
        presets."""
        return []

    @hookspec
    def salframe_commands(self) -> dict[str, Callable[..., Any]]:
        """Commands of this plugin by name: functions as typer takes them, or typer apps."""
        return {}


@dataclass(frozen=True)
class Failure:
    """A plugin that could not be loaded: its entry point, the package that declares it, the exception in one line."""

    plugin: str
    package: str
    reason: str

    def __str__(self) -> str:
        return f"{self.plugin} ({self.reason})"


class Registry:
    """Roles by name, components by (role, name), collections of presets, and the plugins that failed."""

    def __init__(self) -> None:
        self.roles: dict[str, type[Role]] = {}
        self.presets: list[tuple[Presets, str]] = []
        self.failures: list[Failure] = []
        self._components: dict[tuple[str, str], tuple[type[Component], str]] = {}
        self._manager = pluggy.PluginManager("salframe")
        self._manager.add_hookspecs(_Hooks)

    def load(self, entry_point: EntryPoint) -> None:
        """Import one plugin and take in what it brings; what goes wrong is kept in `failures`, never raised."""
        package = _package(entry_point)
        try:
            for item in self.call(entry_point, "salframe_provides"):
                self.add(item, package)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever a plugin raises is the plugin's; it must not stop the others
            self.failures.append(Failure(entry_point.name, package, describe_error(error)))

    def call(self, entry_point: EntryPoint, hook: str) -> Any:
        """What the hook of one plugin gives; an empty list where it has none. Raises SalframeError on a function of the
        hook's name that is not marked as one, and whatever the plugin raises."""
        plugin: Any = entry_point.load()
        if not self._manager.is_registered(plugin):
            self._manager.register(plugin, name=f"{_package(entry_point)}:{entry_point.name}")
        for implementation in getattr(self._manager.hook, hook).get_hookimpls():
            if implementation.plugin is plugin:
                return cast(Any, implementation.function())
        if hasattr(plugin, hook):
            raise SalframeError(f"{hook} of {plugin.__name__} is no hook: mark it with @salframe.hookimpl")
        return []

    def add(self, item: type[Component] | Presets, package: str) -> None:
        """Register a component, a role or presets. Raises SalframeError on what is none of them or already taken."""
        if isinstance(item, Presets):
            self._add_presets(item, package)
        elif is_role(item):
            role = cast(type[Role], item)
            if self.roles.setdefault(role.role, role) is not role:
                raise SalframeError(f"the role {role.role!r} of {package} is already there: {self.roles[role.role]}")
        else:
            for base in getattr(item, "__mro__", ()):
                if is_role(base):  # the plugin that brings it may come later: plugins load in the order of their names
                    self.add(base, package)
            check_declaration(item, self.roles)
            key = (item.role, item.name)
            if key in self._components and self._components[key][0] is not item:
                provider = self._components[key][1]
                raise SalframeError(f"the {key[0]} {key[1]!r} of {package} is already provided by {provider}")
            self._components[key] = (item, package)

    def _add_presets(self, presets: Presets, package: str) -> None:
        for path in sorted(presets.folder.glob("*/*.yaml")):
            taken = self.find_preset(path.parent.name, path.stem)
            if taken is not None:
                raise SalframeError(f"the preset {path} of {package} is already there: {taken}")
        self.presets.append((presets, package))

    def find_preset(self, folder: str, name: str) -> Path | None:
        """The file of a preset in methods/, data/ or another folder of presets, None where no plugin ships it."""
        paths = (presets.folder / folder / f"{name}.yaml" for presets, _ in self.presets)
        return next((path for path in paths if path.is_file()), None)

    def preset_files(self) -> list[tuple[Path, str]]:
        """(file, package) of every preset of methods, data and ablations, by folder and name."""
        folders = ("methods", "data", "ablations")
        found = [
            (path, package)
            for presets, package in self.presets
            for folder in folders
            for path in (presets.folder / folder).glob("*.yaml")
        ]
        return sorted(found, key=lambda entry: (folders.index(entry[0].parent.name), entry[0].stem))

    def list_presets(self, folder: str) -> dict[str, str]:
        """Name -> package of the presets in a folder of the collections, sorted."""
        found = {
            path.stem: package for presets, package in self.presets for path in (presets.folder / folder).glob("*.yaml")
        }
        return dict(sorted(found.items()))

    def __iter__(self) -> Iterator[tuple[type[Component], str]]:
        """(class, package) of every component, by role and name."""
        order = list(self.roles)
        return iter(sorted(self._components.values(), key=lambda entry: (order.index(entry[0].role), entry[0].name)))

    def names(self, role: str) -> list[str]:
        """The names registered for a role, sorted."""
        return sorted(name for kind, name in self._components if kind == role)

    def get(self, role: str, name: str) -> type[Component]:
        """The class of this role and name. Raises PluginFailed where a broken plugin may hold it, UnknownName
        otherwise."""
        if not isinstance(name, str):  # a `kind` of a YAML file may be anything
            raise UnknownName(f"received {name!r}, expected the name of a {role}: {', '.join(self.names(role))}")
        if (role, name) in self._components:
            return self._components[role, name][0]
        for failure in self.failures:
            if name in (failure.plugin, failure.package):
                raise PluginFailed(
                    f"{role} {name!r}: the plugin {failure.plugin} of {failure.package} failed to load "
                    f"({failure.reason}); try: pip install --force-reinstall {failure.package}"
                )
        raise UnknownName(unknown(role, name, self.names(role), self.failures))

    def build(self, role: str, config: ComponentConfig) -> Any:
        """An instance of the component a slot's config names."""
        return self.get(role, config.kind)(config)


def _package(entry_point: EntryPoint) -> str:
    if entry_point.value == BUILTIN:
        return "salframe"
    return entry_point.dist.name if entry_point.dist else entry_point.value


def check_declaration(component: Any, roles: dict[str, type[Role]]) -> None:
    """Raise SalframeError on a class whose declaration would break whatever lists or configures it."""
    if not (
        isinstance(component, type) and issubclass(component, Component) and getattr(component, "role", None) in roles
    ):
        expected = ", ".join(role.__name__ for role in roles.values())
        raise SalframeError(f"{component!r} is no component: it must subclass one of {expected}")
    where = component.__qualname__
    absent = [attribute for attribute in ("name", "version") if not hasattr(component, attribute)]
    if absent:
        raise SalframeError(f"{where} has no {' and no '.join(absent)}")
    if not isinstance(component.name, str) or re.fullmatch(KEBAB, component.name) is None:
        raise SalframeError(
            f"{where}.name is {component.name!r}, expected words of small letters and digits joined by hyphens"
        )
    for attribute in ("version", "extra"):
        if not isinstance(getattr(component, attribute), str):
            raise SalframeError(f"{where}.{attribute} is {getattr(component, attribute)!r}, expected text")
    for attribute in ("requires", "weights"):
        if not isinstance(getattr(component, attribute), tuple):
            raise SalframeError(
                f"{where}.{attribute} is {type(getattr(component, attribute)).__name__}, expected a tuple"
            )
    for package in component.requires:
        if not (isinstance(package, str) and package.isidentifier()):
            raise SalframeError(f"{where}.requires holds {package!r}, expected the name of a top-level package")
    _check_settings(component, where)


def _check_settings(component: type[Component], where: str) -> None:
    model = component.Config
    if not (isinstance(model, type) and issubclass(model, ComponentConfig)):
        raise SalframeError(f"{where}.Config is {model!r}, expected a subclass of ComponentConfig")
    required = [name for name, field in model.model_fields.items() if field.is_required()]
    if required:
        raise SalframeError(f"{where}.Config has no default for {', '.join(required)}, expected one for every setting")
    try:
        json.dumps(model.model_construct().model_dump(mode="json", warnings=False))
    except (PydanticSerializationError, TypeError, ValueError) as error:
        raise SalframeError(
            f"{where}.Config has a default that cannot be written as JSON: {describe_error(error)}"
        ) from None


def _discover(group: str) -> list[EntryPoint]:
    """The entry points of a group; `SALFRAME_PLUGINS=module,...` replaces discovery by these modules."""
    listed = os.environ.get("SALFRAME_PLUGINS")
    if listed is not None:
        return [EntryPoint(module, module, group) for module in listed.split(",") if module]
    return sorted(entry_points(group=group), key=lambda point: (point.dist.name if point.dist else "", point.name))


@cache
def registry() -> Registry:
    """All that is installed. `SALFRAME_PLUGINS=module,...` replaces discovery by these modules; the core's own is
    always there."""
    found = Registry()
    for entry_point in [EntryPoint("builtin", BUILTIN, GROUP), *_discover(GROUP)]:
        found.load(entry_point)
    return found


def load_commands() -> tuple[dict[str, tuple[Any, str]], list[Failure]]:
    """Command -> (function or app, package) of every plugin that brings some, and the plugins that failed."""
    found = Registry()
    commands: dict[str, tuple[Any, str]] = {}
    for entry_point in _discover(COMMANDS):
        package = _package(entry_point)
        try:
            for name, command in dict(found.call(entry_point, "salframe_commands")).items():
                if not (isinstance(name, str) and re.fullmatch(KEBAB, name) and callable(command)):
                    raise SalframeError(
                        f"{name!r}: {command!r} is no command, expected a kebab-case name and a function"
                    )
                if name in commands:
                    raise SalframeError(f"the command {name!r} of {package} is already provided by {commands[name][1]}")
                commands[name] = command, package
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            found.failures.append(Failure(entry_point.name, package, describe_error(error)))
    return commands, found.failures
