"""Run an episode in closed loop: take a panorama, localize, decide, turn and walk. The episode ends when the agent
reports its arrival, or when it has taken the maximum number of panoramas."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.component import added
from salframe.framework.components.defaults import default_of
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.errors import NoRoute
from salframe.framework.validation import Settings
from salframe.localization.tracker import Tracker
from salframe.navigation.agent import Agent, Located
from salframe.navigation.episodes import Episode, Site
from salframe.navigation.guide import Guide
from salframe.navigation.world import World
from salframe.panoramas.geometry import pose_2d, pose_yaw

SUCCESS_M = 0.5
"""Maximum length of the remaining path, in metres, at which the reported arrival of an agent is a success."""
SUCCESS_LIMITS_M = {"success_1m": 1.0, "success_3m": 3.0}
"""Larger limits than SUCCESS_M in metres, by the key in the row of an episode. R2R and REVERIE use 3 m."""

Row = dict[str, Any]


class EpisodeStatus(StrEnum):
    """How an episode ended: the agent reported its arrival, or it took the maximum number of panoramas."""

    ARRIVED = "arrived"
    OUT_OF_BUDGET = "out of budget"


class NavigationConfig(Settings):
    """Settings of navigation, the same for every method of a run. The noise of turns and of lengths is normally
    distributed."""

    planner: slot(  # type: ignore[valid-type]
        "planner", default_of("navigation_planner"), description="planner that computes the routes of the agent"
    )
    tracker: slot("tracker", description="tracker that estimates the pose of the agent")  # type: ignore[valid-type]
    budget: int = Field(
        60,
        ge=1,
        description="maximum number of panoramas that the agent takes in an episode. An episode that needs more fails",
    )
    arrival_m: float = Field(
        0.25, gt=0, description="maximum length (m) of the remaining path at which the agent reports its arrival"
    )
    max_turns: int = Field(
        1,
        ge=0,
        description="maximum number of turns on the spot before the agent walks on. If an answer is not accepted, "
        "the agent turns as the answer suggests (`next_view`). All views of the turn are localized together; 0: the "
        "agent does not turn for another view",
    )
    turn_noise_deg: float = Field(2.0, ge=0, description="standard deviation (degrees) of the error of a turn")
    length_noise: float = Field(
        0.05,
        ge=0,
        description="standard deviation of the error of the length of a move, divided by the length (0.05: 5 %)",
    )
    slip_m: float = added(
        0.0,
        ge=0,
        description="distance (m) that the agent slips in a random direction at the end of a move, if the move is "
        "longer than this distance; walls stop the slip; 0: no slip",
    )
    odometry_turn_noise_deg: float = Field(
        2.0, ge=0, description="standard deviation (degrees) of the error of odometry in a turn"
    )
    odometry_length_noise: float = Field(
        0.05,
        ge=0,
        description="standard deviation of the error of odometry in the length of a move, divided by the length "
        "(0.05: 5 %)",
    )


LocalizeFunction = Callable[[np.ndarray, float, np.ndarray | None], Located]
"""Function localize(T_world_pano, yaw_rad, turn) that localizes an agent. Its arguments are as in
`AgentLocalizer.localize`, without `world`."""


def walk(site: Site, localize: LocalizeFunction, episode: Episode, config: NavigationConfig, seed: int) -> Row:
    """Run an episode, and return its measurements as a row of the results.

    The noise depends only on the seed and the episode, so that all methods get the same noise. The agent knows its
    initial heading, but not its initial position.

    Args:
        site: The world of the episode, and the guide, which plans the routes of the agent.
        localize: Function that localizes the agent.
        episode: The episode.
        config: Settings of navigation.
        seed: Random seed of the noise.
    """
    world, guide = site
    rng = np.random.default_rng([seed, 2, episode.number])
    slips = np.random.default_rng([seed, 4, episode.number])
    T = np.array(episode.start).reshape(4, 4)
    tracker: Tracker = registry().build(Tracker.role, config.tracker)
    agent_rng = np.random.default_rng([seed, 3, episode.number])
    agent = Agent(guide, episode.goal, pose_yaw(T), config.arrival_m, agent_rng, tracker, config.max_turns)
    path, believed, localized = [_flat(T)], [], []
    collisions, travelled_m, arrived = 0, 0.0, False
    turn: np.ndarray | None = None
    for _ in range(config.budget):
        located = localize(T, agent.yaw_rad, turn)
        localized.append(located.answer.status.names_a_place)
        agent.add_localization(located)
        pose = agent.pose
        believed.append(None if pose is None else _flat(pose))
        move = agent.decide()
        if move is None:
            arrived = True
            break
        turn_noise, length_noise, odometry_turn_noise, odometry_length_noise = rng.standard_normal(4)
        turn_rad = move.turn_rad + np.radians(config.turn_noise_deg) * turn_noise
        before = T
        if move.stairs is None:
            T, stopped = world.move(T, turn_rad, max(move.length_m * (1 + config.length_noise * length_noise), 0.0))
            stopped &= move.length_m > 0
            travelled_m += float(np.linalg.norm(T[:3, 3] - before[:3, 3]))
        else:
            T, stopped = world.take_stairs(T, move.stairs)
            T, _ = world.move(T, turn_rad, 0.0)
            travelled_m += 0.0 if stopped else move.stairs.length_m
        if move.length_m > config.slip_m > 0 and not stopped:
            before_slip, T = T, _slip(world, T, slips.uniform(-np.pi, np.pi), config.slip_m)
            travelled_m += float(np.linalg.norm(T[:3, 3] - before_slip[:3, 3]))
        motion = _odometry(
            before,
            T,
            np.radians(config.odometry_turn_noise_deg) * odometry_turn_noise,
            1 + config.odometry_length_noise * odometry_length_noise,
        )
        agent.add_motion(motion, stopped)
        turn = motion if move.length_m == 0 and move.stairs is None else None
        collisions += stopped
        path.append(_flat(T))
    left_m = [_remaining_m(guide, np.array(pose[:3]), episode.goal) for pose in path]
    success = arrived and left_m[-1] <= SUCCESS_M
    max_length_m = max(episode.shortest_m, travelled_m)
    return {
        "world": episode.world,
        "goal": episode.goal,
        "status": EpisodeStatus.ARRIVED if arrived else EpisodeStatus.OUT_OF_BUDGET,
        "success": success,
        "oracle": min(left_m) <= SUCCESS_M,
        "spl": success * (episode.shortest_m / max_length_m if max_length_m else 1.0),
        **{key: arrived and left_m[-1] <= bound_m for key, bound_m in SUCCESS_LIMITS_M.items()},
        "shortest_m": episode.shortest_m,
        "travelled_m": travelled_m,
        "left_m": left_m[-1] if np.isfinite(left_m[-1]) else None,
        "panoramas": len(localized),
        "not_localized": localized.count(False),
        "collisions": collisions,
        "path": path,
        "believed": believed,
        "error": None,
    }


def _slip(world: World, T_world_pano: np.ndarray, bearing_rad: float, length_m: float) -> np.ndarray:
    """Return the pose (4, 4) after an agent slipped. `bearing_rad` is the direction of the slip relative to its
    heading. The heading does not change, and a wall stops the slip."""
    slipped, _ = world.move(T_world_pano, bearing_rad, length_m)
    x, y, z = slipped[:3, 3]
    return pose_2d(x, y, pose_yaw(T_world_pano), z)


def _odometry(before: np.ndarray, after: np.ndarray, turn_error_rad: float, scale: float) -> np.ndarray:
    """Return the motion (4, 4) that odometry measures between two poses, in the frame of the pose `before`: the true
    motion rotated by an error, with a scaled length."""
    c, s = np.cos(turn_error_rad), np.sin(turn_error_rad)
    x, y, z = before[:3, :3].T @ (after[:3, 3] - before[:3, 3])
    return pose_2d(
        scale * (c * x - s * y), scale * (s * x + c * y), pose_yaw(after) - pose_yaw(before) + turn_error_rad, z
    )


def _remaining_m(guide: Guide, position_m: np.ndarray, goal: str) -> float:
    """Return the length of the remaining path in metres; inf if no path leads to the goal."""
    try:
        return guide.shortest_path(position_m, goal).length_m
    except NoRoute:
        return float("inf")


def _flat(pose: np.ndarray) -> list[float]:
    """Return x, y, z in metres and yaw in radians of an upright pose, rounded to 4 digits for readable trajectories."""
    return [round(float(value), 4) for value in (*pose[:3, 3], pose_yaw(pose))]
