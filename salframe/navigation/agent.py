"""The agent: its estimated pose, and its next move. The agent never receives its true pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from salframe.framework.errors import NoRoute
from salframe.localization.answers import Localization
from salframe.localization.tracker import Tracker
from salframe.navigation.guide import Guide, WalkingPath
from salframe.panoramas.geometry import pose_yaw, wrap_angle
from salframe.topology.topological_map import MapEdge

MIN_SAVING_M = 1.0
"""Minimum saving in length, in metres, for which the agent takes a path without a safety margin to walls."""
SAME_OBSTACLE_M = 0.3
"""Collisions within this distance of each other, in metres, are treated as collisions with the same obstacle."""


class Move(NamedTuple):
    """A turn and a walk straight ahead, or the use of stairs or of a lift.

    Attributes:
        turn_rad: Turn in radians, positive to the left.
        length_m: Length of the walk in metres.
        stairs: Edge of the stairs or lift to take; None: the agent walks.
    """

    turn_rad: float
    length_m: float
    stairs: MapEdge | None = None


class Located(NamedTuple):
    """The answer to the panorama that an agent has taken.

    Attributes:
        answer: The answer. If the localizer returned a place and no pose, the pose of this answer consists of the
            position of the reference frame and the heading by odometry.
        frame: Id of this reference frame; None if the localizer returned a pose, or failed.
    """

    answer: Localization
    frame: str | None = None


class Agent:
    """An agent that walks to a node along the shortest path from its estimated position.

    The path has a safety margin to walls. If a path without the margin is shorter by more than MIN_SAVING_M, the agent
    takes the shorter path. The agent uses the best guess of its tracker even if the tracker is lost, because later
    answers correct the guess. If an answer is not accepted, the agent first turns on the spot as the answer suggests.
    It localizes itself at each view of the turn, and ends the turn as soon as an answer is accepted.
    """

    def __init__(
        self,
        guide: Guide,
        goal: str,
        yaw_rad: float,
        arrival_m: float,
        rng: np.random.Generator,
        tracker: Tracker,
        max_turns: int = 0,
    ) -> None:
        """Create an agent whose position is unknown.

        Args:
            guide: Shortest paths in the building.
            goal: Id of the goal node.
            yaw_rad: Initial heading in the world.
            arrival_m: Maximum length of the remaining path, in metres, at which the agent reports its arrival.
            rng: Random generator for the moves of an agent that has no path.
            tracker: Tracker of the pose.
            max_turns: Maximum number of turns on the spot before the agent walks on.
        """
        self.yaw_rad = yaw_rad
        """Heading in the world: the known initial heading, updated by odometry only."""
        self._tracker = tracker
        self._last_frame: str | None = None
        self._initial_guides: tuple[Guide, ...] = (guide.with_margin, guide)
        self._guides: tuple[Guide, ...] = self._initial_guides
        self._goal, self._arrival_m, self._rng = goal, arrival_m, rng
        self._off_path = False
        self._takes_stairs = False
        self._stops_m: list[np.ndarray] = []
        self._max_turns, self._num_turns = max_turns, 0
        self._steps_rad: list[float] = []
        self._is_turning = False
        self._answer: Localization | None = None

    @property
    def pose(self) -> np.ndarray | None:
        """The estimated T_world_pano (4, 4); None before the first localization."""
        return self._tracker.belief().T_world_pano

    def add_localization(self, located: Located) -> None:
        """Update the agent by the localization at its present position.

        If the localizer returned a place and no pose, the localization is used only if its reference frame differs from
        the reference frame of the previous localization. If both are the same, odometry gives a better estimate of the
        position.
        """
        self._answer = located.answer
        is_repeated = located.frame is not None and located.frame == self._last_frame
        if located.answer.status.names_a_place:
            self._last_frame = located.frame
        if not is_repeated:
            self._tracker.observe(located.answer)

    def add_motion(self, odometry: np.ndarray, stopped: bool) -> None:
        """Update the agent after a move.

        Args:
            odometry: (4, 4) motion measured by odometry: the pose after the move, in the agent frame before the move.
            stopped: Whether an obstacle stopped the move, or there were no stairs to take.
        """
        self._tracker.move(odometry)
        self.yaw_rad += pose_yaw(odometry)
        if not self._is_turning:
            self._off_path = stopped
        pose = self.pose
        if not stopped or pose is None or self._takes_stairs:
            return
        again = any(np.linalg.norm(pose[:3, 3] - stop_m) <= SAME_OBSTACLE_M for stop_m in self._stops_m)
        self._stops_m.append(pose[:3, 3])
        charts = [guide.chart.after_collision(pose, again) for guide in self._guides]
        if any(chart is not guide.chart for chart, guide in zip(charts, self._guides, strict=True)):
            self._guides = tuple(Guide(chart, guide.planner) for chart, guide in zip(charts, self._guides, strict=True))
            self._off_path = False

    def decide(self) -> Move | None:
        """Return the next move; None if the agent estimates that it has arrived.

        If the last answer is not accepted, the agent first turns on the spot, up to the next view. If the agent
        collided with an obstacle that its chart (knowledge of the building) contains, or did not find the stairs, it
        was not on its path. It then steps aside and tries again. If the agent has no pose, or no path from its pose, it
        makes a random move to take a panorama from another position.
        """
        self._takes_stairs = False
        step_rad = self._next_step_rad()
        self._is_turning = step_rad is not None
        if step_rad is not None:
            return Move(step_rad, 0.0)
        self._num_turns, self._steps_rad = 0, []
        pose = self.pose
        path = None if pose is None else self._best_path(pose[:3, 3])
        if pose is None or path is None:
            return self._aside()
        if path.length_m <= self._arrival_m:
            return None
        if self._off_path:
            return self._aside()
        chart = self._guides[0].chart
        leg = path.leg(chart.spot(pose[:3, 3]))
        if isinstance(leg, MapEdge):
            self._takes_stairs = True
            return Move(0.0, 0.0, leg)
        turn_rad = float(wrap_angle(np.arctan2(leg[1], leg[0]) - pose_yaw(pose)))
        return Move(turn_rad, min(float(np.linalg.norm(leg)), chart.max_move_m))

    def _next_step_rad(self) -> float | None:
        """Return the angle to the next view of a turn on the spot, in radians; None if the agent does not turn."""
        answer = self._answer
        if answer is None or answer.accepted is not False:
            return None
        if not self._steps_rad and self._num_turns < self._max_turns and answer.next_view is not None:
            self._num_turns += 1
            views_deg = answer.next_view.views_deg
            self._steps_rad = [float(np.radians(views_deg[0]))] * len(views_deg)
        return self._steps_rad.pop() if self._steps_rad else None

    def _best_path(self, position_m: np.ndarray) -> WalkingPath | None:
        """Return the best path; None if there is no path.

        If there is no path, the positions of the recorded collisions are assumed to be wrong, and the collisions are
        removed from the charts.
        """
        paths = []
        for guide, penalty_m in zip(self._guides, (0.0, MIN_SAVING_M), strict=True):
            try:
                path = guide.shortest_path(position_m, self._goal)
            except NoRoute:
                continue
            paths.append((path.length_m + penalty_m, path))
        if paths:
            return min(paths, key=lambda entry: entry[0])[1]
        self._guides, self._stops_m = self._initial_guides, []
        return None

    def _aside(self) -> Move:
        """Return a random move backwards or to a side."""
        return Move(float(self._rng.uniform(np.pi / 2, 3 * np.pi / 2)), self._guides[0].chart.aside_m)
