"""The `salframe` command. Each command imports what it needs when it runs, so that `--help` stays quick."""

from __future__ import annotations

import sys
import traceback
from functools import cached_property
from typing import Any

import typer
from typer.core import TyperGroup

import salframe
from salframe.cli import (
    build,
    cache,
    compare,
    data,
    detection,
    docs,
    experiment,
    fit,
    inspect,
    localize,
    map,
    matching,
    navigate,
    report,
    score,
    sensor,
    show_objects,
    weights,
)
from salframe.cli.output import json_alone
from salframe.framework.components.entry_points import COMMANDS, discover
from salframe.framework.errors import SalframeError, describe_error


class _Interrupted(Exception):
    """An interrupt of the user, by a name that typer does not end the process for."""


class Commands(TyperGroup):
    """Our commands, and those that plugins bring, which are loaded when they are listed or called.

    Contexts and commands are of the click that this version of typer was built on; it exports neither.
    """

    @cached_property
    def _brought(self) -> dict[str, Any]:
        return _plugin_commands()

    def list_commands(self, ctx: Any) -> list[str]:
        own = super().list_commands(ctx)
        return [*own, *sorted(set(self._brought) - set(own))]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        return super().get_command(ctx, cmd_name) or self._brought.get(cmd_name)

    def invoke(self, ctx: Any) -> Any:
        """Run a command. What it raises passes through typer as an error of ours: typer itself never raises SystemExit
        here, but a component may, and the process would end as if all was well."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise _Interrupted from None
        except SystemExit as stop:
            if ctx.invoked_subcommand not in self.commands:  # a plugin's command ends as it likes
                raise
            *_, last = traceback.extract_tb(stop.__traceback__)
            where = f"{last.filename} line {last.lineno}"
            raise SalframeError(
                f"{describe_error(stop)} was raised in {where}, expected no component to end the process"
            ) from stop


def _plugin_commands() -> dict[str, Any]:
    """The commands of plugins by name."""
    if not discover(COMMANDS):
        return {}  # and no registry is imported for `--help`
    from salframe.framework.components.registry import load_commands

    commands, failures = load_commands()
    for failure in failures:
        print(f"{failure.plugin} of {failure.package}: its commands failed to load: {failure.reason}", file=sys.stderr)
    return {name: _as_click(name, command) for name, (command, _) in commands.items()}


def _as_click(name: str, command: Any) -> Any:
    if isinstance(command, typer.Typer):
        return typer.main.get_group(command)
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command(name)(command)
    return typer.main.get_command(alone)


app = typer.Typer(
    cls=Commands,
    help="Where am I, and which way do I turn? Localization from one RGB-D panorama, and baselines to compare with.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
_debug = False


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"salframe {salframe.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
    ),
) -> None:
    global _debug
    _debug = debug


app.command()(compare.compare)
app.command()(compare.ablate)
app.command()(compare.evaluate)
app.command()(experiment.experiment)
app.command()(report.report)
app.command()(matching.matching)
app.command()(detection.detection)
app.command()(fit.fit)
app.command()(sensor.sensor)
app.command()(build.build)
app.command()(localize.localize)
app.command()(show_objects.show_objects)
app.command()(navigate.navigate)
app.command()(score.score)
app.command()(inspect.methods)
app.command()(inspect.plugins)
app.command()(inspect.show)
app.command()(inspect.doctor)
app.command()(docs.docs)
app.add_typer(cache.app, name="cache")
app.add_typer(data.app, name="data")
app.add_typer(map.app, name="map")
app.add_typer(weights.app, name="weights")


def main() -> None:
    """Run the command line; an error that a user can cause is one line on stderr and exit status 2, an interrupt one
    line and 130."""
    try:
        with json_alone("--json" in sys.argv):
            app()
    except (KeyboardInterrupt, _Interrupted):
        print(
            "interrupted: finished frames and answers are kept, run the same command again to resume", file=sys.stderr
        )
        sys.exit(130)
    except SalframeError as error:
        if _debug:
            raise
        print(f"error: {describe_error(error)}", file=sys.stderr)
        sys.exit(2)
    except OSError as error:  # a full disk, a folder that may not be written to
        if _debug:
            raise
        where = f" {error.filename}" if error.filename else ""
        print(f"error: cannot use{where}: {error.strerror or error}", file=sys.stderr)
        sys.exit(2)
