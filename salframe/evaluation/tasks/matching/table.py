"""The table of the task `matching`: its rows and columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import INPUT, Column, count_column, number_column, rate_column
from salframe.evaluation.tables.table import Table, draw_table, select_leading


@dataclass(frozen=True, kw_only=True)
class MatchingRow(MethodRow):
    """The row of a method.

    An Estimate is a mean over the pairs of panoramas with its 95 % confidence interval, in which pairs are clustered by
    place. A field that does not belong to the `kind` of the matches is None.

    Attributes:
        pairs: Number of pairs of panoramas.
        kind: "points" or "nodes" (objects of graphs): what the method matches.
        matches_per_pair: Mean number of matches.
        mma_1: For points, mean matching accuracy: share of the judged matches with an error of at most 1 pixel. A match
            is judged if its point has a range and is not occluded in the reference frame.
        mma_3: The same within 3 pixels.
        mma_5: The same within 5 pixels.
        pairs_without_match: For points, number of pairs without a judged match.
        precision: For nodes, share of the matches that are correct.
        recall: For nodes, share of the objects in both graphs that are matched.
        true_per_pair: For nodes, mean number of objects in both graphs.
    """

    pairs: int
    kind: str | None = None
    matches_per_pair: float | None = None
    mma_1: Estimate | None = None
    mma_3: Estimate | None = None
    mma_5: Estimate | None = None
    pairs_without_match: int | None = None
    precision: Estimate | None = None
    recall: Estimate | None = None
    true_per_pair: float | None = None

    @property
    def measured(self) -> bool:
        return self.kind is not None


COLUMNS: dict[str, Column[MatchingRow]] = {
    "input": INPUT,
    "mma_1": rate_column("MMA@1 %\n(95 % CI)", lambda row: row.mma_1),
    "mma_3": rate_column("MMA@3 %\n(95 % CI)", lambda row: row.mma_3),
    "mma_5": rate_column("MMA@5 %\n(95 % CI)", lambda row: row.mma_5),
    "precision": rate_column("precision %\n(95 % CI)", lambda row: row.precision),
    "recall": rate_column("recall %\n(95 % CI)", lambda row: row.recall),
    "matches": number_column("matches\nper pair", lambda row: row.matches_per_pair, 1),
    "true": number_column("true matches\nper pair", lambda row: row.true_per_pair, 1),
    "unmatched": count_column("pairs without\na match", lambda row: row.pairs_without_match),
    "pairs": count_column("pairs", lambda row: row.pairs),
}
USUAL_BY_KIND: dict[str, tuple[str, ...]] = {
    "points": ("input", "mma_1", "mma_3", "mma_5", "matches", "unmatched", "pairs"),
    "nodes": ("input", "precision", "recall", "matches", "true", "pairs"),
}
"""Names of the default columns of methods that match points, and of methods that match objects ("nodes")."""
DEFAULT_COLUMNS = tuple(COLUMNS)


def tables_by_kind(rows: Sequence[MatchingRow], leading: Mapping[str, Sequence[str]] | None = None) -> list[Table]:
    """Return a table of the methods that match points, and a table of the methods that match objects."""
    tables = []
    for kind, names in USUAL_BY_KIND.items():
        selected = [row for row in rows if row.kind == kind]
        if selected:
            columns = [COLUMNS[name] for name in names]
            tables.append(draw_table(columns, selected, select_leading(leading, rows, selected)))
    return tables
