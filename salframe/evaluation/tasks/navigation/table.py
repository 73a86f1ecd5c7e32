"""The table of the task `navigation`: its rows and columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import (
    INPUT,
    SEED_RANGE,
    Column,
    number_column,
    p_value_column,
    rate_column,
    share_column,
)
from salframe.evaluation.tables.table import Table, draw_table, select_leading
from salframe.evaluation.tables.text import fixed


@dataclass(frozen=True, kw_only=True)
class NavigationRow(MethodRow):
    """The row of a method.

    Rates are over all episodes, with 95 % intervals. A crashed episode counts as a failure. Other means are over the
    episodes that did not crash.

    Attributes:
        episodes: Number of episodes.
        success_rate: Share of the episodes in which the agent stopped near the goal.
        oracle_success_rate: Share of the episodes in which the agent was near the goal at any time.
        spl: Mean success weighted by path length.
        success_rate_1m: Share of the episodes in which the agent stopped within 1 m of the goal.
        success_rate_3m: Share of the episodes in which the agent stopped within 3 m of the goal.
        path_m: Mean length of the path in metres.
        panoramas: Mean number of panoramas of an episode.
        collisions: Mean number of collisions of an episode.
        p_value: p-value of the exact paired test of success against the first measured method, clustered by goal.
        p_adjusted: This p-value after Holm's adjustment.
        scores: Metrics of a benchmark by name, averaged over data sets.
    """

    episodes: int
    success_rate: Estimate | None = None
    oracle_success_rate: Estimate | None = None
    spl: Estimate | None = None
    success_rate_1m: Estimate | None = None
    success_rate_3m: Estimate | None = None
    path_m: float | None = None
    panoramas: float | None = None
    collisions: float | None = None
    p_value: float | None = None
    p_adjusted: float | None = None
    scores: Mapping[str, float] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        return self.success_rate is not None


def _value_column(heading: str, get: Callable[[NavigationRow], Estimate | None]) -> Column[NavigationRow]:
    """Return a column of shares without their intervals."""
    return share_column(heading, lambda row: None if (share := get(row)) is None else share.value)


COLUMNS: dict[str, Column[NavigationRow]] = {
    "input": INPUT,
    "success": rate_column("SR %\n(95 % CI)", lambda row: row.success_rate),
    "seed_range": SEED_RANGE,
    "oracle": _value_column("oracle\nSR %", lambda row: row.oracle_success_rate),
    "spl": rate_column("SPL %\n(95 % CI)", lambda row: row.spl),
    "success_1m": _value_column("SR within\n1 m %", lambda row: row.success_rate_1m),
    "success_3m": _value_column("SR within\n3 m %", lambda row: row.success_rate_3m),
    "path": number_column("path\nm", lambda row: row.path_m, 1),
    "panoramas": number_column("panoramas", lambda row: row.panoramas, 1),
    "collisions": number_column("collisions", lambda row: row.collisions, 1),
    "p": p_value_column(lambda row: row.p_adjusted),
}
DEFAULT_COLUMNS = tuple(COLUMNS)
ABOUT = (
    "SR: share of all episodes in which the agent stops at most 0.5 m from the goal. SPL: mean of success (1 or 0) x "
    "d0 / max(d0, d), where d is the distance walked and d0 the length of the shortest path along the map. p: exact "
    "paired test of SR against the first measured method of the same run, clustered by goal, adjusted by Holm's method."
)
"""Note on the columns of the table, for the HTML page."""


def score_tables(rows: Sequence[NavigationRow], leading: Mapping[str, Sequence[str]] | None = None) -> list[Table]:
    """Return the table of the metrics that a benchmark defines; none without a benchmark."""
    scored = [row for row in rows if row.scores]
    if not scored:
        return []
    columns: list[Column[NavigationRow]] = [INPUT, *map(_score_column, scored[0].scores)]
    title = "metrics of the benchmark. They are upper bounds, because the agent knows its goals"
    return [draw_table(columns, scored, select_leading(leading, rows, scored), title)]


def _score_column(name: str) -> Column[NavigationRow]:
    return Column(name, lambda row: fixed(row.scores[name], 2), lambda row: row.scores[name])
