"""Results as tables of text: for the terminal, for print and for the report."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from salframe.evaluation.runs.request import list_methods
from salframe.evaluation.runs.task import MethodRow
from salframe.evaluation.tables.columns import COLUMNS, GIVEN, NONE, USUAL, WORTH, Column, fixed, percent
from salframe.evaluation.tables.reported import Reported, ReportedTable

METHOD = "method"
"""The heading of the column that names methods; what stands before it names the data."""


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


def tables_of(
    task: str, rows: Sequence[Any], columns: Sequence[str] = (), leading: Mapping[str, Sequence[str]] | None = None
) -> list[Table]:
    """The tables of a task's rows. `columns`: names of COLUMNS, those that are usual unless given; `leading`: what
    names the rows, text for each by heading, their method unless given. Raises KeyError on a name that is none."""
    leading = {METHOD: [row.method for row in rows]} if leading is None else leading
    if task == "sensor":
        alike = [_alike_objects(rows, leading)] if any(row.lines for row in rows) else []
        return [_table(task, rows, columns or USUAL[task], leading), *alike]
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
