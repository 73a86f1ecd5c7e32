"""Episodes: the start and the goal of an agent, drawn at random or read from a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError, NoRoute, UnknownName
from salframe.framework.files.reading import read_as
from salframe.framework.validation import Settings
from salframe.navigation.guide import Guide
from salframe.navigation.world import World
from salframe.topology.topological_map import NodeKind

MAX_EPISODES = 100_000
"""Maximum number of random episodes of a run."""
NumEpisodes = Annotated[int, Field(ge=1, le=MAX_EPISODES)]
"""Number of random episodes."""
TRIES = 100
"""Maximum number of random pairs of start and goal that are tried for an episode."""


@dataclass(frozen=True)
class Episode:
    """An episode: an agent walks from a start to a goal.

    Attributes:
        number: Number of the episode. It is a part of the seed of the noise.
        world: Id of the world (building).
        start: T_world_pano (4, 4) at the start, 16 numbers row by row.
        goal: Id of the goal node.
        shortest_m: Length in metres of the shortest path along the map.
    """

    number: int
    world: str
    start: tuple[float, ...]
    goal: str
    shortest_m: float


class EpisodeRequest(Settings):
    """An episode in a file of episodes."""

    start: str | tuple[float, float] = Field(
        description="start of the episode: id of a node of the map, or x and y in the world frame (m)"
    )
    floor: int | None = Field(
        None,
        ge=1,
        description="number of the floor of a start by x and y, from 1 for the lowest one; required if the world has "
        "several",
    )
    goal: str = Field(description="id of the node of the map that the agent is to reach")
    yaw_deg: float | None = Field(
        None, description="heading at the start (degrees), counter-clockwise from the x axis of the world; null: random"
    )
    world: str | None = Field(
        None, description="id of the building of the episode; null: the only building of the dataset"
    )


class Site(NamedTuple):
    """A world (a building) and its guide. The guide plans shortest paths on a chart of the whole world. A chart is the
    knowledge that an agent has about a world."""

    world: World
    guide: Guide


def draw_episodes(sites: Mapping[str, Site], count: int, seed: int) -> tuple[list[Episode], list[str]]:
    """Generate random episodes. The start is a uniformly random pose in a region. The goal is a scene node (position in
    a room) of another region.

    Args:
        sites: Mapping from the id of each world to its site.
        count: Number of episodes to generate, distributed evenly over the worlds. An episode for which TRIES attempts
            fail is left out.
        seed: Random seed.

    Returns:
        The episodes, and a message for each world in which no episode can be generated.

    Raises:
        DataError: No episode can be generated in any world.
    """
    worlds: list[str] = []
    left_out = []
    for world, site in sites.items():
        if _draw(site, np.random.default_rng([seed, 0]), 0) is None:
            left_out.append(
                f"the building {world} allows no episode (walk to a goal), expected a start and a goal in different "
                "rooms, and a path between them"
            )
        else:
            worlds.append(world)
    if not worlds:
        raise DataError(f"no episode could be generated: {left_out[0]}")
    episodes = []
    for number in range(count):
        world = worlds[number % len(worlds)]
        episode = _draw(sites[world], np.random.default_rng([seed, 1, number]), number)
        if episode is not None:
            episodes.append(episode)
    return episodes, left_out


def _draw(site: Site, rng: np.random.Generator, number: int) -> Episode | None:
    """Return a random episode; None if TRIES attempts fail, or no start is possible in the world."""
    world, guide = site
    for _ in range(TRIES):
        try:
            start = world.draw_start(rng)
        except DataError:
            return None
        region = world.region(start)
        goals = [
            node.id
            for node in world.chart.map.nodes
            if node.kind is NodeKind.SCENE and any(node.regions) and region not in node.regions
        ]
        if not region or not goals:
            continue
        goal = goals[rng.integers(len(goals))]
        try:
            if not world.is_reachable(start, world.stand_at(world.node(goal), 0.0)):
                continue
            return Episode(
                number, world.id, tuple(start.ravel().tolist()), goal, guide.shortest_path(start[:3, 3], goal).length_m
            )
        except (DataError, NoRoute):
            continue
    return None


def read_episode_requests(path: Path) -> tuple[EpisodeRequest, ...]:
    """Read the episodes of a JSON file.

    Raises:
        DataError: The file cannot be read, is invalid, or contains no episode.
    """
    requests = tuple(read_as(path, list[EpisodeRequest]))
    if not requests:
        raise DataError(f"{path} contains no episode, expected a list of at least one episode")
    return requests


def resolve_episodes(
    requests: Sequence[EpisodeRequest], sites: Mapping[str, Site], seed: int
) -> tuple[list[Episode], list[str]]:
    """Convert the episodes of a file to episodes with a start pose, and check that they can be walked.

    Args:
        requests: The episodes of the file.
        sites: Mapping from the id of each world to its site.
        seed: Random seed of the headings that the file does not state.

    Returns:
        The episodes that can be walked, and a message for each other episode.

    Raises:
        DataError: No episode can be walked.
    """
    episodes, left_out = [], []
    for number, request in enumerate(requests):
        try:
            episodes.append(_resolve(request, sites, np.random.default_rng([seed, 1, number]), number))
        except (DataError, NoRoute, UnknownName) as error:
            left_out.append(f"episode {number}: {error}")
    if not episodes:
        raise DataError(left_out[0] if left_out else "received no episode, expected at least one")
    return episodes, left_out


def _resolve(request: EpisodeRequest, sites: Mapping[str, Site], rng: np.random.Generator, number: int) -> Episode:
    if request.world is None and len(sites) > 1:
        raise DataError(f"the episode has no `world` (building), expected one of {', '.join(sites)}")
    name = next(iter(sites)) if request.world is None else request.world
    if name not in sites:
        raise DataError(f"the episode has the unknown `world` (building) {name!r}, expected one of {', '.join(sites)}")
    world, guide = sites[name]
    yaw_rad = rng.uniform(-np.pi, np.pi) if request.yaw_deg is None else np.radians(request.yaw_deg)
    goal = world.node(request.goal)
    start = (
        world.stand_at(world.node(request.start), yaw_rad)
        if isinstance(request.start, str)
        else world.stand(*request.start, yaw_rad, request.floor)
    )
    if not world.is_reachable(start, world.stand_at(goal, 0.0)):
        raise DataError(
            f"obstacles in the building {name} block every path from the start to {goal.id}: choose another start or "
            "goal"
        )
    return Episode(
        number, name, tuple(start.ravel().tolist()), goal.id, guide.shortest_path(start[:3, 3], goal.id).length_m
    )
