"""One episode in closed loop: look, localize, decide, turn and walk, until the agent says it is there or has looked
often enough."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.component import added
from salframe.framework.components.defaults import default_of
from salframe.framework.components.slots import slot
from salframe.framework.errors import NoRoute
from salframe.framework.validation import Settings
from salframe.navigation.agent import Agent, Located
from salframe.navigation.episodes import Episode, Site
from salframe.navigation.guide import Guide
from salframe.navigation.world import World
from salframe.panoramas.geometry import pose_2d, pose_yaw

SUCCESS_M = 0.5
"""An agent that says it has arrived and has no farther to go than this has succeeded."""
LOOSER_M = {"success_1m": 1.0, "success_3m": 3.0}
"""Looser rules by the key of an episode's row; that of R2R and REVERIE is 3 m."""

Row = dict[str, Any]


class EpisodeStatus(StrEnum):
    """How an episode ended: the agent said that it had arrived, or had looked as often as it may."""

    ARRIVED = "arrived"
    OUT_OF_BUDGET = "out of budget"


class NavigationConfig(Settings):
    """What every method of a run navigates with. Noise is normal, its standard deviations given here."""

    planner: slot("planner", default_of("navigation_planner"))  # type: ignore[valid-type]
    budget: int = Field(60, ge=1, description="panoramas that an agent may take in an episode")
    arrival_m: float = Field(
        0.25, gt=0, description="an agent that believes to have no farther to go says that it has arrived"
    )
    turn_noise_deg: float = Field(2.0, ge=0, description="of the heading after a turn")
    length_noise: float = Field(0.05, ge=0, description="of a walk's length, a share of it")
    slip_m: float = added(
        0.0,
        ge=0,
        description="a walk longer than this ends so far from where it would, any way, unless a wall is nearer",
    )
    odometry_turn_noise_deg: float = Field(2.0, ge=0, description="of the turn that odometry tells of a move")
    odometry_length_noise: float = Field(0.05, ge=0, description="of the length that odometry tells, a share of it")


Look = Callable[[np.ndarray, float], Located | None]
"""look(T_world_pano, yaw_rad): where a panorama taken at this true pose is localized, None where it is not; `yaw_rad`
as the agent believes."""


def walk(site: Site, look: Look, episode: Episode, config: NavigationConfig, seed: int) -> Row:
    """Walk an episode: its row. Noise depends on seed and episode alone, so all methods meet the same.

    The agent is told its first heading, not its position.
    """
    world, guide = site
    rng = np.random.default_rng([seed, 2, episode.number])
    slips = np.random.default_rng([seed, 4, episode.number])
    T = np.array(episode.start).reshape(4, 4)
    agent = Agent(guide, episode.goal, pose_yaw(T), config.arrival_m, np.random.default_rng([seed, 3, episode.number]))
    path, believed, localized = [_flat(T)], [], []
    collisions, travelled_m, arrived = 0, 0.0, False
    for _ in range(config.budget):
        found = look(T, agent.belief.yaw_rad)
        localized.append(found is not None)
        if found is not None:
            agent.belief.localized(found)
        believed.append(None if agent.belief.pose is None else _flat(agent.belief.pose))
        move = agent.decide()
        if move is None:
            arrived = True
            break
        turn_noise, length_noise, odometry_turn_noise, odometry_length_noise = rng.standard_normal(4)
        turn_rad = move.turn_rad + np.radians(config.turn_noise_deg) * turn_noise
        before, (T, stopped) = (
            T,
            world.move(T, turn_rad, max(move.length_m * (1 + config.length_noise * length_noise), 0.0)),
        )
        travelled_m += float(np.linalg.norm(T[:3, 3] - before[:3, 3]))
        if move.length_m > config.slip_m > 0 and not stopped:
            walked, T = T, _slipped(world, T, slips.uniform(-np.pi, np.pi), config.slip_m)
            travelled_m += float(np.linalg.norm(T[:3, 3] - walked[:3, 3]))
        told = _odometry(
            before,
            T,
            np.radians(config.odometry_turn_noise_deg) * odometry_turn_noise,
            1 + config.odometry_length_noise * odometry_length_noise,
        )
        agent.moved(told, stopped)
        collisions += stopped
        path.append(_flat(T))
    left_m = [_left(guide, np.array(pose[:3]), episode.goal) for pose in path]
    success = arrived and left_m[-1] <= SUCCESS_M
    longer_m = max(episode.shortest_m, travelled_m)
    return {
        "world": episode.world,
        "goal": episode.goal,
        "status": EpisodeStatus.ARRIVED if arrived else EpisodeStatus.OUT_OF_BUDGET,
        "success": success,
        "oracle": min(left_m) <= SUCCESS_M,
        "spl": success * (episode.shortest_m / longer_m if longer_m else 1.0),
        **{key: arrived and left_m[-1] <= bound_m for key, bound_m in LOOSER_M.items()},
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


def _slipped(world: World, T_world_pano: np.ndarray, bearing_rad: float, length_m: float) -> np.ndarray:
    """The pose of an agent that slips, looking the same way; a wall ends it."""
    slipped, _ = world.move(T_world_pano, bearing_rad, length_m)
    x, y, z = slipped[:3, 3]
    return pose_2d(x, y, pose_yaw(T_world_pano), z)


def _odometry(before: np.ndarray, after: np.ndarray, turn_error_rad: float, scale: float) -> np.ndarray:
    """The motion in the frame of the pose before, as odometry tells it: turned too far by an error, and scaled."""
    c, s = np.cos(turn_error_rad), np.sin(turn_error_rad)
    x, y, z = before[:3, :3].T @ (after[:3, 3] - before[:3, 3])
    return pose_2d(
        scale * (c * x - s * y), scale * (s * x + c * y), pose_yaw(after) - pose_yaw(before) + turn_error_rad, z
    )


def _left(guide: Guide, position_m: np.ndarray, goal: str) -> float:
    try:
        return guide.way(position_m, goal).length_m
    except NoRoute:
        return float("inf")


def _flat(pose: np.ndarray) -> list[float]:
    """(x, y, z in metres, yaw in radians) of an upright pose, to tenths of millimetres: a trajectory is for reading."""
    return [round(float(value), 4) for value in (*pose[:3, 3], pose_yaw(pose))]
