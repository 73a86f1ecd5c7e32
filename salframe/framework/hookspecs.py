"""The hooks of a plugin: functions of its module, marked with `@salframe.hookimpl`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pluggy import HookimplMarker, HookspecMarker

if TYPE_CHECKING:
    from salframe.framework.component import Component

hookspec = HookspecMarker("salframe")
hookimpl = HookimplMarker("salframe")
"""Marks a plugin's `salframe_provides` and `salframe_commands` functions."""


@dataclass(frozen=True)
class Presets:
    """A folder of YAML files that a plugin ships: NAME.yaml in methods/, data/, ablations/, reported/ and the folder
    that a role of its own names."""

    folder: Path


@hookspec
def salframe_provides() -> list[type[Component] | Presets]:
    """Return the plugin's component classes, roles of its own and collections of presets.

    Entry points of the group `salframe` name the modules that have this hook.
    """
    return []


@hookspec
def salframe_commands() -> dict[str, Callable[..., Any]]:
    """Return the plugin's commands by name: functions as typer takes them, or typer apps.

    Entry points of the group `salframe.commands` name the modules that have this hook.
    """
    return {}
