"""The role `tracker`: estimates the pose of a moving camera from answers of a localizer and odometry."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.component import Role
from salframe.framework.errors import InvalidAnswer
from salframe.localization.answers import RIGID_TOLERANCE, Localization
from salframe.panoramas.geometry import is_rigid


class TrackStatus(StrEnum):
    """Whether a tracker knows the pose of the camera. LOST: it does not know the pose. OUT_OF_MAP: the camera is
    probably outside of the map."""

    TRACKING = "tracking"
    LOST = "lost"
    OUT_OF_MAP = "out-of-map"


@dataclass(frozen=True, eq=False)
class TrackedPose:
    """The belief of a tracker: its present estimate. Use place and pose only if the status is TRACKING.

    Attributes:
        status: Whether the tracker knows the pose.
        place: Name of the place; None before the first answer with a pose. With the status LOST or OUT_OF_MAP, place
            and pose are only the best guess.
        T_world_pano: (4, 4) float64 pose of the camera, a rigid motion; None where `place` is None.
        covariance: (3, 3) float64 covariance of (x_m, y_m, yaw_rad), in the axes of the world; None if it is unknown or
            there is no pose.
        support: Evidence for the pose, not negative; larger is better. Its unit depends on the tracker.

    Raises:
        InvalidAnswer: In any of these cases: the status is not a TrackStatus; the status is TRACKING and there is no
            pose; only one of place and pose is None; the pose is not a rigid motion; the covariance has another shape,
            or is not finite, symmetric and positive semidefinite; the support is negative or NaN.
    """

    status: TrackStatus
    place: str | None = None
    T_world_pano: np.ndarray | None = None
    covariance: np.ndarray | None = None
    support: float = 0.0

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "status", TrackStatus(self.status))
        except ValueError:
            statuses = ", ".join(TrackStatus)
            raise InvalidAnswer(f"a TrackedPose has the status {self.status!r}, expected one of {statuses}") from None
        if (self.place is None) != (self.T_world_pano is None):
            received = "no T_world_pano" if self.T_world_pano is None else "a T_world_pano"
            raise InvalidAnswer(
                f"a TrackedPose has the place {self.place!r} and {received}, expected place and T_world_pano, or None "
                "for both"
            )
        if self.T_world_pano is None and self.status is TrackStatus.TRACKING:
            raise InvalidAnswer(
                f"a TrackedPose with the status {self.status} has no T_world_pano, expected place and T_world_pano"
            )
        if self.T_world_pano is not None and not is_rigid(self.T_world_pano, RIGID_TOLERANCE):
            received = " ".join(str(np.asarray(self.T_world_pano).tolist()).split())[:200]
            raise InvalidAnswer(f"T_world_pano of a TrackedPose is {received}, expected a rigid motion (4, 4) or None")
        if self.covariance is not None:
            covariance = check_array(self, "covariance", np.float64, 3, 3, error=InvalidAnswer)
            if not (np.isfinite(covariance).all() and np.allclose(covariance, covariance.T)) or (
                np.linalg.eigvalsh(covariance)[0] < -1e-9
            ):
                raise InvalidAnswer(
                    f"a TrackedPose has the covariance {covariance.tolist()}, expected a finite, symmetric, "
                    "positive semidefinite matrix"
                )
        if not self.support >= 0:
            raise InvalidAnswer(f"a TrackedPose has the support {self.support}, expected a number of at least 0")


class Tracker(Role):
    """Tracks the pose of a moving camera. It combines odometry with a localizer's answers to the images of the camera.

    Call `move` with the motion from the previous query to the present query, then `observe` with the answer to the
    present query. If the camera moves while the answer is computed, pass this motion to `move` after `observe`. A
    tracker holds the belief on one camera. `open_tracker` creates a tracker for a map.
    """

    role = "tracker"
    find_place: Callable[[np.ndarray], str] | None = None
    """Function that returns the name of the place at a position (3,). `open_tracker` sets it. None: the place of an
    answer is used."""

    @abstractmethod
    def move(self, odometry: np.ndarray | None) -> None:
        """Update the belief by a motion.

        Args:
            odometry: (4, 4) rigid motion: the pose of the camera after the motion, in the camera frame before the
                motion. None if the motion is unknown, for example because odometry messages were lost.

        Raises:
            DataError: The motion is not rigid.
        """

    @abstractmethod
    def observe(self, answer: Localization) -> None:
        """Update the belief by the answer to a query at the present pose. Pass failed answers too: a failure is also
        evidence."""

    @abstractmethod
    def belief(self) -> TrackedPose:
        """Return the belief on the present pose. Does not change the tracker."""
