"""Results as tables of text: one list of columns a task, for the terminal, for print and for the report."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from salframe.evaluation.reported import Reported, ReportedTable
from salframe.evaluation.request import list_methods
from salframe.evaluation.task import MethodRow

METHOD = "method"
"""The heading of the column that names methods; what stands before it names the data."""
NONE = "-"
"""In the place of a number that there is not."""
UNITS = ("B", "kB", "MB", "GB")


@dataclass(frozen=True)
class Column:
    """A column: its heading, the text of a row's cell, and the number by which the largest (`largest`) or the least is
    best, None where no row is. `cost`: what a method costs rather than reaches."""

    heading: str
    cell: Callable[[Any], str]
    value: Callable[[Any], float | None] | None = None
    largest: bool = True
    cost: bool = False


@dataclass(frozen=True, eq=False)
class Table:
    """Text in rows, under headings; a line break in a heading may be a space. best: (row, column) of the best cells;
    costs: columns that say what methods cost; leading: so many columns at the left name the row."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    best: frozenset[tuple[int, int]] = frozenset()
    costs: frozenset[int] = frozenset()
    leading: int = 1
    title: str | None = None


def percent(share: float | None) -> str:
    """A share as percent to one decimal."""
    return NONE if share is None else f"{share * 100:.1f}"


def fixed(value: float | None, digits: int) -> str:
    """A number with so many decimals."""
    return NONE if value is None else f"{value:.{digits}f}"


def interval(share: float | None, low: float | None, high: float | None) -> str:
    """A share and its interval as percent."""
    if share is None or low is None or high is None:
        return NONE
    return f"{share * 100:.1f} ({low * 100:.0f}-{high * 100:.0f})"


def format_bytes(size: float | None) -> str:
    """A number of bytes in decimal units."""
    if size is None:
        return NONE
    power = min(int(math.log(max(size, 1), 1000)), 3)
    value = size / 1000**power
    return f"{value:.1f} {UNITS[power]}" if power and value < 10 else f"{value:.0f} {UNITS[power]}"


def two_digits(value: float | None) -> str:
    """Two significant digits, all of those before the point."""
    return NONE if value is None else f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _given(row: Any) -> str:
    return ", ".join(row.given).replace("rgb", "colour") or NONE


def _pose(row: Any) -> str:
    if row.median_translation_m is not None and row.median_rotation_deg is not None:
        turn_deg = row.median_rotation_deg
        return f"{row.median_translation_m:.2f} m {turn_deg:.{1 if turn_deg < 10 else 0}f}°"
    return NONE if row.median_heading_deg is None else f"{row.median_heading_deg:.1f}°"


def _within(row: Any) -> str:
    recalls = (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg)
    return "/".join(f"{recall * 100:.0f}" for recall in recalls if recall is not None) or NONE


def _precision_at(row: Any) -> str:
    shares = ("" if share is None else f"{share * 100:.0f}" for share in row.precision_at or ())
    return "/".join(share or NONE for share in shares) or NONE


def _spread(shares: Sequence[float]) -> str:
    return f"{min(shares) * 100:.0f}-{max(shares) * 100:.0f}" if shares else NONE


def _p(row: Any) -> str:
    return "" if row.p_adjusted is None else f"{row.p_adjusted:.2g}"


def _share(heading: str, name: str, largest: bool = True) -> Column:
    return Column(heading, lambda row: percent(getattr(row, name)), lambda row: getattr(row, name), largest)


def _rate(heading: str, name: str) -> Column:
    names = (name, f"{name}_low", f"{name}_high")
    return Column(heading, lambda row: interval(*(getattr(row, key) for key in names)), lambda row: getattr(row, name))


def _area(heading: str, name: str) -> Column:
    def cell(row: Any) -> str:
        area, low, high = (getattr(row, key) for key in (name, f"{name}_low", f"{name}_high"))
        return fixed(area, 3) if low is None or high is None else f"{area:.3f} ({low:.2f}-{high:.2f})"

    return Column(heading, cell, lambda row: getattr(row, name))


