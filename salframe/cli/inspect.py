"""methods, plugins, show, doctor: what is installed and how it is set."""

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
    """List what `--methods` takes, a line each: presets and localizers, whose they are, and what they lack to run."""
    from salframe.framework.components.installation import list_names

    found = list(list_names("localizer"))
    if as_json:
        print_json([{**dataclasses.asdict(method), "available": method.missing is None} for method in found])
        return
    widths = [max((len(getattr(method, key)) for method in found), default=0) for key in ("name", "package")]
    for method in found:
        state = "available" if method.missing is None else f"cannot run: {method.missing}"
        print(f"{method.name:{widths[0]}}  {method.package:{widths[1]}}  {state}")


def plugins(as_json: Json = False) -> None:
    """List every component: its role, name, version, package, and what it lacks to run; presets and commands too."""
    from salframe.cli.tables import print_table
    from salframe.framework.components.installation import list_components
    from salframe.framework.components.registry import load_commands, registry

    components = list(list_components())
    commands, broken = load_commands()
    failures = [*registry().failures, *broken]
    presets = [(path.parent.name, path.stem, package) for path, package in registry().preset_files()]
    brought = [(name, package) for name, (_, package) in commands.items()]
    if as_json:
        entries = [{**dataclasses.asdict(one), "available": one.missing is None} for one in components]
        print_json(
            {
                "components": entries,
                "presets": [dict(zip(("folder", "name", "package"), one, strict=True)) for one in presets],
                "commands": [dict(zip(("name", "package"), one, strict=True)) for one in brought],
                "failures": [dataclasses.asdict(failure) for failure in failures],
            }
        )
        return
    rows = [[one.role, one.name, one.version, one.package, one.missing or "available"] for one in components]
    rows += [[folder, name, "", package, "preset"] for folder, name, package in presets]
    rows += [["command", name, "", package, "available"] for name, package in brought]
    print_table(("role", "name", "version", "package", ""), rows)
    for failure in failures:
        print(f"{failure.plugin} of {failure.package} failed to load: {failure.reason}")


def show(
    name: Annotated[str, typer.Argument(help="A method, a dataset, or any component.")], as_json: Json = False
) -> None:
    """Show every setting of a preset or component: value, type and help. Settings of a slot's component follow it."""
    from salframe.cli.tables import print_table
    from salframe.framework.components.installation import summary_of
    from salframe.framework.components.presets import configure_default, names
    from salframe.framework.components.registry import registry, unknown
    from salframe.framework.components.settings import list_settings
    from salframe.framework.errors import UnknownName

    roles = registry().roles
    found = {role: configure_default(role, name) for role in roles if name in names(role)}
    if not found:
        known = sorted({known for role in roles for known in names(role)})
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
                for role, config in found.items()
            ]
        )
        return
    for role, config in found.items():
        print(f"{role} {name}" + (f", a preset of {config.kind}" if name != config.kind else ""))
        print(summary_of(config.component))
        rows = [[one.key, _value(one), one.type, one.help] for one in list_settings(config)]
        print_table(("setting", "value", "type", "help"), rows)


def _value(setting: Setting) -> str:
    value, default = (text if isinstance(text, str) else json.dumps(text) for text in (setting.value, setting.default))
    return value if value == default else f"{value} (default {default})"


def doctor(as_json: Json = False) -> None:
    """Check the installation: versions, plugins that failed to load, cache, weights. Exit 1 where a plugin failed."""
    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.components.installation import diagnose

    found = diagnose()
    if as_json:
        print_json({**dataclasses.asdict(found), "cache": str(found.cache)})
    else:
        machine = found.environment["machine"]
        print(f"python {found.environment['python']} on {machine['platform']}, {machine['cpus']} cpus")
        print(", ".join(f"{package} {version}" for package, version in found.environment["packages"].items()))
        print(f"cache {found.cache}: {format_bytes(found.cache_bytes)}")
        for name, missing in found.weights.items():
            print(f"weights {name}: {missing or 'at hand'}")
        print(f"{len(found.environment['plugins'])} components, {len(found.failures)} plugin(s) failed to load")
        for failure in found.failures:
            print(f"  {failure.plugin} of {failure.package}: {failure.reason}")
    if not found.healthy:
        raise typer.Exit(1)
