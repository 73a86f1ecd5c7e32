"""The `salframe` command. Each command imports what it needs when it runs, so that `--help` stays quick."""

from __future__ import annotations

import sys

import typer

from salframe.cli import compare, data, detection, inspect, localize, map, matching, navigate, score, weights
from salframe.framework.errors import SalframeError

app = typer.Typer(
    help="Where am I, and which way do I turn? Localization from one RGB-D panorama, and the baselines to compare with.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
_debug = False


@app.callback()
def _options(debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error.")) -> None:
    global _debug
    _debug = debug


app.command()(compare.compare)
app.command()(compare.ablate)
app.command()(compare.evaluate)
app.command()(matching.matching)
app.command()(detection.detection)
app.command()(localize.build)
app.command()(localize.localize)
app.command()(navigate.navigate)
app.command()(score.score)
app.command()(inspect.plugins)
app.command()(inspect.show)
app.command()(inspect.doctor)
app.add_typer(data.app, name="data")
app.add_typer(map.app, name="map")
app.add_typer(weights.app, name="weights")


def main() -> None:
    """Run the command line; an error that a user can cause is one line on stderr and exit status 2."""
    try:
        app()
    except SalframeError as error:
        if _debug:
            raise
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
