"""What commands print: progress on stderr, results on stdout, and with --json nothing but JSON there."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    from rich.progress import TaskID

    from salframe.evaluation.runs.task import Result
    from salframe.evaluation.studies.study import StudyResult
    from salframe.panoramas.frames import QueryFrame, ReferenceFrame
    from salframe.panoramas.opening import Progress
    from salframe.panoramas.panorama import Panorama

TABLE = "table"
"""The style of a table in the terminal."""
LINE_SECONDS = 30.0
"""Off a terminal, progress is a line this often."""

_json_out: TextIO | None = None


@contextmanager
def json_alone(wanted: bool) -> Iterator[None]:
    """Send whatever is printed to stderr, in this process and its children, but for what `print_json` prints.

    In a process of its own that stays so to the end: buffers of C libraries and what runs at exit come after this.
    Where something stands in for stdout, as in tests, it is left as it was.
    """
    global _json_out
    if not wanted:
        yield
        return
    alone = sys.stdout is sys.__stdout__
    if alone:
        sys.stdout.flush()
        _json_out = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding=sys.stdout.encoding)
        os.dup2(2, sys.stdout.fileno())
    else:
        _json_out = sys.stdout
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _json_out.flush()
        if alone:
            _json_out.close()
        _json_out = None


def print_json(value: Any) -> None:
    """Print a value as JSON on the stdout that the command was given."""
    print(json.dumps(value, indent=2), file=_json_out or sys.stdout)


def tell(line: str) -> None:
    """Print a line for the user's eyes alone: on stderr."""
    print(line, file=sys.stderr, flush=True)


def tell_units(frames: Sequence[ReferenceFrame | QueryFrame | Panorama]) -> None:
    """Tell where the ranges of frames seem to be in a wrong unit."""
    from salframe.panoramas.camera_height import units_note

    if units := units_note(frames):
        tell(f"warning: {units}")


class Bars:
    """The progress of each thing that `update` names, on stderr: a bar, or off a terminal a line now and then."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        console = Console(stderr=True)
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._bars: dict[str, TaskID] = {}
        self._counts: dict[str, tuple[int, int]] = {}
        self._last = time.monotonic()

    def update(self, what: str, done: int, total: int) -> None:
        """Set the progress of `what`."""
        if self._progress.disable:
            self._counts[what] = (done, total)
            if time.monotonic() - self._last >= LINE_SECONDS:
                self._last = time.monotonic()
                print(", ".join(self._under_way(what)), file=sys.stderr, flush=True)
            return
        if what not in self._bars:
            self._bars[what] = self._progress.add_task(what, total=total)
        self._progress.update(self._bars[what], completed=done, total=total)

    def _under_way(self, latest: str) -> list[str]:
        """How far those are that have begun and not ended, and the latest one."""
        counts = self._counts.items()
        return [f"{what} {done}/{of}" for what, (done, of) in counts if what == latest or 0 < done < of]

    def __enter__(self) -> Bars:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()


def show(
    run: Callable[[Progress], Result[Any] | StudyResult], as_json: bool, style: str = TABLE, *, details: bool = False
) -> None:
    """Run a task with its progress on stderr, print its tables in a style of `--format`, or JSON, on stdout; exit 1
    where nothing was measured or something crashed. `details`: print the tables of details too.
    """
    from salframe.cli.tables import format_result, print_result

    with Bars() as bars:
        result = run(bars.update)
    if as_json:
        print_json(result.to_json())
    elif style == TABLE:
        print_result(result, details)
    else:
        print(format_result(result, style), end="")
    if result.crashed or not result.measured:
        raise typer.Exit(1)
