"""Tables of text: rows under headings, with the best cells marked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from salframe.evaluation.tables.columns import Column, RowT, TableRow
from salframe.evaluation.tables.text import NONE

METHOD = "method"
"""The heading of the column that names methods. Columns before it name the data."""


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


def draw_table(
    columns: Sequence[Column[RowT]],
    rows: Sequence[RowT],
    leading: Mapping[str, Sequence[str]] | None = None,
    title: str | None = None,
) -> Table:
    """Return the rows as a table.

    Args:
        columns: The columns, from left to right.
        rows: The rows.
        leading: Text of each row by heading, left of the columns; the method's label by default.
        title: The table's title.
    """
    leading = leading_methods(rows) if leading is None else leading
    cells = [
        [*labels, *(column.cell(row) if row.measured or column.unmeasured else NONE for column in columns)]
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
    return Table(headings, cells, frozenset(best), costs, len(leading), title)


def leading_methods(rows: Sequence[TableRow]) -> dict[str, list[str]]:
    """Return the labels of the rows' methods as a leading column."""
    return {METHOD: [row.method for row in rows]}


def select_leading(
    leading: Mapping[str, Sequence[str]] | None, rows: Sequence[TableRow], selected: Sequence[TableRow]
) -> dict[str, list[str]]:
    """Return the leading columns of the selected ones of the rows."""
    return {
        heading: [text for text, row in zip(texts, rows, strict=True) if any(row is one for one in selected)]
        for heading, texts in (leading_methods(rows) if leading is None else leading).items()
    }


def _alike(leading: Mapping[str, Sequence[str]], count: int) -> list[list[int]]:
    """The rows that compare: those alike in all that stands before the method."""
    names = list(leading)
    before = [leading[name] for name in names[: names.index(METHOD)]] if METHOD in names else []
    groups: dict[tuple[str, ...], list[int]] = {}
    for i in range(count):
        groups.setdefault(tuple(texts[i] for texts in before), []).append(i)
    return list(groups.values())


def _best(column: Column[RowT], rows: Sequence[RowT], alike: Sequence[int]) -> list[int]:
    """The best of these rows, none where all that have a number have the same."""
    known = {
        i: value for i in alike if column.value and rows[i].measured and (value := column.value(rows[i])) is not None
    }
    if len(set(known.values())) < 2:
        return []
    top = max(known.values()) if column.largest else min(known.values())
    return [i for i, value in known.items() if value == top]


def split_table(table: Table, fits: Callable[[Table], bool]) -> list[Table]:
    """Return tables with the rows of a table, each with as many of its columns as `fits` accepts. Columns of costs are
    in tables of their own. A table that fits stays whole."""
    if fits(table):
        return [table]
    left, rest = list(range(table.leading)), range(table.leading, len(table.headings))
    parts: list[Table] = []
    for costs in (False, True):
        taken: list[int] = []
        for j in (j for j in rest if (j in table.costs) == costs):
            if taken and not fits(_select_columns(table, [*left, *taken, j])):
                parts.append(_select_columns(table, [*left, *taken]))
                taken = []
            taken.append(j)
        parts += [_select_columns(table, [*left, *taken])] if taken else []
    return parts


def _select_columns(table: Table, selected: Sequence[int]) -> Table:
    rows = [[row[j] for j in selected] for row in table.rows]
    best = frozenset((i, selected.index(j)) for i, j in table.best if j in selected)
    return replace(table, headings=[table.headings[j] for j in selected], rows=rows, best=best)
