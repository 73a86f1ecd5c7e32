"""Finding components: one pluggy hook, guarded discovery, and errors that say what to do."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

import pluggy

from salframe.config import ComponentConfig
from salframe.errors import PluginFailed, SalframeError, UnknownName
from salframe.roles import ROLES, Component

hookspec = pluggy.HookspecMarker("salframe")


class _Hooks:
    @hookspec
    def salframe_components(self) -> list[type[Component]]:
        """The component classes this plugin provides."""
        return []


@dataclass(frozen=True)
class Failure:
    """A plugin that could not be loaded: its entry point, the package that declares it, and the exception in one line."""

    plugin: str
    package: str
    reason: str


class Registry:
    """Components by (role, name), and the plugins that failed."""

    def __init__(self) -> None:
        self._components: dict[tuple[str, str], tuple[type[Component], str]] = {}
        self.failures: list[Failure] = []
        self._manager = pluggy.PluginManager("salframe")
        self._manager.add_hookspecs(_Hooks)

    def load(self, entry_point: EntryPoint) -> None:
        """Import one plugin and take its components in; what goes wrong is kept in `failures`, never raised."""
        package = entry_point.dist.name if entry_point.dist else entry_point.value
        try:
            plugin: Any = entry_point.load()
            self._manager.register(plugin, name=f"{package}:{entry_point.name}")
            for implementation in self._manager.hook.salframe_components.get_hookimpls():
                if implementation.plugin is plugin:
                    for component in cast(list, implementation.function()):
                        self.add(component, package)
        except Exception as error:  # any exception of a plugin is the plugin's; it must not stop the others
            self.failures.append(Failure(entry_point.name, package, " ".join(f"{type(error).__name__}: {error}".split())))

    def add(self, component: type[Component], package: str) -> None:
        """Register one class. Raises SalframeError on a class without a role or name, or a (role, name) already taken."""
        if not (isinstance(component, type) and issubclass(component, Component) and getattr(component, "role", None) in ROLES):
            raise SalframeError(f"{component!r} is no component: it must subclass one of {', '.join(c.__name__ for c in ROLES.values())}")
        absent = [attribute for attribute in ("name", "version") if not hasattr(component, attribute)]
        if absent:
            raise SalframeError(f"{component.__qualname__} has no {' and no '.join(absent)}")
        for attribute in ("requires", "weights"):
            if not isinstance(getattr(component, attribute), tuple):
                raise SalframeError(f"{component.__qualname__}.{attribute} is {type(getattr(component, attribute)).__name__}, expected a tuple")
        key = (component.role, component.name)
        if key in self._components and self._components[key][0] is not component:
            raise SalframeError(f"the {key[0]} {key[1]!r} of {package} is already provided by {self._components[key][1]}")
        self._components[key] = (component, package)

    def __iter__(self) -> Iterator[tuple[type[Component], str]]:
        """(class, package) of every component, by role and name."""
        order = list(ROLES)
        return iter(sorted(self._components.values(), key=lambda entry: (order.index(entry[0].role), entry[0].name)))

    def names(self, role: str) -> list[str]:
        """The names registered for a role, sorted."""
        return sorted(name for kind, name in self._components if kind == role)

    def get(self, role: str, name: str) -> type[Component]:
        """The class of this role and name. Raises PluginFailed where a broken plugin may hold it, UnknownName otherwise."""
        if (role, name) in self._components:
            return self._components[role, name][0]
        for failure in self.failures:
            if failure.plugin == name or failure.package == name:
                raise PluginFailed(
                    f"{role} {name!r}: the plugin {failure.plugin} of {failure.package} failed to load ({failure.reason}); "
                    f"try: pip install --force-reinstall {failure.package}"
                )
        raise UnknownName(unknown(role, name, self.names(role), self.failures))

    def build(self, role: str, config: ComponentConfig) -> Any:
        """An instance of the component a slot's config names."""
        return self.get(role, config.kind)(config)


def unknown(what: str, name: str, known: list[str], failures: list[Failure] | None = None) -> str:
    """The message for a name that nobody has: the closest one, and the list."""
    close = difflib.get_close_matches(name, known, 1)
    listed = ", ".join(known[:30]) + (f", ... ({len(known)} in all)" if len(known) > 30 else "")
    message = f"unknown {what} {name!r}" + (f", did you mean {close[0]!r}?" if close else ".") + f" Known: {listed or 'none'}."
    if failures:
        message += f" {len(failures)} plugin(s) failed to load: {', '.join(f'{f.plugin} ({f.reason})' for f in failures)}."
    return message


@cache
def registry() -> Registry:
    """All installed components. `SALFRAME_PLUGINS=module,...` replaces discovery by these modules."""
    found = Registry()
    listed = os.environ.get("SALFRAME_PLUGINS")
    if listed is None:
        plugins = sorted(entry_points(group="salframe"), key=lambda point: (point.dist.name if point.dist else "", point.name))
    else:
        plugins = [EntryPoint(module, module, "salframe") for module in listed.split(",") if module]
    for entry_point in plugins:
        found.load(entry_point)
    return found
