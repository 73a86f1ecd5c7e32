"""The table of the task `tracking`: its rows and columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import INPUT, SEED_RANGE, Column, number_column, rate_column, share_column
from salframe.evaluation.tables.text import NONE, fixed

AFTER = (1, 2, 5, 10, 12)
"""Numbers of views after which the belief (estimated pose of the camera) is compared with the truth."""
NEAR_M = 0.5
"""Maximum error in metres of a position that counts as correct."""


@dataclass(frozen=True, kw_only=True)
class TrackingRow(MethodRow):
    """The row of a belief (estimated pose of the camera) of a method.

    Shares are relative to all walks, with 95 % intervals, clustered by the place in which a walk starts. A crashed walk
    counts as wrong.

    Attributes:
        belief: Name of the belief.
        walks: Number of walks.
        right: For each number of views in AFTER, the share of the walks whose place is correct after these views.
        right_12: The share after 12 views, with its interval.
        near: Share of the walks whose position error is at most NEAR_M after the last view.
        position_m: Median position error after the last view, with its bootstrap interval.
        heading_deg: Median heading error after the last view.
        recovered: Share of the walks in which the place is correct after at least one of the views that follow a move
            of the camera without odometry.
        right_later: Share of the walks in which the place is correct after the last view that follows this move.
        roc_area: Area under the ROC curve of the support after the last view, of walks in this building against walks
            in the map of another building.
        tracking: Share of the walks whose status is `tracking` after the last view.
        tracking_elsewhere: Share of the walks whose status is `tracking` in the map of another building.
        nees: Mean normalized squared error of (x, y, heading) after the last view, of the walks whose position error is
            at most NEAR_M. It is 3 if the covariance is correct.
    """

    belief: str
    walks: int
    right: tuple[float, ...] = ()
    right_12: Estimate | None = None
    near: Estimate | None = None
    position_m: Estimate | None = None
    heading_deg: float | None = None
    recovered: Estimate | None = None
    right_later: Estimate | None = None
    roc_area: Estimate | None = None
    tracking: Estimate | None = None
    tracking_elsewhere: Estimate | None = None
    nees: float | None = None

    @property
    def settings(self) -> Mapping[str, str]:
        return {"belief": self.belief}

    @property
    def measured(self) -> bool:
        return self.right_12 is not None


def _metres(estimate: Estimate | None) -> str:
    """Return a length with its interval in centimetre precision."""
    if estimate is None or estimate.low is None or estimate.high is None:
        return NONE if estimate is None else fixed(estimate.value, 2)
    return f"{estimate.value:.2f} ({estimate.low:.2f}-{estimate.high:.2f})"


def _after(index: int) -> Column[TrackingRow]:
    """Return the column of the share of correct places after AFTER[index] views."""
    count = AFTER[index]
    return share_column(
        f"place % after\n{count} view{'s' if count > 1 else ''}", lambda row: row.right[index] if row.right else None
    )


_ELSEWHERE: Column[TrackingRow] = rate_column(
    "tracking in another\nbuilding % (95 % CI)", lambda row: row.tracking_elsewhere
)
COLUMNS: dict[str, Column[TrackingRow]] = {
    "input": INPUT,
    "walks": Column("walks", lambda row: str(row.walks)),
    **{f"after_{count}": _after(index) for index, count in enumerate(AFTER[:-1])},
    "after_12": rate_column("place % after\n12 views (95 % CI)", lambda row: row.right_12),
    "seed_range": SEED_RANGE,
    "near": rate_column("position within\n0.5 m % (95 % CI)", lambda row: row.near),
    "position": Column(
        "position error\nm (95 % CI)",
        lambda row: _metres(row.position_m),
        lambda row: None if row.position_m is None else row.position_m.value,
        larger_is_better=False,
    ),
    "heading": number_column("heading error\ndegrees", lambda row: row.heading_deg, 1),
    "recovered": rate_column("recovered within\n8 views % (95 % CI)", lambda row: row.recovered),
    "right_later": rate_column("correct 8 views later\n% (95 % CI)", lambda row: row.right_later),
    "roc_area": rate_column("other building\nROC area % (95 % CI)", lambda row: row.roc_area),
    "tracking": rate_column("tracking %\n(95 % CI)", lambda row: row.tracking),
    "tracking_elsewhere": replace(_ELSEWHERE, larger_is_better=False),
    "nees": number_column("NEES", lambda row: row.nees, 1),
}
DEFAULT_COLUMNS = tuple(COLUMNS)
