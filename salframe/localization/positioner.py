"""The role `positioner`: estimate the pose of a query in a reference frame from matched nodes
(docs/explanation/saliency-graph.md#from-matched-nodes-to-a-pose)."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from salframe.framework.component import Role
from salframe.framework.errors import InvalidAnswer
from salframe.panoramas.geometry import pose_yaw


class PoseStatus(StrEnum):
    """Whether a pose was estimated, or the reason why not.

    TOO_FEW: too few matched nodes or inliers. DEGENERATE: the arrangement of the nodes does not determine a pose.
    AMBIGUOUS: a different pose has nearly the same support. INCONSISTENT: the matches agree with no common pose.
    NO_RANGE: the method requires ranges, and the query has none.
    """

    OK = "ok"
    TOO_FEW = "too-few"
    DEGENERATE = "degenerate"
    AMBIGUOUS = "ambiguous"
    INCONSISTENT = "inconsistent"
    NO_RANGE = "no-range"


@dataclass(frozen=True)
class PoseEstimate:
    """The estimated pose of the query in the coordinate frame of the reference panorama.

    Attributes:
        T_reference_query: (4, 4) pose; None if `status` is not OK.
        status: Whether a pose was estimated, or the reason why not.
        covariance: (3, 3) covariance of (x_m, y_m, yaw_rad) for SE(2), (6, 6) for SE(3); None if it is unknown.
        inliers: (M,) bool, whether each matched pair is an inlier.
        runner_up: Support of the second best pose divided by the support of this pose, in [0, 1].
        yaw_rad: Azimuth of the x axis of the query in the frame of the reference panorama. If there is a pose, it is
            set to the yaw of the pose. It may also be known without a pose. None if it is unknown.

    Raises:
        InvalidAnswer: The status is not a PoseStatus.
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
            statuses = ", ".join(PoseStatus)
            raise InvalidAnswer(f"a pose has the status {self.status!r}, expected one of {statuses}") from None
        if self.T_reference_query is not None:
            object.__setattr__(self, "yaw_rad", pose_yaw(self.T_reference_query))


class Positioner(Role):
    """Estimates the pose of a query relative to a reference frame, from pairs of matched objects."""

    role = "positioner"

    @property
    def is_equivariant(self) -> bool:
        """Whether the pose rotates by the same angle as the query. If not, the `column_step` of the localizer is
        None."""
        return True

    @abstractmethod
    def solve(self, query_m: np.ndarray, reference_m: np.ndarray, weights: np.ndarray | None = None) -> PoseEstimate:
        """Estimate the pose of the query in the frame of the reference panorama from matched points.

        Args:
            query_m: (M, 3) points in the frame of the query, in metres.
            reference_m: (M, 3) matched points in the frame of the reference panorama, in metres.
            weights: (M,) weights of the matches; None: equal weights.
        """

    def resect(self, bearing: np.ndarray, reference_m: np.ndarray) -> PoseEstimate:
        """Estimate the pose of the query in the frame of the reference panorama from directions that are matched with
        points.

        The default returns the status NO_RANGE: override it to support queries without range.

        Args:
            bearing: (M, 3) unit vectors in the frame of the query.
            reference_m: (M, 3) matched points in the frame of the reference panorama, in metres.
        """
        return PoseEstimate(None, PoseStatus.NO_RANGE, None, np.zeros(len(bearing), bool))
