"""Tracking by votes: the answers to single queries vote for poses, and odometry moves these poses to the present
(docs/how-to/track.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError
from salframe.localization.answers import MAX_OUT_OF_MAP_PROBABILITY, Localization
from salframe.localization.tracker import TrackedPose, Tracker, TrackStatus
from salframe.panoramas.geometry import invert_pose, is_rigid, pose_2d, pose_yaw, wrap_angle
from salframe.panoramas.view import OdometryNoise

MAX_VOTES = 20
"""Maximum number of votes that are stored. The latest votes are stored."""
SAME_POSITION_M = 0.3
"""Maximum distance in metres between two poses that count as the same pose. Their headings must agree too."""
RIGID_TOLERANCE = 1e-3
"""Tolerance of the check whether a motion is rigid."""
UNKNOWN_COVARIANCE = np.diag([0.25**2, 0.25**2, np.radians(5.0) ** 2])
"""Assumed covariance of x (m), y (m) and yaw (rad) for an answer without a covariance."""


@dataclass(frozen=True, eq=False)
class _Vote:
    """The answer to a query, moved to the present by odometry.

    Attributes:
        place: First place of the answer.
        pose: (4, 4) upright T_world_pano.
        covariance: (3, 3) covariance of (x_m, y_m, yaw_rad), including the errors of odometry.
        weight: Weight of the vote: probability of the place, or score if there is no probability.
        probability: Probability of the place; 1 from a localizer without probabilities.
    """

    place: str
    pose: np.ndarray
    covariance: np.ndarray
    weight: float
    probability: float

    def moved(self, odometry: np.ndarray, noise: OdometryNoise) -> _Vote:
        """Return the vote after a motion `odometry` (4, 4) of the camera."""
        pose = self.pose @ odometry
        x_m, y_m, _ = pose[:3, 3] - self.pose[:3, 3]
        jacobian = np.eye(3)
        jacobian[:2, 2] = -y_m, x_m
        drift_m = noise.drift_share * float(np.linalg.norm(odometry[:3, 3]))
        growth = np.diag([drift_m**2, drift_m**2, np.radians(noise.heading_drift_deg) ** 2])
        return replace(self, pose=pose, covariance=jacobian @ self.covariance @ jacobian.T + growth)


class VoteTracker(Tracker):
    """The pose that most of the recent answers agree with. Each answer is a vote for a pose.

    A vote is weighted by the probability of the answer and by its age. Odometry moves the poses of older answers to the
    present.
    """

    name = "votes"
    version = "1"

    class Config(ComponentConfig):
        fade: float = Field(
            0.7,
            ge=0,
            le=1,
            description="factor (0 to 1) that multiplies the weights of all older votes at each new answer; 1: old "
            "votes count as much as new votes",
        )
        agreement_m: float = Field(
            0.5, gt=0, description="maximum distance (m) between two poses that agree (count as the same pose)"
        )
        agreement_deg: float = Field(
            30.0,
            gt=0,
            le=180,
            description="maximum difference (degrees) between the headings of two poses that agree (count as the same "
            "pose)",
        )
        min_support: float = Field(
            0.1,
            ge=0,
            description="minimum support of the agreeing votes at which the pose counts as known. The support is the "
            "sum of the probabilities of the answers, reduced by age (see `fade`). Here, an answer without "
            "probabilities has the probability 1",
        )
        odometry: OdometryNoise = Field(
            OdometryNoise(), description="expected errors of odometry, which enlarge the covariance of the pose"
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._visited: list[np.ndarray] = []  # T_present_view of the latest observations, oldest first
        self._votes: list[_Vote | None] = []  # vote of each observation; None for an answer without a pose
        self._out_of_map: list[float | None] = []  # out-of-map probability of each observation
        self._is_moved_blindly = False

    def move(self, odometry: np.ndarray | None) -> None:
        """See Tracker.

        An unknown motion is treated as no motion, with errors as large as `agreement_m` and `agreement_deg`. The status
        is not `tracking` until the next answer.
        """
        noise = self.config.odometry
        if odometry is None:
            self._is_moved_blindly = True
            limits = np.array([self.config.agreement_m] * 2 + [np.radians(self.config.agreement_deg)])
            self._votes = [
                vote and replace(vote, covariance=vote.covariance + np.diag(limits**2)) for vote in self._votes
            ]
            return
        if not is_rigid(odometry, RIGID_TOLERANCE):
            received = " ".join(str(np.asarray(odometry).tolist()).split())[:200]
            raise DataError(f"the odometry is {received}, expected a rigid motion (4, 4), or None if it is unknown")
        motion = np.asarray(odometry, np.float64)
        x, y, z = motion[:3, 3]
        back, upright = invert_pose(motion), pose_2d(x, y, pose_yaw(motion), z)
        self._visited = [back @ pose for pose in self._visited]
        self._votes = [vote and vote.moved(upright, noise) for vote in self._votes]

    def observe(self, answer: Localization) -> None:
        near = [self._is_near_camera(pose) for pose in self._visited]
        rows = [row for row, is_here in enumerate(near) if not is_here][1 - MAX_VOTES :]
        self._visited = [*(self._visited[row] for row in rows), np.eye(4)]
        self._votes = [*(self._votes[row] for row in rows), _vote(answer)]
        self._out_of_map = [*(self._out_of_map[row] for row in rows), answer.out_of_map_probability]
        self._is_moved_blindly = False

    def belief(self) -> TrackedPose:
        fade = self.config.fade ** np.arange(len(self._votes))[::-1]
        rows = [row for row, vote in enumerate(self._votes) if vote is not None]
        votes = [vote for vote in self._votes if vote is not None]
        if not votes:
            return TrackedPose(self._failure(fade))
        weight = fade[rows] * np.array([vote.weight for vote in votes])
        position_m = np.array([vote.pose[:3, 3] for vote in votes])
        yaw_rad = np.array([pose_yaw(vote.pose) for vote in votes])
        turn_rad = wrap_angle(yaw_rad[:, None] - yaw_rad)  # from column to row
        agree = np.linalg.norm(position_m[:, None] - position_m, axis=2) <= self.config.agreement_m
        agree &= np.abs(turn_rad) <= np.radians(self.config.agreement_deg)
        support = agree @ weight
        best = int(np.flatnonzero(support == support.max())[-1])  # the latest of several maxima
        members = np.flatnonzero(agree[best])
        share = weight[members] / support[best] if support[best] > 0 else np.full(len(members), 1 / len(members))
        x, y, z = share @ position_m[members]
        turn = float(share @ turn_rad[members, best])
        errors = np.column_stack([position_m[members, :2] - (x, y), turn_rad[members, best] - turn])
        covariance = np.tensordot(share, [votes[row].covariance for row in members], 1) + errors.T @ (
            share[:, None] * errors
        )
        certainty = fade[rows][members] @ [votes[row].probability for row in members]
        is_certain = certainty >= self.config.min_support
        status = TrackStatus.TRACKING if is_certain and not self._is_moved_blindly else self._failure(fade)
        pose = pose_2d(x, y, yaw_rad[best] + turn, z)
        place = votes[members[-1]].place if self.find_place is None else self.find_place(pose[:3, 3])
        return TrackedPose(status, place, pose, covariance, float(support[best]))

    def _is_near_camera(self, pose: np.ndarray) -> bool:
        """Return whether a pose (4, 4) in the frame of the camera is near the camera, and looks the same way."""
        near = np.linalg.norm(pose[:3, 3]) <= SAME_POSITION_M
        return bool(near and abs(wrap_angle(pose_yaw(pose))) <= np.radians(self.config.agreement_deg))

    def _failure(self, fade: np.ndarray) -> TrackStatus:
        """Return OUT_OF_MAP if the mean out-of-map probability, weighted by age, is above the limit; otherwise LOST."""
        known = [row for row, probability in enumerate(self._out_of_map) if probability is not None]
        if not known or not fade[known].any():
            return TrackStatus.LOST
        probability = np.average([self._out_of_map[row] for row in known], weights=fade[known])
        return TrackStatus.OUT_OF_MAP if probability > MAX_OUT_OF_MAP_PROBABILITY else TrackStatus.LOST


def _vote(answer: Localization) -> _Vote | None:
    """Return the vote of an answer; None if the answer has no pose.

    The weight of the vote is the probability of the first place. If there is no probability, the weight is the score of
    the place, or 0 if the score is negative.
    """
    if answer.T_world_query is None or not answer.status.names_a_place:
        return None
    first, pose = answer.places[0], np.asarray(answer.T_world_query)
    weight = max(first.score, 0.0) if first.probability is None else first.probability
    covariance = UNKNOWN_COVARIANCE if answer.covariance is None else _planar(answer.covariance)
    x, y, z = pose[:3, 3]
    probability = 1.0 if first.probability is None else first.probability
    return _Vote(first.place, pose_2d(x, y, pose_yaw(pose), z), covariance, weight, probability)


def _planar(covariance: np.ndarray) -> np.ndarray:
    """Return the covariance (3, 3) of x, y and yaw.

    Args:
        covariance: (3, 3) covariance of x, y and yaw, or (6, 6) covariance of position and rotation.
    """
    rows = [0, 1, 2] if len(covariance) == 3 else [0, 1, 5]
    return np.asarray(covariance)[np.ix_(rows, rows)]
