"""The `salframe` command line. Commands import their dependencies only when they run, so that `--help` is fast."""

from __future__ import annotations

import os
import re
import signal
import sys
import traceback
from collections.abc import Sequence
from functools import cached_property
from types import FrameType
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

import salframe
from salframe.cli import (
    ask,
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
    serve,
    show_objects,
    track,
    weights,
)
from salframe.cli.output import only_json, show_log
from salframe.framework.components.entry_points import COMMANDS, discover
from salframe.framework.errors import ConfigError, SalframeError, describe_error, one_line, suggest

_UsageError: Any = typer.BadParameter.__base__
"""Error for an option or argument that does not exist, is missing, or has an invalid value. Typer does not export this
class."""


class _Interrupted(Exception):
    """An interrupt by the user. It replaces KeyboardInterrupt, on which Typer would end the process itself."""


class Commands(TyperGroup):
    """The built-in commands, and the commands of plugins. Commands of plugins are loaded when they are listed or
    called.

    Contexts and commands have the annotation Any, because typer does not export their types (from click).
    """

    @cached_property
    def _plugin_commands(self) -> dict[str, Any]:
        return _load_plugin_commands()

    def list_commands(self, ctx: Any) -> list[str]:
        builtin = super().list_commands(ctx)
        return [*builtin, *sorted(set(self._plugin_commands) - set(builtin))]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        command = super().get_command(ctx, cmd_name) or self._plugin_commands.get(cmd_name)
        if command is not None:
            _tidy_help(command, ctx)
        return command

    def get_params(self, ctx: Any) -> Any:
        return _without_flag_types(super().get_params(ctx))

    def invoke(self, ctx: Any) -> None:
        """Run a command. Convert a KeyboardInterrupt, and a SystemExit of a component, to exceptions that `main`
        handles.

        Typer itself never raises SystemExit here. If a component raises it, the process would otherwise end as if the
        command had succeeded.
        """
        try:
            super().invoke(ctx)  # a plugin's command may return a value, which is not an exit status
        except KeyboardInterrupt as stop:
            raise _Interrupted from stop
        except SystemExit as stop:
            if isinstance(stop.__context__, BrokenPipeError):  # rich ends the process if stdout is a closed pipe
                raise
            if ctx.invoked_subcommand not in self.commands:  # a plugin's command may end the process
                raise
            *_, last = traceback.extract_tb(stop.__traceback__)
            where = f"the code in {last.filename}, line {last.lineno},"
            raise SalframeError(
                f"{where} ended the process ({describe_error(stop)}): raise an exception such as SalframeError instead"
            ) from stop


def _tidy_help(command: Any, ctx: Any) -> None:
    """Join the lines of each paragraph in the help of a command and its sub-commands, and hide the types of flags.

    Typer keeps the line breaks, and shows flags as `--json <bool>`.
    """
    if command.help:
        paragraphs = re.split(r"\n\s*\n", command.help)
        command.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
    _without_flag_types(command.params if ctx is None else command.get_params(ctx))
    for child in getattr(command, "commands", {}).values():
        _tidy_help(child, ctx)


def _without_flag_types(parameters: Any) -> Any:
    """Return parameters whose help shows no type if they are flags, because flags take no value."""
    for parameter in parameters:
        if getattr(parameter, "is_bool_flag", False) and parameter.metavar is None:
            parameter.metavar = ""
    return parameters


def _load_plugin_commands() -> dict[str, Any]:
    """Return the click commands of plugins by name."""
    if not discover(COMMANDS):
        return {}  # avoids importing the registry for `--help`
    from salframe.framework.components.registry import load_commands

    commands, failures = load_commands()
    for failure in failures:
        print(
            f"the commands of the plugin {failure.plugin} (package {failure.package}) failed to load: {failure.reason}",
            file=sys.stderr,
        )
    return {name: _as_click(name, command) for name, (command, _) in commands.items()}


def _as_click(name: str, command: Any) -> Any:
    """Return a plugin's function or typer app as a click command."""
    if isinstance(command, typer.Typer):
        return typer.main.get_group(command)
    wrapper = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    wrapper.command(name)(command)
    return typer.main.get_command(wrapper)


app = typer.Typer(
    cls=Commands,
    help="Localize RGB-D panoramas in buildings, and compare localization methods.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
_debug = False


def _print_version(is_requested: bool) -> None:
    if is_requested:
        print(f"salframe {salframe.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    debug: bool = typer.Option(False, "--debug", help="Show the Python traceback of an error"),
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version and exit"
    ),
) -> None:
    global _debug
    _debug = debug


