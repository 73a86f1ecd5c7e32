"""Results as tables in the terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from salframe.evaluation.detection import Counts, DetectionRow
    from salframe.evaluation.localization import LocalizationRow
    from salframe.evaluation.matching import MatchingRow
    from salframe.evaluation.navigation import NavigationRow
    from salframe.evaluation.reported import Reported
    from salframe.evaluation.result import Result
    from salframe.evaluation.sensor import SensorMeasurement


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


def print_result(result: Result[Any]) -> None:
    """The table of whatever task a result is of."""
    tables: dict[str, Callable[[Result[Any]], None]] = {
        "localization": print_comparison,
        "matching": print_matching,
        "detection": print_detection,
        "navigation": print_navigation,
    }
    tables[result.task](result)


def print_comparison(result: Result[LocalizationRow]) -> None:
    """The table of a comparison, what its columns do not say in notes below, and where the report lies.

    Where the table is too wide for the terminal, what the methods cost is a table of its own.
    """
    console = _console()
    whole = _table(result.rows, sorted(REACHED + COSTS))
    fits = console.measure(whole, options=console.options.update(width=1000)).maximum <= console.width
    for table in [whole] if fits else [_table(result.rows, REACHED), _table(result.rows, COSTS)]:
        console.print(table)
    _print_worth(result.rows)
    _print_notes(result, statuses=True)
    for paper in result.reported:
        console.print(_reported(paper))
        console.print(f"{paper.source}. {paper.note}", style="dim", markup=False, highlight=False)
    _print_where(result)


def _print_worth(rows: Sequence[LocalizationRow]) -> None:
    """A table of what answers know of their own worth, where queries are asked of a map without their place."""
    told = [row for row in rows if row.absent_queries]
    if not told:
        return
    headings = (
        "place in the map or not",
        "in the map:\nright %",
        "not in it:\ndenied %",
        "ROC\narea",
        "not in it: accepted %\nat 90 % of right kept",
        "calibration\nerror",
    )
    print_table(
        headings,
        [
            [
                row.method,
                _percent(row.present_accuracy),
                _percent(row.denied_absent),
                _fixed(row.roc_area, 3),
                _percent(row.accepted_absent),
                _fixed(row.calibration_error, 3),
            ]
            for row in told
        ],
    )


def print_matching(result: Result[MatchingRow]) -> None:
    """A table of the methods that match points, another of those that match nodes, and notes below."""
    points, nodes = ([row for row in result.rows if row.kind == kind] for kind in ("points", "nodes"))
    if points:
        headings = ("points", "MMA@1 %", "MMA@3 %", "MMA@5 %", "matches\na pair", "pairs without\na match")
        print_table(
            headings,
            [
                [
                    row.method,
                    *map(_percent, (row.mma_1, row.mma_3, row.mma_5)),
                    _fixed(row.matches_per_pair, 0),
                    f"{row.pairs_without_match} of {row.pairs}",
                ]
                for row in points
            ],
        )
    if nodes:
        headings = ("nodes", "precision %", "recall %", "matches\na pair", "true\na pair", "pairs")
        print_table(
            headings,
            [
                [
                    row.method,
                    _percent(row.precision),
                    _percent(row.recall),
                    _fixed(row.matches_per_pair, 1),
                    _fixed(row.true_per_pair, 1),
                    str(row.pairs),
                ]
                for row in nodes
            ],
        )
    _print_notes(result)
    _print_where(result)


def print_detection(result: Result[DetectionRow], classes: bool = False) -> None:
    """A table of the detectors, one of the classes of each where wanted, and notes below."""
    from salframe.evaluation.detection import NEAR_M

    headings = ("precision %", "recall %", "annotated", "found", "right")
    measured = [row for row in result.rows if row.measured]
    if measured:
        print_table(
            ("detector", *headings, "ms"), [[row.method, *_counts(row.overall), _fixed(row.ms, 0)] for row in measured]
        )
    for row in measured if classes else ():
        print_table((row.method, *headings), [[label, *_counts(counts)] for label, counts in row.classes.items()])
    _print_notes(result)
    print(f"right: an annotated object of the same label has its centroid within {NEAR_M} m")
    joined = {label: name for row in measured for label, name in row.joined.items()}
    if joined:
        _console().print(
            "one label in the shared vocabulary: "
            + ", ".join(f"{label} = {name}" for label, name in sorted(joined.items())),
            style="dim",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )
    _print_where(result)


def print_sensor(measured: SensorMeasurement) -> None:
    """What a detector finds by size, range and what hides it, beside what the model says, and the rest in lines."""
    headings = ("objects", "annotated", "found %", "model %", "found by its\nright name %")
    rows = [
        [line.by, str(line.objects), *map(_percent, (line.found, line.modelled, line.right))]
        for line in measured.lines
        if line.objects
    ]
    print_table(headings, rows)
    sensor = measured.sensor
    false, errors = sensor.false_objects, sensor.errors
    renamed = {
        f"{label} as {said}": count
        for label, row in sensor.confusion.items()
        for said, count in row.items()
        if said != label
    }
    lines = [
        f"called otherwise: {_commonest(renamed)}",
        f"false objects: {false.per_panorama:.1f} a panorama: {_commonest(false.labels)}",
        f"errors, robust standard deviation: bearing {math.degrees(errors.bearing_rad):.2f} deg, "
        f"range {errors.range_share * 100:.1f} %, size {errors.size_log * 100:.0f} %, "
        f"height {errors.height_m * 100:.1f} cm",
        f"{sensor.provenance.panoramas} panoramas of {', '.join(sensor.provenance.data)}; model %: the mean of what "
        "the fitted model says of the same objects",
    ]
    for line in lines:
        _console().print(line, markup=False, highlight=False, soft_wrap=True)


def _commonest(counts: Mapping[str, int]) -> str:
    """The eight commonest of what was counted."""
    order = sorted(counts.items(), key=lambda entry: (-entry[1], entry[0]))
    return ", ".join(f"{name} {count}" for name, count in order[:8]) or "none"


def print_navigation(result: Result[NavigationRow]) -> None:
    """The table of a navigation run, notes below, and where the report lies."""
    headings = (
        "method",
        "SR %\n(95 %)",
        "oracle\nSR %",
        "SPL %\n(95 %)",
        "SR within\n3 m %",
        "path\nm",
        "panoramas",
        "collisions",
        "p",
    )
    rows = [
        [
            row.method,
            _interval(row.success_rate, row.success_rate_low, row.success_rate_high),
            _percent(row.oracle_success_rate),
            _interval(row.spl, row.spl_low, row.spl_high),
            _percent(row.success_rate_3m),
            *(_fixed(value, 1) for value in (row.path_m, row.panoramas, row.collisions)),
            "" if row.p_value is None else f"{row.p_value:.2g}",
        ]
        for row in result.rows
    ]
    print_table(headings, rows)
    _print_notes(result)
    _print_where(result)


def _print_notes(result: Result[Any], statuses: bool = False) -> None:
    """What tables do not say: notes, reasons, and how often each failure occurred where that is wanted."""
    console, notes = _console(), list(result.notes)
    for row in result.rows:
        failures = ", ".join(f"{count} {status}" for status, count in row.status.items() if status != "ok")
        if remarks := "; ".join(part for part in (row.remark, failures if statuses else "") if part):
            notes.append(f"{row.method}: {remarks}")
    for note in notes:
        console.print(note, style="dim", markup=False, highlight=False, soft_wrap=True)


def _print_where(result: Result[Any]) -> None:
    where = f"run: {result.run}" if result.report is None else f"report: {result.report}"
    _console().print(where, markup=False, highlight=False, soft_wrap=True)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{share * 100:.1f}"


def _fixed(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _interval(share: float | None, low: float | None, high: float | None) -> str:
    if share is None or low is None or high is None:
        return "-"
    return f"{share * 100:.1f} ({low * 100:.0f}-{high * 100:.0f})"


def _counts(counts: Counts | None) -> list[str]:
    if counts is None:
        return ["-"] * 5
    numbers = (counts.annotated, counts.found, counts.right)
    return [_percent(counts.precision), _percent(counts.recall), *map(str, numbers)]


def _table(rows: Sequence[LocalizationRow], columns: Sequence[int]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("method", overflow="fold")
    for column in columns:
        table.add_column(HEADINGS[column], justify="right", no_wrap=True)
    for row in rows:
        label = escape(row.method.replace("[", "\n  [").replace(",", ",\n   "))
        if row.measured:
            cells = _cells(row)
            table.add_row(label, *(cells[column] for column in columns))
        else:
            table.add_row(label, "-", style="dim")
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


def _cells(row: LocalizationRow) -> list[str]:
    pose = "-"
    if row.median_translation_m is not None and row.median_rotation_deg is not None:
        turn_deg = row.median_rotation_deg
        pose = f"{row.median_translation_m:.2f} m {turn_deg:.{1 if turn_deg < 10 else 0}f}°"
    elif row.median_heading_deg is not None:
        pose = f"{row.median_heading_deg:.1f}°"
    recalls = (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg)
    known = [f"{recall * 100:.0f}" for recall in recalls if recall is not None]
    return [
        _interval(row.accuracy, row.accuracy_low, row.accuracy_high),
        "-" if row.recall_at_5 is None else f"{row.recall_at_5 * 100:.0f}",
        pose,
        "/".join(known) or "-",
        format_bytes(row.bytes_per_scene),
        _digits(row.describe_ms),
        _digits(row.query_ms),
        "" if row.p_value is None else f"{row.p_value:.2g}",
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
