"""The commands `methods`, `plugins`, `show` and `doctor`."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json

if TYPE_CHECKING:
    from salframe.framework.components.settings import Setting


def methods(as_json: Json = False) -> None:
    """List the presets and localizers that `--methods` accepts.

    Each line has the name, the package, and what is missing to run it.
    """
    from salframe.framework.components.installation import list_names

    entries = list(list_names("localizer"))
    if as_json:
        print_json([{**dataclasses.asdict(method), "available": method.missing is None} for method in entries])
        return
    widths = [max((len(getattr(method, key)) for method in entries), default=0) for key in ("name", "package")]
    for method in entries:
        state = "available" if method.missing is None else f"cannot run: {method.missing}"
        print(f"{method.name:{widths[0]}}  {method.package:{widths[1]}}  {state}")


def plugins(as_json: Json = False) -> None:
    """List every component, preset and command.

    Each row has the role, name, version, package, and what is missing to run it.
    """
    from salframe.cli.tables import print_table
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
    rows = [[item.role, item.name, item.version, item.package, item.missing or "available"] for item in components]
    rows += [[folder, name, "", package, "preset"] for folder, name, package in presets]
    rows += [["command", name, "", package, "available"] for name, package in plugin_commands]
    print_table(("role", "name", "version", "package", ""), rows)
    for failure in failures:
        print(f"{failure.plugin} of {failure.package} failed to load: {failure.reason}")


def show(
    name: Annotated[str, typer.Argument(help="Method, dataset or any other component")], as_json: Json = False
) -> None:
    """Show the settings of a preset or component.

    Each row has the value, type and help of a setting. The settings of a component in a slot follow the slot.
    """
    from salframe.cli.tables import print_table
    from salframe.framework.components.installation import summary_of
    from salframe.framework.components.presets import configure_default, names
    from salframe.framework.components.registry import registry, unknown
    from salframe.framework.components.settings import list_settings
    from salframe.framework.errors import UnknownName

    roles = registry().roles
    configs = {role: configure_default(role, name) for role in roles if name in names(role)}
    if not configs:
        known = sorted({entry for role in roles for entry in names(role)})
        raise UnknownName(unknown("preset or component", name, known, registry().failures))
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


def doctor(as_json: Json = False) -> None:
    """Check the installation: versions, plugins, cache and weights.

    The exit status is 1 if a plugin failed to load.
    """
    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.components.installation import diagnose

    diagnosis = diagnose()
    if as_json:
        print_json({**dataclasses.asdict(diagnosis), "cache": str(diagnosis.cache)})
    else:
        machine = diagnosis.environment["machine"]
        print(f"python {diagnosis.environment['python']} on {machine['platform']}, {machine['cpus']} cpus")
        print(", ".join(f"{package} {version}" for package, version in diagnosis.environment["packages"].items()))
        print(f"cache {diagnosis.cache}: {format_bytes(diagnosis.cache_bytes)}")
        for name, missing in diagnosis.weights.items():
            print(f"weights {name}: {missing or 'at hand'}")
        print(f"{len(diagnosis.environment['plugins'])} components, {len(diagnosis.failures)} plugin(s) failed to load")
        for failure in diagnosis.failures:
            print(f"  {failure.plugin} of {failure.package}: {failure.reason}")
    if not diagnosis.healthy:
        raise typer.Exit(1)