PANELS: dict[str, tuple[Any, ...]] = {
    "Compare": (
        *(compare.compare, compare.ablate, compare.evaluate, report.report, experiment.experiment),
        *(matching.matching, detection.detection, navigate.navigate, score.score),
    ),
    "Maps and localization": (
        *(build.build, localize.localize, ask.ask, track.track, serve.serve, show_objects.show_objects),
        ("map", map.app),
    ),
    "Data": (("data", data.app), sensor.sensor, fit.fit, ("cache", cache.app)),
    "Plugins and installation": (
        *(inspect.methods, inspect.plugins, inspect.show, ("weights", weights.app)),
        *(inspect.doctor, docs.docs),
    ),
}
"""The commands by the panel of `salframe --help` that lists them. A group of commands is a pair of its name and its
app."""
for _panel, _commands in PANELS.items():
    for _command in _commands:
        if isinstance(_command, tuple):
            app.add_typer(_command[1], name=_command[0], rich_help_panel=_panel)
        else:
            app.command(rich_help_panel=_panel)(_command)


class _Terminated(KeyboardInterrupt):
    """A request to end the process, by SIGTERM. As for an interrupt, workers and files are closed first."""


def _terminate(signal_number: int, frame: FrameType | None) -> None:
    raise _Terminated


def main() -> None:
    """Run the command line.

    For an error that a user can cause, one line is printed on stderr, and the exit status is 2. For an interrupt, one
    line is printed, and the exit status is 130. For SIGTERM, it is 143. If the reader of the output closes the pipe,
    nothing is printed, and the exit status is 1.
    """
    signal.signal(signal.SIGTERM, _terminate)
    show_log()
    try:
        _check_arguments(sys.argv[1:])
        with only_json("--json" in sys.argv):
            status = app(standalone_mode=False)
            sys.stdout.flush()
        if status:
            sys.exit(status)
    except (KeyboardInterrupt, _Interrupted) as stop:
        print("interrupted: finished work is stored; run the same command again to resume", file=sys.stderr)
        sys.exit(143 if _Terminated in (type(stop), type(stop.__cause__)) else 130)
    except _UsageError as error:
        _fail_usage(error)
    except typer.Abort:
        _fail("aborted: the standard input ended before the question was answered")
    except SalframeError as error:
        if _debug:
            raise
        _fail(describe_error(error))
    except BrokenPipeError:  # for example `salframe plugins --json | head -1`
        _discard_stdout()
        sys.exit(1)
    except OSError as error:  # for example a full disk, or a folder without write permission
        if _debug:
            raise
        if error.filename is None:  # stdout is not writable
            _discard_stdout()
        _fail(f"cannot use {error.filename or 'the standard output'}: {error.strerror or error}")
    except MemoryError as error:
        if _debug:
            raise
        _fail(
            f"out of memory{f': {one_line(error)}' if str(error) else ''}; close other programs, or "
            "use fewer workers if the command has the option --workers"
        )


def _discard_stdout() -> None:
    """Discard the rest of the output. Otherwise Python would report at exit that stdout is not writable."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def _check_arguments(arguments: Sequence[str]) -> None:
    """Raise ConfigError if an argument is not valid UTF-8. The files of salframe can only store UTF-8 text."""
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError:
            raise ConfigError(f"the argument {argument!r} is not UTF-8 text: rename the file or folder") from None


def _fail_usage(error: Any) -> NoReturn:
    """Print a usage error in one line, and exit with status 2. If the command was called without arguments, only the
    help is printed."""
    if type(error).__name__ != "NoArgsIsHelpError":  # typer does not export it
        hint = f"; see {error.ctx.command_path} --help" if error.ctx else ""
        message = _with_suggestion(error).replace("Value error, ", "").rstrip(".")
        _fail(describe_error(ConfigError(message + hint)))
    if error.message:
        error.show()
    sys.exit(2)


def _with_suggestion(error: Any) -> str:
    """Return the message of a usage error. If a command or option does not exist, the message suggests the closest
    one, in place of the suggestions of Typer."""
    if error.ctx and hasattr(error, "possibilities"):
        options = [name for option in error.ctx.command.get_params(error.ctx) for name in option.opts]
        return error.message + suggest(error.option_name, options)
    message: str = error.format_message()
    if error.ctx and (unknown_command := re.match(r"No such command '(.*?)'", message)):
        return unknown_command[0] + suggest(unknown_command[1], error.ctx.command.list_commands(error.ctx))
    return message


def _fail(message: str) -> NoReturn:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(2)