def _number(heading: str, name: str, digits: int) -> Column:
    return Column(heading, lambda row: fixed(getattr(row, name), digits))


def _count(heading: str, name: str) -> Column:
    return Column(heading, lambda row: str(getattr(row, name)))


def _overall(heading: str, name: str) -> Column:
    return Column(heading, lambda row: str(getattr(row.overall, name, NONE)))


def _overall_rate(heading: str, name: str) -> Column:
    def cell(row: Any) -> str:
        return interval(getattr(row.overall, name, None), getattr(row, f"{name}_low"), getattr(row, f"{name}_high"))

    return Column(heading, cell, lambda row: getattr(row.overall, name, None))


GIVEN = Column("given", _given)
SEEDS = Column("of each\nseed %", lambda row: _spread(row.by_part))
P = Column("p\n(Holm)", _p)

COLUMNS: dict[str, dict[str, Column]] = {
    "localization": {
        "given": GIVEN,
        "accuracy": _rate("accuracy %\n(95 %)", "accuracy"),
        "seeds": SEEDS,
        "scenes": _share("scenes\nonly %", "scene_accuracy"),
        "macro_precision": _share("macro\nprecision %", "macro_precision"),
        "macro_recall": _share("macro\nrecall %", "macro_recall"),
        "room_type": _rate("room type %\n(95 %)", "room_type_accuracy"),
        "recall_at_2": _share("R@2\n%", "recall_at_2"),
        "recall_at_5": _share("R@5\n%", "recall_at_5"),
        "pose": Column("median\npose error", _pose),
        "heading": _number("median\nheading error deg", "median_heading_deg", 1),
        "within": Column("pose within\n.25/.5/1 m %", _within),
        "present_accuracy": _rate("in the map:\nright % (95 %)", "present_accuracy"),
        "present_scenes": _share("scenes\nonly %", "present_scene_accuracy"),
        "denied_absent": _rate("not in it:\ndenied % (95 %)", "denied_absent"),
        "precision_at": Column("precision % at\nrecall 50/75/90 %", _precision_at),
        "average_precision": _area("average\nprecision", "average_precision"),
        "roc_area": _area("ROC\narea", "roc_area"),
        "accepted_absent": _share("not in it: accepted %\nat 90 % of right kept", "accepted_absent", largest=False),
        "calibration_error": Column(
            "calibration\nerror", lambda row: fixed(row.calibration_error, 3), lambda row: row.calibration_error, False
        ),
        "bytes": Column("bytes\n/scene", lambda row: format_bytes(row.bytes_per_scene), cost=True),
        "describe": Column("describe\nms", lambda row: two_digits(row.describe_ms), cost=True),
        "query": Column("query\nms", lambda row: two_digits(row.query_ms), cost=True),
        "memory": Column("memory\nMB", lambda row: fixed(row.peak_memory_mb, 0), cost=True),
        "p": P,
    },
    "matching": {
        "given": GIVEN,
        "mma_1": _rate("MMA@1 %\n(95 %)", "mma_1"),
        "mma_3": _rate("MMA@3 %\n(95 %)", "mma_3"),
        "mma_5": _rate("MMA@5 %\n(95 %)", "mma_5"),
        "precision": _rate("precision %\n(95 %)", "precision"),
        "recall": _rate("recall %\n(95 %)", "recall"),
        "matches": _number("matches\na pair", "matches_per_pair", 1),
        "true": _number("true\na pair", "true_per_pair", 1),
        "unmatched": _count("pairs without\na match", "pairs_without_match"),
        "pairs": _count("pairs", "pairs"),
    },
    "detection": {
        "given": GIVEN,
        "precision": _overall_rate("precision %\n(95 %)", "precision"),
        "recall": _overall_rate("recall %\n(95 %)", "recall"),
        "annotated": _overall("annotated", "annotated"),
        "found": _overall("found", "found"),
        "right": _overall("right", "right"),
        "ms": Column("ms", lambda row: fixed(row.ms, 0), cost=True),
    },
    "sensor": {
        "given": GIVEN,
        "found": _rate("found %\n(95 %)", "found"),
        "right": _rate("found by the\nright name %", "right"),
        "false": _number("false objects\na panorama", "false_per_panorama", 1),
        "bearing": Column("bearing\ndeg", lambda row: fixed(math.degrees(row.bearing_rad), 2)),
        "range": Column("range\n%", lambda row: percent(row.range_share)),
        "size": Column("size\n%", lambda row: fixed(row.size_log * 100, 0)),
        "height": Column("height\ncm", lambda row: fixed(row.height_m * 100, 1)),
        "objects": _count("objects", "objects"),
        "panoramas": _count("panoramas", "panoramas"),
    },
    "navigation": {
        "given": GIVEN,
        "success": _rate("SR %\n(95 %)", "success_rate"),
        "seeds": SEEDS,
        "oracle": _share("oracle\nSR %", "oracle_success_rate"),
        "spl": _rate("SPL %\n(95 %)", "spl"),
        "success_1m": _share("SR within\n1 m %", "success_rate_1m"),
        "success_3m": _share("SR within\n3 m %", "success_rate_3m"),
        "path": _number("path\nm", "path_m", 1),
        "panoramas": _number("panoramas", "panoramas", 1),
        "collisions": _number("collisions", "collisions", 1),
        "p": P,
    },
    "scale": {
        "given": GIVEN,
        "build": Column("build\ns", lambda row: two_digits(row.build_s), cost=True),
        "memory": Column("building\nMB", lambda row: fixed(row.build_memory_mb, 0), cost=True),
        "bytes": Column("bytes\n/scene", lambda row: format_bytes(row.bytes_per_scene), cost=True),
        "open": Column("open\ns", lambda row: two_digits(row.open_s), cost=True),
        "median": Column("query\nmedian ms", lambda row: two_digits(row.query_median_ms), cost=True),
        "p95": Column("query\np95 ms", lambda row: two_digits(row.query_p95_ms), cost=True),
        "recall": _rate("R@1 %\n(95 %)", "recall_at_1"),
        "recall_both": _rate("R@1 %\nof the first 50", "recall_at_1_both"),
        "exhaustive": _rate("these by matching\nall scenes: R@1 %", "recall_at_1_exhaustive"),
    },
    "running": {
        "given": GIVEN,
        "scenes": _count("scenes", "scenes"),
        "bytes": Column("bytes\n/scene", lambda row: format_bytes(row.bytes_per_scene), cost=True),
        "open": Column("open\nms", lambda row: two_digits(row.open_s * 1e3), cost=True),
        "opened": Column("opened\nMB", lambda row: fixed(row.opened_mb, 0), cost=True),
        "first": Column("first\nms", lambda row: two_digits(row.first_ms), cost=True),
        "asked": Column("asked\nMB", lambda row: fixed(row.asked_mb, 0), cost=True),
        "describe": Column("describe\nms", lambda row: two_digits(row.describe_ms), cost=True),
        "median": Column("query\nmedian ms", lambda row: two_digits(row.query_median_ms), cost=True),
        "p95": Column("query\np95 ms", lambda row: two_digits(row.query_p95_ms), cost=True),
    },
}
"""The columns of each task by name."""

