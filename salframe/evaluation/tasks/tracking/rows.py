"""The row of the task `tracking`: one walk of a camera, with each belief (estimated pose) after each view."""

from __future__ import annotations

from pydantic import Field, model_validator

from salframe.evaluation.runs.rows import Amount, Line, PieceRow
from salframe.evaluation.tasks.tracking.walks import NUM_VIEWS


class BeliefLine(Line):
    """A belief (estimated pose of the camera) after a view, compared with the truth.

    Attributes:
        tracking: Whether the status of the belief is `tracking`.
        support: Evidence for the pose; larger is more certain.
        right: Whether the place is correct.
        position_m: Error of the position along x and y in metres; None without a pose.
        heading_deg: Error of the heading in degrees; None without a pose.
        nees: Squared error of (x, y, heading), normalized by the covariance; None without a covariance.
    """

    tracking: bool
    support: Amount
    right: bool
    position_m: Amount | None = None
    heading_deg: Amount | None = None
    nees: Amount | None = None


class BeliefRow(Line):
    """A belief (estimated pose of the camera) during a walk.

    Attributes:
        walk: The belief after each view of the walk.
        kidnapped: The belief after each view that follows a move of the camera that odometry did not measure.
        elsewhere: The belief after each view of the walk in the map of another building; empty without such a map.
    """

    walk: tuple[BeliefLine, ...] = Field(min_length=NUM_VIEWS, max_length=NUM_VIEWS)
    kidnapped: tuple[BeliefLine, ...]
    elsewhere: tuple[BeliefLine, ...]


class WalkRow(PieceRow):
    """A walk of a camera: the place where it starts, and each belief (estimated pose) by name."""

    walk: str
    start: str
    beliefs: dict[str, BeliefRow] | None = None

    @model_validator(mode="after")
    def _complete(self) -> WalkRow:
        if self.error is None and self.beliefs is None:
            raise ValueError("the result row of a walk has neither `error` nor `beliefs`, expected one of them")
        return self
