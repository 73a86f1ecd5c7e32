"""Tables of text: rows under headings, with the best cells marked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from salframe.evaluation.tables.columns import INPUT, Column, RowT, TableRow
from salframe.evaluation.tables.text import NONE

METHOD = "method"
"""Heading of the column of methods. Columns before it name the data."""


@dataclass(frozen=True, eq=False)
class Table:
    """A table of text.

    Attributes:
        headings: Heading of each column. A line break may be printed as a space.
        rows: The cells of each row.
        best: (row, column) of the best cells.
        costs: Indices of the columns with times, sizes or memory.
        leading: Number of columns at the left that name the row.
        title: Title of the table.
    """

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
        leading: The columns to the left of `columns`: for each heading, the texts of all rows. None: one column with
            the titles of the methods.
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
    """Return the titles of the rows' methods as a leading column."""
    return {METHOD: [row.title for row in rows]}


def select_leading(
    leading: Mapping[str, Sequence[str]] | None, rows: Sequence[TableRow], selected: Sequence[TableRow]
) -> dict[str, list[str]]:
    """Return the leading columns with the cells of the selected rows only."""
    return {
        heading: [text for text, row in zip(texts, rows, strict=True) if any(row is one for one in selected)]
        for heading, texts in (leading_methods(rows) if leading is None else leading).items()
    }


def _alike(leading: Mapping[str, Sequence[str]], count: int) -> list[list[int]]:
    """Return groups of comparable rows: rows with the same texts in all columns before the method."""
    names = list(leading)
    leading_texts = [leading[name] for name in names[: names.index(METHOD)]] if METHOD in names else []
    groups: dict[tuple[str, ...], list[int]] = {}
    for i in range(count):
        groups.setdefault(tuple(texts[i] for texts in leading_texts), []).append(i)
    return list(groups.values())


def _best(column: Column[RowT], rows: Sequence[RowT], alike: Sequence[int]) -> list[int]:
    """Return the indices of the best rows among `alike`. Empty if all numbers are equal."""
    values = {
        i: value for i in alike if column.value and rows[i].measured and (value := column.value(rows[i])) is not None
    }
    if len(set(values.values())) < 2:
        return []
    top = max(values.values()) if column.larger_is_better else min(values.values())
    return [i for i, value in values.items() if value == top]


def split_table(table: Table, fits: Callable[[Table], bool]) -> list[Table]:
    """Split a table into tables with all of its rows, each with as many columns as `fits` accepts.

    Columns of costs (times, sizes, memory) are in separate tables. A table that fits is returned unchanged.
    """
    if fits(table):
        return [table]
    left, columns = list(range(table.leading)), range(table.leading, len(table.headings))
    parts: list[Table] = []
    for costs in (False, True):
        selected: list[int] = []
        for j in (j for j in columns if (j in table.costs) == costs):
            if selected and not fits(_select_columns(table, [*left, *selected, j])):
                parts.append(_select_columns(table, [*left, *selected]))
                selected = []
            selected.append(j)
        parts += [_select_columns(table, [*left, *selected])] if selected else []
    return parts


def narrow_table(table: Table, max_columns: int) -> tuple[Table, list[str]]:
    """Return a table with at most `max_columns` columns, and the headings of the columns that were left out.

    The columns that name the rows and at least one other column stay. The column of inputs is left out first, then the
    columns at the right.
    """
    columns = range(table.leading, len(table.headings))
    if len(table.headings) <= max_columns:
        return table, []
    measured = [j for j in columns if table.headings[j] != INPUT.heading]
    selected = [*range(table.leading), *measured[: max(max_columns - table.leading, 1)]]
    return _select_columns(table, selected), [table.headings[j] for j in columns if j not in selected]


def _select_columns(table: Table, selected: Sequence[int]) -> Table:
    rows = [[row[j] for j in selected] for row in table.rows]
    best = frozenset((i, selected.index(j)) for i, j in table.best if j in selected)
    return replace(table, headings=[table.headings[j] for j in selected], rows=rows, best=best)
