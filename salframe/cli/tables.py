"""Progress bars and tables in the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

if TYPE_CHECKING:
    from salframe.evaluation.compare import Comparison
    from salframe.evaluation.reported import Reported


class Bars:
    """A progress bar on stderr for each thing that is told of."""

    def __init__(self) -> None:
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        console = Console(stderr=True)
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._tasks: dict[str, TaskID] = {}

    def update(self, what: str, done: int, total: int) -> None:
        """Set the bar of `what`, a new one where it has none yet."""
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=total)
        self._progress.update(self._tasks[what], completed=done, total=total)

    def __enter__(self) -> Bars:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()


UNITS = ("B", "kB", "MB", "GB")
HEADINGS = (
    "accuracy %\n(95 %)",
    "R@5\n%",
    "median\npose error",
    "pose within\n.25/.5/1 m %",
    "bytes\n/scene",
    "describe\nms",
    "query\nms",
    "p",
)
REACHED, COSTS = (0, 1, 2, 3, 7), (4, 5, 6)
"""Columns by their place in HEADINGS: what a method reaches, and what it costs."""


def _console() -> Console:
    """Stdout; 100 columns wide where that is a file or a pipe."""
    console = Console()
    return console if console.is_terminal else Console(width=100)


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A plain table; the first column stays on one line."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        table.add_column(heading, overflow="fold", no_wrap=heading is headings[0])
    for row in rows:
        table.add_row(*map(escape, row))
    _console().print(table)


def print_comparison(comparison: Comparison) -> None:
    """The table of a comparison, what its columns do not say in notes below, and where the report lies.

    Where the table is too wide for the terminal, what the methods cost is a table of its own.
    """
    console = _console()
    whole = _table(comparison, sorted(REACHED + COSTS))
    fits = console.measure(whole, options=console.options.update(width=1000)).maximum <= console.width
    for table in [whole] if fits else [_table(comparison, REACHED), _table(comparison, COSTS)]:
        console.print(table)
    notes = list(comparison.notes)
    for row in comparison.rows:
        failures = ", ".join(f"{count} {status}" for status, count in row["status"].items() if status != "ok")
        if said := "; ".join(part for part in (row["reason"], failures) if part):
            notes.append(f"{row['method']}: {said}")
    for note in notes:
        console.print(note, style="dim", markup=False, highlight=False)
    for paper in comparison.reported:
        console.print(_reported(paper))
        console.print(f"{paper.source}. {paper.note}", style="dim", markup=False, highlight=False)
    console.print(f"report: {comparison.report}", markup=False, highlight=False, soft_wrap=True)


def _table(comparison: Comparison, columns: Sequence[int]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("method", overflow="fold")
    for column in columns:
        table.add_column(HEADINGS[column], justify="right", no_wrap=True)
    for row in comparison.rows:
        label = escape(row["method"].replace("[", "\n  [").replace(",", ",\n   "))
        if row["accuracy"] is None:
            table.add_row(label, "-", style="dim")
        else:
            cells = _cells(row)
            table.add_row(label, *(cells[column] for column in columns))
    return table


def _reported(paper: Reported) -> Table:
    """The tables of a paper under each other, each with its figures named on its first line."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("reported, not measured", overflow="fold")
    for _ in range(max(len(part.figures) for part in paper.tables)):
        table.add_column("", justify="right", no_wrap=True)
    for part in paper.tables:
        table.add_row(escape(part.title), *map(escape, part.figures), style="bold")
        for method, numbers in part.rows.items():
            table.add_row(
                f"  {escape(method)}", *(f"{number:g}" for number in numbers), end_section=method == list(part.rows)[-1]
            )
    return table


def _cells(row: dict[str, Any]) -> list[str]:
    accuracy = f"{row['accuracy'] * 100:.1f} ({row['accuracy_low'] * 100:.0f}-{row['accuracy_high'] * 100:.0f})"
    pose = "-"
    if row["median_translation_m"] is not None:
        turn_deg = row["median_rotation_deg"]
        pose = f"{row['median_translation_m']:.2f} m {turn_deg:.{1 if turn_deg < 10 else 0}f}°"
    recalls = (row["recall_025m_2deg"], row["recall_05m_5deg"], row["recall_1m_10deg"])
    within = "-" if recalls[0] is None else "/".join(f"{recall * 100:.0f}" for recall in recalls)
    p_value = "" if row["p_value"] is None else f"{row['p_value']:.2g}"
    return [
        accuracy,
        f"{row['recall_at_5'] * 100:.0f}",
        pose,
        within,
        format_bytes(row["bytes_per_scene"]),
        _digits(row["describe_ms"]),
        _digits(row["query_ms"]),
        p_value,
    ]


def format_bytes(size: float | None) -> str:
    """A number of bytes in decimal units."""
    if size is None:
        return "-"
    power = min(int(math.log(max(size, 1), 1000)), 3)
    value = size / 1000**power
    return f"{value:.1f} {UNITS[power]}" if power and value < 10 else f"{value:.0f} {UNITS[power]}"


def _digits(value: float | None) -> str:
    """Two significant digits, all of those before the point."""
    return "-" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.2g}"
