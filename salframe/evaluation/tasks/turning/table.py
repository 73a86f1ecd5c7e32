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
    query if it is accepted and its place is correct. If an answer suggests no turn, it remains the answer of its query
    after all turns.

    Attributes:
        queries: Number of queries.
        unaccepted: Number of queries whose first answer is not accepted.
        resolved_first: Share of the queries that the first answer resolves.
        resolved: Share that the answer after the suggested turn resolves.
        resolved_last_view: As `resolved`, without the views before the last one of the turn.
        resolved_random: As `resolved`, for a random turn.
        right_first: Share whose place is correct before a turn.
        right: Share whose place is correct after the suggested turn.
        right_last_view: As `right`, without the views before the last one of the turn.
        right_random: As `right`, for a random turn.
        wrong: Share that is accepted with a wrong place after the suggested turn.
        wrong_last_view: As `wrong`, without the views before the last one of the turn.
        wrong_random: As `wrong`, for a random turn.
    """

    queries: int
    unaccepted: int | None = None
    resolved_first: Estimate | None = None
    resolved: Estimate | None = None
    resolved_last_view: Estimate | None = None
    resolved_random: Estimate | None = None
    right_first: Estimate | None = None
    right: Estimate | None = None
    right_last_view: Estimate | None = None
    right_random: Estimate | None = None
    wrong: Estimate | None = None
    wrong_last_view: Estimate | None = None
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
    "resolved_last_view": rate_column("resolved by its\nlast view %", lambda row: row.resolved_last_view),
    "resolved_random": rate_column("resolved by a\nrandom turn %", lambda row: row.resolved_random),
    "right_first": rate_column("correct place\nwithout a turn %", lambda row: row.right_first),
    "right": rate_column("correct place after\nthe suggested turn %", lambda row: row.right),
    "right_last_view": rate_column("correct place after\nits last view %", lambda row: row.right_last_view),
    "right_random": rate_column("correct place after\na random turn %", lambda row: row.right_random),
    "wrong": rate_column("wrong place accepted after\nthe suggested turn %", lambda row: row.wrong),
    "wrong_last_view": rate_column("wrong place accepted after\nits last view %", lambda row: row.wrong_last_view),
    "wrong_random": rate_column("wrong place accepted after\na random turn %", lambda row: row.wrong_random),
}
DEFAULT_COLUMNS = tuple(COLUMNS)
