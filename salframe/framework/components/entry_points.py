"""Discovery of plugins. This module is fast to import, since the command line uses it before the registry."""

from __future__ import annotations

import os
from importlib.metadata import EntryPoint, entry_points

GROUP, COMMANDS = "salframe", "salframe.commands"
"""Entry point groups of modules with the hooks `salframe_provides` and `salframe_commands`."""
PLUGINS = "SALFRAME_PLUGINS"
"""Environment variable with a comma-separated list of modules that replaces the installed plugins."""


def discover(group: str) -> list[EntryPoint]:
    """Return the plugins of an entry point group, sorted by package and name; if the environment variable
    SALFRAME_PLUGINS is set, the modules that it names."""
    modules = os.environ.get(PLUGINS)
    if modules is not None:
        return [EntryPoint(module, module, group) for module in modules.split(",") if module]
    return sorted(entry_points(group=group), key=lambda point: (point.dist.name if point.dist else "", point.name))
