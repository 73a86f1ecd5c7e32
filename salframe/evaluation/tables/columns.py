"""Columns of tables: a heading, and the text and the number of a row's cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.text import NONE, fixed, format_bytes, interval, percent, two_digits


class TableRow(Protocol):
    """A row of a table: the title and the input of a method, and whether it was measured."""

    @property
    def title(self) -> str: ...
    @property
    def input(self) -> tuple[str, ...]: ...
    @property
    def by_part(self) -> tuple[float, ...]: ...
    @property
    def measured(self) -> bool: ...


RowT = TypeVar("RowT", bound=TableRow, contravariant=True)


@dataclass(frozen=True)
class Column(Generic[RowT]):
    """A column of a table.

    Args:
        heading: Text above the column. A line break may be printed as a space.
        cell: Returns the text of a row in this column.
        value: Returns the number by which rows are ranked. None: the column does not rank rows.
        larger_is_better: Whether the largest number is the best. Otherwise the smallest number is the best.
        cost: Whether the column shows a time, a size or memory.
        unmeasured: Whether `cell` is also called for rows of methods that were not measured.
    """

    heading: str
    cell: Callable[[RowT], str]
    value: Callable[[RowT], float | None] | None = None
    larger_is_better: bool = True
    cost: bool = False
    unmeasured: bool = False


INPUT: Column[TableRow] = Column(
    "input", lambda row: ", ".join(row.input).replace("rgb", "colour") or NONE, unmeasured=True
)
"""Column with the parts of panoramas that a method received as input."""
SEED_RANGE: Column[TableRow] = Column("per-seed\nrange %", lambda row: _spread(row.by_part))
"""Column with the per-seed range: minimum and maximum, over the seeds of the data, of the main measure of a row."""


def _spread(shares: Sequence[float]) -> str:
    return f"{min(shares) * 100:.0f}-{max(shares) * 100:.0f}" if shares else NONE


def share_column(heading: str, get: Callable[[RowT], float | None], *, larger_is_better: bool = True) -> Column[RowT]:
    """Return a table column of shares as percent. `get` returns the share of a row, from 0 to 1; None: unknown."""
    return Column(heading, lambda row: percent(get(row)), get, larger_is_better)


def rate_column(heading: str, get: Callable[[RowT], Estimate | None], *, larger_is_better: bool = True) -> Column[RowT]:
    """Return a table column of shares as percent with their 95 % confidence intervals. `get` returns the share of a
    row, from 0 to 1; None: unknown."""
    return Column(heading, lambda row: interval(get(row)), _value_of(get), larger_is_better)


def number_column(heading: str, get: Callable[[RowT], float | None], digits: int) -> Column[RowT]:
    """Return a table column of numbers with this number of decimals. `get` returns the number of a row; None:
    unknown."""
    return Column(heading, lambda row: fixed(get(row), digits))


def count_column(heading: str, get: Callable[[RowT], int | None]) -> Column[RowT]:
    """Return a table column of counts. `get` returns the count of a row; None: unknown."""
    return Column(heading, lambda row: str(get(row)))


def cost_column(heading: str, get: Callable[[RowT], float | None], digits: int | None = None) -> Column[RowT]:
    """Return a table column of costs (times, sizes or memory), which `get` returns for a row. `digits` is the number of
    decimals; None: two significant digits."""
    return Column(heading, lambda row: two_digits(get(row)) if digits is None else fixed(get(row), digits), cost=True)


def bytes_column(heading: str, get: Callable[[RowT], float | None]) -> Column[RowT]:
    """Return a table column of sizes. `get` returns the size of a row in bytes; None: unknown."""
    return Column(heading, lambda row: format_bytes(get(row)), cost=True)


def p_value_column(get: Callable[[RowT], float | None]) -> Column[RowT]:
    """Return the column of adjusted p-values, empty if there is no test."""
    return Column("p\n(Holm)", lambda row: "" if (p := get(row)) is None else f"{p:.2g}")


def _value_of(get: Callable[[RowT], Estimate | None]) -> Callable[[RowT], float | None]:
    return lambda row: None if (estimate := get(row)) is None else estimate.value
