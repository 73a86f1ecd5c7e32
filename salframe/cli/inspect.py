"""plugins, show, doctor: what is installed and how it is set."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.compare import Json

if TYPE_CHECKING:
    from salframe.framework.settings import Setting


def plugins(as_json: Json = False) -> None:
    """List every component: its role, name, version, package, and what it lacks to run."""
    from salframe.cli.tables import print_table
    from salframe.framework.installation import list_components
    from salframe.framework.registry import registry

    components = list(list_components())
    failures = registry().failures
    if as_json:
        entries = [
            {**dataclasses.asdict(component), "available": component.missing is None} for component in components
        ]
        print(
            json.dumps(
                {"components": entries, "failures": [dataclasses.asdict(failure) for failure in failures]}, indent=2
            )
        )
        return
    rows = [[c.role, c.name, c.version, c.package, c.missing or "available"] for c in components]
    print_table(("role", "name", "version", "package", ""), rows)
    for failure in failures:
        print(f"{failure.plugin} of {failure.package} failed to load: {failure.reason}")


def show(
    name: Annotated[str, typer.Argument(help="A method, a dataset, or any component.")], as_json: Json = False
) -> None:
    """Show every setting of a preset or component: value, type and help. Settings of a slot's component follow it."""
    from salframe.builtin import ROLES
    from salframe.cli.tables import print_table
    from salframe.framework.errors import UnknownName
    from salframe.framework.presets import configure, names, settings
    from salframe.framework.registry import registry, unknown
    from salframe.framework.settings import list_settings

    found = {role: configure(role, name, settings(role, name)) for role in ROLES if name in names(role)}
    if not found:
        known = sorted({known for role in ROLES for known in names(role)})
        raise UnknownName(unknown("preset or component", name, known, registry().failures))
    if as_json:
        print(
            json.dumps(
                [
                    {
                        "role": role,
                        "name": name,
                        "kind": config.kind,
                        "settings": [dataclasses.asdict(s) for s in list_settings(config)],
                    }
                    for role, config in found.items()
                ],
                indent=2,
            )
        )
        return
    for role, config in found.items():
        component = config.component
        print(f"{role} {name}" + (f", a preset of {config.kind}" if name != config.kind else ""))
        print((component.__doc__ or "").strip().partition("\n")[0])
        print_table(
            ("setting", "value", "type", "help"), [[s.key, _value(s), s.type, s.help] for s in list_settings(config)]
        )


def _value(setting: Setting) -> str:
    value, default = (text if isinstance(text, str) else json.dumps(text) for text in (setting.value, setting.default))
    return value if value == default else f"{value} (default {default})"


def doctor(as_json: Json = False) -> None:
    """Check the installation: versions, plugins that failed to load, cache, weights. Exit 1 where a plugin failed."""
    from salframe.cli.tables import format_bytes
    from salframe.framework.installation import diagnose

    found = diagnose()
    if as_json:
        print(json.dumps({**dataclasses.asdict(found), "cache": str(found.cache)}, indent=2))
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
