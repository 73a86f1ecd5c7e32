"""Where plugins are looked for. Imports nothing heavy: the command line asks here before it needs a registry."""

from __future__ import annotations

import os
from importlib.metadata import EntryPoint, entry_points

GROUP, COMMANDS = "salframe", "salframe.commands"
"""Entry points: modules with the hook `salframe_provides`, and modules with the hook `salframe_commands`."""
PLUGINS = "SALFRAME_PLUGINS"
"""The variable that names modules, comma-separated, in the place of all that is installed."""


def discover(group: str) -> list[EntryPoint]:
    """The entry points of a group, by package and name; the modules that `SALFRAME_PLUGINS` names where it is set."""
    listed = os.environ.get(PLUGINS)
    if listed is not None:
        return [EntryPoint(module, module, group) for module in listed.split(",") if module]
    return sorted(entry_points(group=group), key=lambda point: (point.dist.name if point.dist else "", point.name))
