"""Episodes: where an agent is put and where it is sent, drawn from a seed or given in a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError, NoRoute, UnknownName
from salframe.framework.files.reading import read_as
from salframe.framework.validation import Settings
from salframe.navigation.guide import Guide
from salframe.navigation.world import World
from salframe.topology.topological_map import NodeKind

TRIES = 100


@dataclass(frozen=True)
class Episode:
    """An agent at T_world_pano (16 numbers, row by row) in a world, sent to a node; shortest_m along the map. `number`
    seeds its noise."""

    number: int
    world: str
    start: tuple[float, ...]
    goal: str
    shortest_m: float


class EpisodeRequest(Settings):
    """An episode in a file."""

    start: str | tuple[float, float] = Field(description="a node, or x and y in metres")
    goal: str = Field(description="a node")
    yaw_deg: float | None = Field(
        None, description="first heading, counter-clockwise from the world's x axis; drawn where absent"
    )
    world: str | None = Field(None, description="the building, where the data set has several")


class Site(NamedTuple):
    """A world and the guide that is true to its chart."""

    world: World
    guide: Guide


def draw_episodes(sites: Mapping[str, Site], count: int, seed: int) -> tuple[list[Episode], list[str]]:
    """`count` episodes dealt out evenly to the worlds, from a uniform pose in a region to a scene node of another
    region.

    With them a line on each world that gives none. Raises DataError where none does.
    """
    drawn: dict[str, list[Episode]] = {}
    left_out = []
    for world, site in sites.items():
        if _draw(site, np.random.default_rng([seed, 0]), 0) is None:
            left_out.append(
                f"{world} gives no episode: expected a scene node in another region than the start, and a way to it"
            )
        else:
            drawn[world] = []
    if not drawn:
        raise DataError(f"no episode could be drawn: {left_out[0]}")
    worlds = list(drawn)
    episodes = []
    for number in range(count):
        world = worlds[number % len(worlds)]
        episode = _draw(sites[world], np.random.default_rng([seed, 1, number]), number)
        if episode is not None:
            episodes.append(episode)
    return episodes, left_out


def _draw(site: Site, rng: np.random.Generator, number: int) -> Episode | None:
    world, guide = site
    for _ in range(TRIES):
        start = world.draw_start(rng)
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
            if not world.joined(start, world.stand_at(world.node(goal), 0.0)):
                continue
            return Episode(
                number, world.id, tuple(start.ravel().tolist()), goal, guide.way(start[:3, 3], goal).length_m
            )
        except (DataError, NoRoute):
            continue
    return None


def read_episode_requests(path: Path) -> tuple[EpisodeRequest, ...]:
    """The episodes of a JSON file. Raises DataError on a malformed one."""
    return tuple(read_as(path, list[EpisodeRequest]))


def place_episodes(
    asked: Sequence[EpisodeRequest], sites: Mapping[str, Site], seed: int
) -> tuple[list[Episode], list[str]]:
    """The episodes that can be walked, and a line on each that cannot. Raises DataError where none can."""
    episodes, left_out = [], []
    for number, one in enumerate(asked):
        try:
            episodes.append(_place(one, sites, np.random.default_rng([seed, 1, number]), number))
        except (DataError, NoRoute, UnknownName) as error:
            left_out.append(f"episode {number}: {error}")
    if not episodes:
        raise DataError(left_out[0] if left_out else "received no episode, expected at least one")
    return episodes, left_out


def _place(asked: EpisodeRequest, sites: Mapping[str, Site], rng: np.random.Generator, number: int) -> Episode:
    if asked.world is None and len(sites) > 1:
        raise DataError(f"it names no world, expected one of {', '.join(sites)}")
    name = next(iter(sites)) if asked.world is None else asked.world
    if name not in sites:
        raise DataError(f"unknown world {name!r}, expected one of {', '.join(sites)}")
    world, guide = sites[name]
    yaw_rad = rng.uniform(-np.pi, np.pi) if asked.yaw_deg is None else np.radians(asked.yaw_deg)
    goal = world.node(asked.goal)
    start = (
        world.stand_at(world.node(asked.start), yaw_rad)
        if isinstance(asked.start, str)
        else world.stand(*asked.start, yaw_rad)
    )
    if not world.joined(start, world.stand_at(goal, 0.0)):
        raise DataError(f"what stands in {name} today shuts {goal.id} off from the start")
    return Episode(number, name, tuple(start.ravel().tolist()), goal.id, guide.way(start[:3, 3], goal.id).length_m)
