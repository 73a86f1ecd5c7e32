"""The agent: its estimate of its pose, and its next move. It never learns its true pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from salframe.framework.errors import NoRoute
from salframe.navigation.guide import Guide, Way
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw, wrap_angle

MAX_LOCALIZATIONS = 20
"""Maximum number of the latest positions whose localization the agent stores."""
SAME_POSITION_M = 0.3
"""Positions within this distance count as the same position."""
AGREE_M, AGREE_RAD = 0.5, np.radians(30.0)
"""Maximum differences in position and heading of two localizations that agree, after correction by odometry."""
MIN_SAVING_M = 1.0
"""Minimum saving in length for which the agent takes a path without a safety margin."""
SAME_OBSTACLE_M = 0.3
"""Collisions within this distance count as collisions with the same obstacle."""
REACHED_M = 0.1
"""Distance at which a corner of the path counts as reached."""


class Move(NamedTuple):
    """A turn (radians, positive to the left), then a walk straight ahead (metres)."""

    turn_rad: float
    length_m: float


class Located(NamedTuple):
    """A localization.

    Attributes:
        pose: (4, 4) T_world_pano.
        score: Score of the answer.
        frame: Id of a reference frame. If the localizer returned a place without a pose, `pose` is the pose of this
            frame. None if the localizer returned a pose.
    """

    pose: np.ndarray
    score: float
    frame: str | None = None


class Belief:
    """An agent's estimate of its pose: the localization that agrees with most of the others.

    All localizations are moved to the present by odometry. They vote with their positive scores, so several good
    answers outvote an uncertain or wrong one. If the agent returns to a position, the new answer there replaces the old
    one, because the errors of both are correlated. A place without a pose is used only if it differs from the previous
    place. If the place is the same, odometry is the better estimate of the position in it.
    """

    def __init__(self, yaw_rad: float) -> None:
        self.yaw_rad = yaw_rad
        """Heading in the world by odometry alone, from the known initial heading."""
        self._visited_poses: list[np.ndarray] = []
        self._localizations: list[Located] = []
        self._last_frame: str | None = None

    @property
    def pose(self) -> np.ndarray | None:
        """The estimated T_world_pano (4, 4), None before the first localization."""
        if not self._localizations:
            return None
        position_m = np.array([pose[:3, 3] for pose, _, _ in self._localizations])
        yaw_rad = np.array([pose_yaw(pose) for pose, _, _ in self._localizations])
        near = np.linalg.norm(position_m[:, None] - position_m, axis=2) <= AGREE_M
        agree = near & (np.abs(wrap_angle(yaw_rad[:, None] - yaw_rad)) <= AGREE_RAD)
        votes = agree @ np.array([max(score, 0.0) for _, score, _ in self._localizations])
        best = np.flatnonzero(votes == votes.max())[-1]
        # Of the localizations that agree, the latest has the smallest error from odometry.
        return self._localizations[int(np.flatnonzero(agree[best])[-1])].pose

    def add_motion(self, odometry: np.ndarray) -> None:
        """Update the belief by a motion (4, 4): the pose after the motion in the frame of the pose before."""
        back = invert_pose(odometry)
        self._visited_poses = [back @ pose for pose in self._visited_poses]
        self._localizations = [located._replace(pose=located.pose @ odometry) for located in self._localizations]
        self.yaw_rad += pose_yaw(odometry)

    def add_localization(self, located: Located) -> None:
        """Update the belief by a localization of the present position."""
        frame, self._last_frame = self._last_frame, located.frame
        if located.frame is not None and located.frame == frame:
            return
        x, y, z = located.pose[:3, 3]
        elsewhere = [i for i, pose in enumerate(self._visited_poses) if np.linalg.norm(pose[:3, 3]) > SAME_POSITION_M]
        other = elsewhere[1 - MAX_LOCALIZATIONS :]
        self._visited_poses = [*(self._visited_poses[i] for i in other), np.eye(4)]
        self._localizations = [
            *(self._localizations[i] for i in other),
            located._replace(pose=pose_2d(x, y, pose_yaw(located.pose), z)),
        ]


class Agent:
    """An agent that walks to a node along the shortest path from its estimated position, with a safety margin to walls
    unless that path is much longer."""

    def __init__(self, guide: Guide, goal: str, yaw_rad: float, arrival_m: float, rng: np.random.Generator) -> None:
        self.belief = Belief(yaw_rad)
        self._initial_guides: tuple[Guide, ...] = (guide.roomy, guide)
        self._guides: tuple[Guide, ...] = self._initial_guides
        self._goal, self._arrival_m, self._rng = goal, arrival_m, rng
        self._off_path = False
        self._stops_m: list[np.ndarray] = []

    def add_motion(self, odometry: np.ndarray, stopped: bool) -> None:
        """Update the agent after a move.

        Args:
            odometry: (4, 4), the motion measured by odometry: the pose after it in the frame of the pose before.
            stopped: Whether an obstacle stopped the move.
        """
        self.belief.add_motion(odometry)
        self._off_path = stopped
        pose = self.belief.pose
        if not stopped or pose is None:
            return
        again = any(np.linalg.norm(pose[:2, 3] - stop_m) <= SAME_OBSTACLE_M for stop_m in self._stops_m)
        self._stops_m.append(pose[:2, 3])
        charts = [guide.chart.stopped(pose, again) for guide in self._guides]
        if any(chart is not guide.chart for chart, guide in zip(charts, self._guides, strict=True)):
            self._guides = tuple(Guide(chart, guide.planner) for chart, guide in zip(charts, self._guides, strict=True))
            self._off_path = False

    def decide(self) -> Move | None:
        """Return the next move, None if the agent estimates that it has arrived.

        After a collision with an obstacle of its chart, which means that the agent was off its path, it steps aside
        before it tries again. Without a pose, or without a path from there, it moves to look from another position.
        """
        pose = self.belief.pose
        way = None if pose is None else self._way(pose[:3, 3])
        if pose is None or way is None:
            return self._aside()
        if way.length_m <= self._arrival_m:
            return None
        if self._off_path:
            return self._aside()
        chart = self._guides[0].chart
        legs_m = way.corners_m[:, :2] - chart.spot(pose[:3, 3])[:2]
        next_leg_m = next((leg for leg in legs_m if np.linalg.norm(leg) > REACHED_M), legs_m[-1])
        turn_rad = float(wrap_angle(np.arctan2(next_leg_m[1], next_leg_m[0]) - pose_yaw(pose)))
        return Move(turn_rad, min(float(np.linalg.norm(next_leg_m)), chart.max_move_m))

    def _way(self, position_m: np.ndarray) -> Way | None:
        """Return the best path. Where the recorded collisions leave none, their positions were wrong, and they are
        dropped."""
        ways = []
        for guide, penalty_m in zip(self._guides, (0.0, MIN_SAVING_M), strict=True):
            try:
                way = guide.way(position_m, self._goal)
            except NoRoute:
                continue
            ways.append((way.length_m + penalty_m, way))
        if ways:
            return min(ways, key=lambda entry: entry[0])[1]
        self._guides, self._stops_m = self._initial_guides, []
        return None

    def _aside(self) -> Move:
        """Return a random move backwards or to a side."""
        return Move(float(self._rng.uniform(np.pi / 2, 3 * np.pi / 2)), self._guides[0].chart.aside_m)
