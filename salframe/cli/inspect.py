"""The commands `methods`, `plugins`, `show` and `doctor`."""

from __future__ import annotations

import dataclasses
import itertools
import json
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json

if TYPE_CHECKING:
    from salframe.framework.components.installation import ComponentStatus
    from salframe.framework.components.settings import Setting


Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Also print versions, paths and full error messages")]


def methods(verbose: Verbose = False, as_json: Json = False) -> None:
    """List the localization methods that `--methods` accepts.

    Each line has the name and the package of a method, and what it still requires, such as a Python package or weights.
    """
    from salframe.framework.components.installation import list_names

    entries = list(list_names("localizer"))
    if as_json:
        print_json([{**dataclasses.asdict(method), "available": method.missing is None} for method in entries])
        return
    _print_statuses(entries, verbose)


def _print_statuses(entries: Sequence[ComponentStatus], verbose: bool, indent: str = "") -> None:
    """Print a line per component: name, package, and a short status or the full message."""
    widths = [max((len(getattr(entry, key)) for entry in entries), default=0) for key in ("name", "package")]
    for entry in entries:
        status = entry.missing or f"ready, version {entry.version}" if verbose else entry.short
        print(f"{indent}{entry.name:{widths[0]}}  {entry.package:{widths[1]}}  {status}")


def plugins(verbose: Verbose = False, as_json: Json = False) -> None:
    """List every component, preset and command.

    A component is a class of a plugin, such as a detector or a dataset. Components are grouped by role (their kind). A
    preset is a named set of settings. Each line has the name and the package of a component, and what it still
    requires, such as a Python package or weights.
    """
    from salframe.framework.components.installation import list_components
    from salframe.framework.components.registry import load_commands, registry

    components = list(list_components())
    commands, command_failures = load_commands()
    failures = [*registry().failures, *command_failures]
    presets = [(path.parent.name, path.stem, package) for path, package in registry().preset_files()]
    plugin_commands = [(name, package) for name, (_, package) in commands.items()]
    if as_json:
        entries = [{**dataclasses.asdict(status), "available": status.missing is None} for status in components]
        print_json(
            {
                "components": entries,
                "presets": [dict(zip(("folder", "name", "package"), preset, strict=True)) for preset in presets],
                "commands": [dict(zip(("name", "package"), command, strict=True)) for command in plugin_commands],
                "failures": [dataclasses.asdict(failure) for failure in failures],
            }
        )
        return
    for role, group in itertools.groupby(components, lambda status: status.role):
        print(role)
        _print_statuses(list(group), verbose, "  ")
    listed = [*presets, *(("commands", name, package) for name, package in plugin_commands)]
    for (folder, package), items in itertools.groupby(listed, lambda item: (item[0], item[2])):
        names = ", ".join(name for _, name, _ in items)
        print(f"{folder} of {package}" if folder == "commands" else f"presets: {folder} of {package}")
        print(textwrap.fill(names, 78, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False))
    for failure in failures:
        print(f"the plugin {failure.plugin} (package {failure.package}) failed to load: {failure.reason}")


def show(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="Name of a method, dataset or other component, or a role such as detector"),
    ],
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Show the settings of a component, or the components of a role.

    A component is a class of a plugin, such as a method or a dataset. A role is a kind of component, such as detector.
    Each row has the name, the value, the type and the description of a setting.
    """
    from salframe.cli.tables import print_table
    from salframe.framework.components.installation import list_names, summary_of
    from salframe.framework.components.presets import configure_default, names
    from salframe.framework.components.registry import registry, unknown
    from salframe.framework.components.settings import list_settings
    from salframe.framework.errors import UnknownName

    roles = registry().roles
    configs = {role: configure_default(role, name) for role in roles if name in names(role)}
    if not configs and name in roles:
        entries = list(list_names(name))
        if as_json:
            print_json([{**dataclasses.asdict(entry), "available": entry.missing is None} for entry in entries])
        else:
            _print_statuses(entries, verbose)
        return
    if not configs:
        choices = sorted({entry for role in roles for entry in [role, *names(role)]})
        raise UnknownName(unknown("preset, component or role", name, choices, registry().failures))
    if as_json:
        print_json(
            [
                {
                    "role": role,
                    "name": name,
                    "kind": config.kind,
                    "settings": [dataclasses.asdict(setting) for setting in list_settings(config)],
                }
                for role, config in configs.items()
            ]
        )
        return
    for role, config in configs.items():
        print(f"{role} {name}" + (f", a preset of {config.kind}" if name != config.kind else ""))
        print(summary_of(config.component))
        rows = [[setting.key, _value(setting), setting.type, setting.help] for setting in list_settings(config)]
        print_table(("setting", "value", "type", "help"), rows)


def _value(setting: Setting) -> str:
    value, default = (text if isinstance(text, str) else json.dumps(text) for text in (setting.value, setting.default))
    return value if value == default else f"{value} (default {default})"


def doctor(verbose: Verbose = False, as_json: Json = False) -> None:
    """Check this installation: versions, plugins, cache, weights.

    The exit status is 1 if a plugin failed to load.
    """
    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.components.installation import diagnose
    from salframe.framework.errors import counted

    diagnosis = diagnose()
    if as_json:
        print_json({**dataclasses.asdict(diagnosis), "cache": str(diagnosis.cache)})
    else:
        machine = diagnosis.environment["machine"]
        print(f"python {diagnosis.environment['python']} on {machine['platform']}, {machine['cpus']} cpus")
        packages = [f"{package} {version}" for package, version in diagnosis.environment["packages"].items()]
        print(textwrap.fill(", ".join(packages), 78, subsequent_indent="  ", break_on_hyphens=False))
        print(f"cache {diagnosis.cache}: {format_bytes(diagnosis.cache_bytes)}")
        for name, missing in diagnosis.weights.items():
            short = missing if verbose else f"needs: salframe weights fetch {name}"
            print(f"weights {name}: {'ready' if missing is None else short}")
        failed = counted(len(diagnosis.failures), "plugin") if diagnosis.failures else "no plugin"
        print(f"{len(diagnosis.environment['plugins'])} components, {failed} failed to load")
        for failure in diagnosis.failures:
            print(f"  {failure.plugin} of {failure.package}: {failure.reason}")
    if not diagnosis.healthy:
        raise typer.Exit(1)