_REACHED = ("given", "accuracy", "seeds", "scenes", "recall_at_5", "pose", "within")
USUAL: dict[str, Sequence[str]] = {
    "localization": (*_REACHED, "bytes", "describe", "query", "p"),
    "points": ("given", "mma_1", "mma_3", "mma_5", "matches", "unmatched", "pairs"),
    "nodes": ("given", "precision", "recall", "matches", "true", "pairs"),
    "detection": tuple(COLUMNS["detection"]),
    "sensor": tuple(COLUMNS["sensor"]),
    "navigation": tuple(COLUMNS["navigation"]),
    "scale": tuple(COLUMNS["scale"]),
    "running": tuple(COLUMNS["running"]),
}
"""The columns that are shown unless others are asked for; matching has those of points and those of nodes."""
WORTH = [
    "present_accuracy",
    "present_scenes",
    "denied_absent",
    "precision_at",
    "average_precision",
    "roc_area",
    "accepted_absent",
    "calibration_error",
]
"""Those of a second table, where queries are asked of a map without their place."""


def tables_of(
    task: str, rows: Sequence[Any], columns: Sequence[str] = (), leading: Mapping[str, Sequence[str]] | None = None
) -> list[Table]:
    """The tables of a task's rows. `columns`: names of COLUMNS, those that are usual unless given; `leading`: what
    names the rows, text for each by heading, their method unless given. Raises KeyError on a name that is none."""
    leading = {METHOD: [row.method for row in rows]} if leading is None else leading
    if task == "sensor":
        return [_table(task, rows, columns or USUAL[task], leading), _alike_objects(rows, leading)]
    if columns:
        return [_table(task, rows, columns, leading)]
    if task == "matching":
        kinds = {kind: [row for row in rows if row.kind == kind] for kind in ("points", "nodes")}
        return [_table(task, found, USUAL[kind], _of(leading, rows, found)) for kind, found in kinds.items() if found]
    spread = any(row.by_part for row in rows)
    tables = [_table(task, rows, [name for name in USUAL[task] if spread or name != "seeds"], leading)]
    told = [row for row in rows if task == "localization" and row.absent_queries]
    if told:
        worth = _table(task, told, WORTH, _of(leading, rows, told))
        tables.append(replace(worth, title="place in the map or not"))
    scored = [row for row in rows if task == "navigation" and row.scores]
    if scored:
        by_task = _drawn([GIVEN, *map(_metric, scored[0].scores)], scored, _of(leading, rows, scored))
        tables.append(replace(by_task, title="by the task's own scorer: an upper bound, goals are known"))
    return tables


