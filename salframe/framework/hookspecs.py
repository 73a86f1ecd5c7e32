"""The hooks of a plugin: functions in its module that are marked with `@salframe.hookimpl`."""

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
"""Decorator for the functions `salframe_provides` and `salframe_commands` of a plugin."""


@dataclass(frozen=True)
class Presets:
    """A folder of presets that a plugin ships.

    The presets are files NAME.yaml in the subfolders methods/, data/, ablations/ and reported/, and in the folders that
    roles of the plugin name.
    """

    folder: Path


@hookspec
def salframe_provides() -> list[type[Component] | Presets]:
    """Return the component classes, roles and preset collections of the plugin.

    The module must be an entry point of the group `salframe`.
    """
    return []


@hookspec
def salframe_commands() -> dict[str, Callable[..., Any]]:
    """Return the commands of the plugin by name: functions for typer, or typer apps.

    The module must be an entry point of the group `salframe.commands`.
    """
    return {}
