"""Output of the commands: progress on stderr, results on stdout. With --json, only JSON is written to stdout."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    from rich.progress import TaskID

    from salframe.cli.options import Printing
    from salframe.evaluation.runs.task import AnyTask, Result
    from salframe.evaluation.studies.study import StudyResult
    from salframe.panoramas.opening import Progress

TABLE = "table"
"""Value of `--format` for tables in the terminal."""
LIST_COLUMNS = ("help",)
"""Value of `--columns` that lists the columns and runs nothing."""
LINE_SECONDS = 30.0
"""Interval in seconds between progress lines, if stderr is not a terminal."""

logged: set[str] = set()
"""Log messages that this command has printed, which are not repeated below the result."""
_json_out: TextIO | None = None


@contextmanager
def only_json(is_requested: bool) -> Iterator[None]:
    """Redirect all output except `print_json` to stderr, in this process and its child processes.

    The redirection of the real stdout is permanent, because C libraries may flush their buffers, and exit handlers may
    print, after the `with` block. If sys.stdout was replaced, for example in tests, it is restored after the block.

    Args:
        is_requested: Whether to redirect; if False, nothing is done.
    """
    global _json_out
    if not is_requested:
        yield
        return
    is_real = sys.stdout is sys.__stdout__
    if is_real:
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
        if is_real:
            _json_out.close()
        _json_out = None


def print_json(value: Any) -> None:
    """Print a value as JSON on stdout. Inside `only_json`, this is the only output on stdout."""
    print(json.dumps(value, indent=2), file=_json_out or sys.stdout)


def tell(line: str) -> None:
    """Print a message to the user on stderr."""
    print(line, file=sys.stderr, flush=True)


def warn(note: str) -> None:
    """Print a warning to the user on stderr."""
    tell(f"warning: {note}")


def show_log() -> None:
    """Print the log messages of the package on stderr."""
    import logging

    class ToUser(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            logged.add(record.getMessage())
            tell(record.getMessage())

    logged.clear()
    log = logging.getLogger("salframe")
    log.handlers, log.propagate = [ToUser()], False
    log.setLevel(logging.INFO)


class Bars:
    """Shows the progress of tasks on stderr: a bar for each task, or a line every LINE_SECONDS if stderr is not a
    terminal. The bars, or a last line after the other lines, show the final progress of each task."""

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
        self._progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._bars: dict[str, TaskID] = {}
        self._counts: dict[str, tuple[int, int]] = {}
        self._printed: dict[str, tuple[int, int]] = {}
        self._last = time.monotonic()

    def update(self, what: str, done: int, total: int) -> None:
        """Set the progress of the task `what`: the number of finished items and the total."""
        if self._progress.disable:
            self._counts[what] = (done, total)
            if time.monotonic() - self._last >= LINE_SECONDS:
                self._last = time.monotonic()
                self._print(
                    {name: counts for name, counts in self._counts.items() if name == what or 0 < counts[0] < counts[1]}
                )
            return
        if what not in self._bars:
            self._bars[what] = self._progress.add_task(what, total=total)
        self._progress.update(self._bars[what], completed=done, total=total)

    def _print(self, counts: dict[str, tuple[int, int]]) -> None:
        """Print a line with the progress of tasks, such as "render 3/12"."""
        self._printed |= counts
        print(
            ", ".join(f"{what} {done}/{total}" for what, (done, total) in counts.items()), file=sys.stderr, flush=True
        )

    def __enter__(self) -> Bars:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._progress.stop()
        rest = {what: counts for what, counts in self._counts.items() if self._printed.get(what) != counts}
        if kind is None and self._printed and rest:
            self._print(rest)


def print_columns(kinds: Iterable[type[AnyTask]], as_json: bool = False) -> None:
    """Print the columns of the tables of tasks: the name of each column for `--columns`, its heading, and whether the
    table shows it without `--columns` (a main column)."""
    from salframe.cli.tables import print_table

    columns = {
        kind.name: [
            (name, " ".join(column.heading.split()), name in kind.default_columns)
            for name, column in kind.columns.items()
        ]
        for kind in kinds
    }
    if as_json:
        fields = ("name", "heading", "main")
        print_json({task: [dict(zip(fields, one, strict=True)) for one in listed] for task, listed in columns.items()})
        return
    for task, listed in columns.items():
        print(f"columns of the task {task}:")
        print_table(
            ("name", "heading", "main column"),
            [(name, heading, "yes" if main else "") for name, heading, main in listed],
        )


def show(
    run: Callable[[Progress], Result[Any] | StudyResult],
    printing: Printing,
    kind: type[AnyTask],
    *,
    details: bool = False,
) -> None:
    """Run a task, and print its progress on stderr and its result on stdout. With `--columns help`, nothing is run, and
    the columns are printed.

    Exits with status 1 if nothing was measured or something crashed.

    Args:
        run: Function that runs the task and returns its result. It is called with the function that shows progress.
        printing: Output format of the result.
        kind: Class of the task, to check the names of the columns before the run.
        details: Whether to print the detailed tables too.
    """
    from salframe.cli.tables import format_result, print_result
    from salframe.evaluation.runs.task import check_columns

    if printing.columns == LIST_COLUMNS:
        print_columns([kind], printing.as_json)
        return
    check_columns(printing.columns, [kind])
    with Bars() as bars:
        result = run(bars.update)
    if printing.as_json:
        print_json(result.to_json())
    elif printing.style == TABLE:
        print_result(result, printing.columns, details, logged)
    else:
        print(format_result(result, printing.style, printing.columns), end="")
    if result.crashed or not result.measured:
        raise typer.Exit(1)
