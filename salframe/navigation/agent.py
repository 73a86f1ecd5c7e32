"""The agent: what it believes of its pose, and where it walks next. It never learns where it really stands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from salframe.framework.errors import NoRoute
from salframe.navigation.guide import Guide, Way
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw, wrap_angle

REMEMBERED = 20
"""Latest spots whose localization the agent keeps."""
SPOT_M = 0.3
"""Within this distance an agent is on a spot where it has been."""
AGREE_M, AGREE_RAD = 0.5, np.radians(30.0)
"""Localizations that odometry brings this near to each other agree."""
TIGHT_M = 1.0
"""A way without room to spare is worth it where it is shorter by more than this."""
HEREABOUTS_M = 0.3
"""Collisions this near to each other are with the same thing."""
AT_M = 0.1
"""A corner of the way this near has been reached."""


class Move(NamedTuple):
    """A turn (radians, to the left) and a walk straight ahead (metres)."""

    turn_rad: float
    length_m: float


class Located(NamedTuple):
    """A localization: T_world_pano (4, 4), its score, and where it is no more than a place, the frame whose position it
    takes."""

    pose: np.ndarray
    score: float
    frame: str | None = None


class Belief:
    """Where an agent believes to stand: by those of its localizations that agree with each other most, all brought up
    to now by odometry.

    Each counts by its score, where that is positive: a doubtful answer is outvoted, and so is a wrong belief by better
    answers that contradict it. On a spot where the agent has been before, the new answer takes the place of the old
    one: they err alike. A place without a pose tells something where it changes; while it stays the same, odometry
    knows better where in it the agent is.
    """

    def __init__(self, yaw_rad: float) -> None:
        self.yaw_rad = yaw_rad
        """Heading in the world by odometry alone, from the given first one."""
        self._spots: list[np.ndarray] = []
        self._located: list[Located] = []
        self._last_frame: str | None = None

    @property
    def pose(self) -> np.ndarray | None:
        """T_world_pano (4, 4) as believed, None before the first localization."""
        if not self._located:
            return None
        position_m = np.array([pose[:3, 3] for pose, _, _ in self._located])
        yaw_rad = np.array([pose_yaw(pose) for pose, _, _ in self._located])
        near = np.linalg.norm(position_m[:, None] - position_m, axis=2) <= AGREE_M
        agree = near & (np.abs(wrap_angle(yaw_rad[:, None] - yaw_rad)) <= AGREE_RAD)
        votes = agree @ np.array([max(score, 0.0) for _, score, _ in self._located])
        best = np.flatnonzero(votes == votes.max())[-1]
        # The latest of those that agree with it: odometry has moved it least.
        return self._located[int(np.flatnonzero(agree[best])[-1])].pose

    def moved(self, odometry: np.ndarray) -> None:
        """Take in a motion (4, 4): the pose after it in the frame of the pose before."""
        back = invert_pose(odometry)
        self._spots = [back @ spot for spot in self._spots]
        self._located = [one._replace(pose=one.pose @ odometry) for one in self._located]
        self.yaw_rad += pose_yaw(odometry)

    def localized(self, found: Located) -> None:
        """Take in a localization of the spot where the agent is."""
        frame, self._last_frame = self._last_frame, found.frame
        if found.frame is not None and found.frame == frame:
            return
        x, y, z = found.pose[:3, 3]
        other = [i for i, spot in enumerate(self._spots) if np.linalg.norm(spot[:3, 3]) > SPOT_M][1 - REMEMBERED :]
        self._spots = [*(self._spots[i] for i in other), np.eye(4)]
        self._located = [
            *(self._located[i] for i in other),
            found._replace(pose=pose_2d(x, y, pose_yaw(found.pose), z)),
        ]


class Agent:
    """Walks to a node along the shortest way from where it believes to stand, with room to spare unless that is much
    longer."""

    def __init__(self, guide: Guide, goal: str, yaw_rad: float, arrival_m: float, rng: np.random.Generator) -> None:
        self.belief = Belief(yaw_rad)
        self._given: tuple[Guide, ...] = (guide.roomy, guide)
        self._guides: tuple[Guide, ...] = self._given
        self._goal, self._arrival_m, self._rng = goal, arrival_m, rng
        self._off_line = False
        self._stops_m: list[np.ndarray] = []

    def moved(self, odometry: np.ndarray, stopped: bool) -> None:
        """What the last move came to, by odometry (4, 4), and whether something stopped it."""
        self.belief.moved(odometry)
        self._off_line = stopped
        pose = self.belief.pose
        if not stopped or pose is None:
            return
        again = any(np.linalg.norm(pose[:2, 3] - place_m) <= HEREABOUTS_M for place_m in self._stops_m)
        self._stops_m.append(pose[:2, 3])
        charts = [guide.chart.stopped(pose, again) for guide in self._guides]
        if any(chart is not guide.chart for chart, guide in zip(charts, self._guides, strict=True)):
            self._guides = tuple(Guide(chart, guide.planner) for chart, guide in zip(charts, self._guides, strict=True))
            self._off_line = False

    def decide(self) -> Move | None:
        """The next move, None where it believes to have arrived.

        Stopped by what its chart shows it was off its line, and steps aside before it tries again. Without a belief, or
        where the chart gives no way from there, it looks from somewhere else.
        """
        pose = self.belief.pose
        way = None if pose is None else self._way(pose[:3, 3])
        if pose is None or way is None:
            return self._aside()
        if way.length_m <= self._arrival_m:
            return None
        if self._off_line:
            return self._aside()
        chart = self._guides[0].chart
        legs_m = way.corners_m[:, :2] - chart.spot(pose[:3, 3])[:2]
        ahead = next((leg for leg in legs_m if np.linalg.norm(leg) > AT_M), legs_m[-1])
        turn_rad = float(wrap_angle(np.arctan2(ahead[1], ahead[0]) - pose_yaw(pose)))
        return Move(turn_rad, min(float(np.linalg.norm(ahead)), chart.max_move_m))

    def _way(self, position_m: np.ndarray) -> Way | None:
        """The best way. Where what it has bumped into leaves none, that was elsewhere than it believed, and is
        forgotten."""
        ways = []
        for guide, drawback_m in zip(self._guides, (0.0, TIGHT_M), strict=True):
            try:
                way = guide.way(position_m, self._goal)
            except NoRoute:
                continue
            ways.append((way.length_m + drawback_m, way))
        if ways:
            return min(ways, key=lambda entry: entry[0])[1]
        self._guides, self._stops_m = self._given, []
        return None

    def _aside(self) -> Move:
        return Move(float(self._rng.uniform(np.pi / 2, 3 * np.pi / 2)), self._guides[0].chart.aside_m)
