"""The table of the task `asking`: its rows and columns."""

from __future__ import annotations

from dataclasses import dataclass

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import INPUT, Column, rate_column, share_column

TOP = 5
"""Number of the best places that may contain the true place."""


@dataclass(frozen=True, kw_only=True)
class AskingRow(MethodRow):
    """The row of a method.

    Shares are relative to all descriptions, with their 95 % intervals, clustered by the true place. A description on
    which the method failed counts as wrong.

    Attributes:
        descriptions: Number of descriptions.
        top1: Share of descriptions for which the true place ranks first, if the search uses the whole description.
        top5: Share of descriptions for which the true place is among the first TOP.
        top1_counts: As `top1`, if the search uses labels and numbers of objects, without their order.
        top5_counts: As `top5`, if the search uses labels and numbers of objects, without their order.
        top1_labels: As `top1`, if the search uses only labels.
        top5_labels: As `top5`, if the search uses only labels.
        chance1: Expected `top1` of random answers.
        chance5: Expected `top5` of random answers.
        probability: Mean probability of the first place. It equals `top1` if the probabilities are calibrated.
    """

    descriptions: int
    top1: Estimate | None = None
    top5: Estimate | None = None
    top1_counts: Estimate | None = None
    top5_counts: Estimate | None = None
    top1_labels: Estimate | None = None
    top5_labels: Estimate | None = None
    chance1: float | None = None
    chance5: float | None = None
    probability: float | None = None

    @property
    def measured(self) -> bool:
        return self.top1 is not None


COLUMNS: dict[str, Column[AskingRow]] = {
    "input": INPUT,
    "descriptions": Column("descriptions", lambda row: str(row.descriptions)),
    "top1": rate_column("R@1 %\n(95 % CI)", lambda row: row.top1),
    "top1_counts": rate_column("R@1 %, labels\nand numbers", lambda row: row.top1_counts),
    "top1_labels": rate_column("R@1 %,\nlabels alone", lambda row: row.top1_labels),
    "chance1": share_column("R@1 %,\nchance", lambda row: row.chance1),
    "top5": rate_column("R@5 %\n(95 % CI)", lambda row: row.top5),
    "top5_counts": rate_column("R@5 %, labels\nand numbers", lambda row: row.top5_counts),
    "top5_labels": rate_column("R@5 %,\nlabels alone", lambda row: row.top5_labels),
    "chance5": share_column("R@5 %,\nchance", lambda row: row.chance5),
    "probability": share_column("mean\nprobability %", lambda row: row.probability),
}
DEFAULT_COLUMNS = tuple(COLUMNS)
