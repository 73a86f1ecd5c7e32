"""The table of the task `turning`: its rows and columns."""

from __future__ import annotations

from dataclasses import dataclass

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import INPUT, Column, count_column, rate_column


@dataclass(frozen=True, kw_only=True)
class TurnsRow(MethodRow):
    """The row of a method.

    Shares have 95 % intervals, clustered by the true place. A crashed query counts as not accepted and wrong. All
    shares except `resolved_first` are relative to the queries whose first answer is not accepted. An answer resolves a
    query if it is accepted and its place is correct.

    Attributes:
        queries: Number of queries.
        unaccepted: Number of queries whose first answer is not accepted.
        resolved_first: Share of the queries that the first answer resolves.
        resolved: Share that the answer after the suggested turn resolves. Without a suggestion, the first answer
            remains.
        resolved_random: Share that the answer after a random turn resolves.
        right_first: Share whose place is correct before a turn.
        right: Share whose place is correct after the suggested turn.
        right_random: Share whose place is correct after a random turn.
        wrong: Share that is accepted with a wrong place after the suggested turn.
        wrong_random: Share that is accepted with a wrong place after a random turn.
    """

    queries: int
    unaccepted: int | None = None
    resolved_first: Estimate | None = None
    resolved: Estimate | None = None
    resolved_random: Estimate | None = None
    right_first: Estimate | None = None
    right: Estimate | None = None
    right_random: Estimate | None = None
    wrong: Estimate | None = None
    wrong_random: Estimate | None = None

    @property
    def measured(self) -> bool:
        return self.resolved_first is not None


COLUMNS: dict[str, Column[TurnsRow]] = {
    "input": INPUT,
    "queries": Column("queries", lambda row: str(row.queries)),
    "resolved_first": rate_column("resolved without\na turn %", lambda row: row.resolved_first),
    "unaccepted": count_column("not accepted", lambda row: row.unaccepted),
    "resolved": rate_column("resolved by the\nsuggested turn %", lambda row: row.resolved),
    "resolved_random": rate_column("resolved by a\nrandom turn %", lambda row: row.resolved_random),
    "right_first": rate_column("correct place\nwithout a turn %", lambda row: row.right_first),
    "right": rate_column("correct place after\nthe suggested turn %", lambda row: row.right),
    "right_random": rate_column("correct place after\na random turn %", lambda row: row.right_random),
    "wrong": rate_column("wrong place accepted after\nthe suggested turn %", lambda row: row.wrong),
    "wrong_random": rate_column("wrong place accepted after\na random turn %", lambda row: row.wrong_random),
}
DEFAULT_COLUMNS = tuple(COLUMNS)