def _alike_objects(rows: Sequence[Any], leading: Mapping[str, Sequence[str]]) -> Table:
    """What detectors find of objects that are alike, beside what the model says that is fitted to it."""
    cells = [
        [*labels, name, str(line.objects), *map(percent, (line.found, line.modelled, line.right))]
        for row, *labels in zip(rows, *leading.values(), strict=True)
        for name, line in row.lines.items()
    ]
    headings = (*leading, "objects", "annotated", "found %", "the model\nsays %", "found by its\nright name %")
    return Table(headings, cells, leading=len(leading) + 1, title="by size, range and what hides them")


def _metric(name: str) -> Column:
    """The column of a metric of a published task."""
    return Column(name, lambda row: fixed(row.scores[name], 2), lambda row: row.scores[name])


def _of(leading: Mapping[str, Sequence[str]], rows: Sequence[Any], chosen: Sequence[Any]) -> dict[str, list[str]]:
    """What names those rows that were chosen."""
    return {
        heading: [text for text, row in zip(texts, rows, strict=True) if any(row is one for one in chosen)]
        for heading, texts in leading.items()
    }


def _table(task: str, rows: Sequence[Any], names: Sequence[str], leading: Mapping[str, Sequence[str]]) -> Table:
    return _drawn([COLUMNS[task][name] for name in names], rows, leading)


def _drawn(columns: Sequence[Column], rows: Sequence[Any], leading: Mapping[str, Sequence[str]]) -> Table:
    cells = [
        [*labels, *(column.cell(row) if row.measured or column is GIVEN else NONE for column in columns)]
        for row, *labels in zip(rows, *leading.values(), strict=True)
    ]
    best = {
        (i, place)
        for place, column in enumerate(columns, len(leading))
        for alike in _alike(leading, len(rows))
        for i in _best(column, rows, alike)
    }
    costs = frozenset(place for place, column in enumerate(columns, len(leading)) if column.cost)
    headings = (*leading, *(column.heading for column in columns))
    return Table(headings, cells, frozenset(best), costs, len(leading))


