"""The role `positioner`: where one graph's frame lies in another's
(docs/explanation/method.md#from-matched-nodes-to-a-pose)."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from salframe.framework.component import Role
from salframe.framework.errors import InvalidAnswer
from salframe.panoramas.geometry import pose_yaw


class PoseStatus(StrEnum):
    """Whether there is a pose, or why not."""

    OK = "ok"
    TOO_FEW = "too-few"
    DEGENERATE = "degenerate"
    AMBIGUOUS = "ambiguous"
    INCONSISTENT = "inconsistent"
    NO_RANGE = "no-range"


@dataclass(frozen=True)
class PoseEstimate:
    """The query's frame in the reference frame.

    T_reference_query (4, 4) or None where `status` is not OK; covariance (3, 3) of (x_m, y_m, yaw_rad) for SE(2),
    (6, 6) for SE(3), or None; inliers (M,) bool over the given pairs; `runner_up` the support of the next best pose
    divided by that of this one, in [0, 1]; yaw_rad the azimuth of the query's x axis in the reference frame: the
    pose's, or of directions that tell the heading and not the position. Raises InvalidAnswer on a status that is none
    of PoseStatus.
    """

    T_reference_query: np.ndarray | None
    status: PoseStatus
    covariance: np.ndarray | None
    inliers: np.ndarray
    runner_up: float = 0.0
    yaw_rad: float | None = None

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "status", PoseStatus(self.status))
        except ValueError:
            known = ", ".join(PoseStatus)
            raise InvalidAnswer(f"a pose has the status {self.status!r}, expected one of {known}") from None
        if self.T_reference_query is not None:
            object.__setattr__(self, "yaw_rad", pose_yaw(self.T_reference_query))


class Positioner(Role):
    """Estimates where one graph's frame lies in another's from matched nodes."""

    role = "positioner"

    @abstractmethod
    def solve(self, query_m: np.ndarray, reference_m: np.ndarray, weights: np.ndarray | None = None) -> PoseEstimate:
        """Pose of the query frame in the reference frame, from matched points query_m, reference_m (M, 3) and weights
        (M,) or None (equal)."""

    def resect(self, bearing: np.ndarray, reference_m: np.ndarray) -> PoseEstimate:
        """Pose of the query frame in the reference frame, from matched directions bearing (M, 3), unit vectors in the
        query frame, and points reference_m (M, 3). A positioner that does not override this needs points: NO_RANGE."""
        return PoseEstimate(None, PoseStatus.NO_RANGE, None, np.zeros(len(bearing), bool))