def _alike(leading: Mapping[str, Sequence[str]], count: int) -> list[list[int]]:
    """The rows that compare: those alike in all that stands before the method."""
    names = list(leading)
    before = [leading[name] for name in names[: names.index(METHOD)]] if METHOD in names else []
    groups: dict[tuple[str, ...], list[int]] = {}
    for i in range(count):
        groups.setdefault(tuple(texts[i] for texts in before), []).append(i)
    return list(groups.values())


def _best(column: Column, rows: Sequence[Any], alike: Sequence[int]) -> list[int]:
    """The best of these rows, none where all that have a number have the same."""
    known = {
        i: value for i in alike if column.value and rows[i].measured and (value := column.value(rows[i])) is not None
    }
    if len(set(known.values())) < 2:
        return []
    top = max(known.values()) if column.largest else min(known.values())
    return [i for i, value in known.items() if value == top]


def reported_tables(papers: Sequence[Reported]) -> list[Table]:
    """What papers report, a table each."""
    return [reported_table(part) for paper in papers for part in paper.tables]


def reported_table(part: ReportedTable) -> Table:
    """A table of a paper."""
    rows = [[method, *(f"{number:g}" for number in numbers)] for method, numbers in part.rows.items()]
    return Table(("reported, not measured", *part.figures), rows, title=part.title)


def without_detector(rows: Sequence[MethodRow]) -> str | None:
    """What must be said of the time it takes to describe a panorama: for which rows no detector ran in it."""
    given = [row.method for row in rows if row.measured and any(part.startswith("annotations") for part in row.given)]
    listed = list_methods(given, [row.method for row in rows])
    return f"describe ms: no detector ran for {listed}, which had annotations" if given else None


def to_markdown(table: Table) -> str:
    """A table in Markdown, the best cells bold."""
    lines = [f"| {' | '.join(_inline(heading) for heading in table.headings)} |", f"|{'---|' * len(table.headings)}"]
    for i, row in enumerate(table.rows):
        cells = [f"**{text}**" if (i, j) in table.best else text for j, text in enumerate(map(_inline, row))]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _inline(text: str) -> str:
    return text.replace("\n", " ").replace("|", "\\|")


_LATEX = str.maketrans(
    {
        **{mark: f"\\{mark}" for mark in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "°": r"\textdegree{}",
        "\n": " ",
    }
)


def to_latex(table: Table) -> str:
    """A table in LaTeX for the package booktabs, the best cells bold."""
    columns = "l" * table.leading + "r" * (len(table.headings) - table.leading)
    lines = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule"]
    lines += [" & ".join(text.translate(_LATEX) for text in table.headings) + r" \\", r"\midrule"]
    for i, row in enumerate(table.rows):
        cells = (text.translate(_LATEX) for text in row)
        marked = (rf"\textbf{{{text}}}" if (i, j) in table.best else text for j, text in enumerate(cells))
        lines.append(" & ".join(marked) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def to_csv(rows: Sequence[MethodRow] | Sequence[Mapping[str, Any]], leading: Sequence[Mapping[str, Any]] = ()) -> str:
    """All numbers of the rows in full, a column a field; `leading`: more columns of each row, before its own."""
    content = [row if isinstance(row, Mapping) else asdict(row) for row in rows]
    names = [name for name, value in (content[0] if content else {}).items() if not isinstance(value, dict)]
    out = io.StringIO()
    before = list(dict.fromkeys(key for one in leading for key in one))
    writer = csv.DictWriter(out, [*before, *names], extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for number, row in enumerate(content):
        joined = {
            key: "; ".join(map(str, value)) if isinstance(value, tuple | list) else value for key, value in row.items()
        }
        writer.writerow({**(leading[number] if leading else {}), **joined})
    return out.getvalue()
