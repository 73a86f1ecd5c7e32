"""Charts: the knowledge of an agent about a building. A chart has the topological map, the clear floor, and the
collisions of the agent."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import ClassVar

import numpy as np

from salframe.panoramas.floors import FloorMasks, find_floor, floor_numbers
from salframe.panoramas.geometry import pose_yaw
from salframe.topology.edges import components, joining_paths, make_edge, sight_pairs
from salframe.topology.grid import FloorGrid, cell, has_line_of_sight, nearest_pixel
from salframe.topology.topological_map import MapEdge, MapNode, TopologicalMap

MARGIN_M = 0.07
"""Safety margin in metres that is added to the radius of the agent if possible, because an agent deviates slightly from
its path."""
AHEAD_M, CLEAR_M = 0.1, 0.30
"""If an agent collides, and the floor masks show a clearance of at least CLEAR_M metres at the point AHEAD_M metres
ahead of the agent, it is assumed that the masks do not contain the obstacle."""
BUMP_M, BUMP_AHEAD_M = 0.2, 0.3
"""Radius of the disc that an agent avoids after a collision with an obstacle that the masks do not contain, and
distance of the centre of the disc ahead of the agent, in metres. A larger obstacle causes several collisions."""


class Chart(ABC):
    """Knowledge of an agent about a building.

    The position of an agent is the position of its camera. Points of the map lie on the floor.
    """

    map: TopologicalMap
    max_move_m: ClassVar[float]
    """Maximum length of a walk before the agent takes the next panorama."""
    aside_m: ClassVar[float]
    """Length in metres of a step aside, which an agent takes if it cannot continue."""

    @abstractmethod
    def reach(self, position_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """Return the lengths of straight walks from a position to points.

        Args:
            position_m: (3,) position of the agent in the world.
            points_m: (N, 3) points in the world.

        Returns:
            (N,) lengths in metres, inf where a straight walk is impossible.
        """

    def spot(self, position_m: np.ndarray) -> np.ndarray:
        """Return the position (3,) that an agent with this estimated position is assumed to have. A chart (knowledge of
        an agent about a building) in which agents can be only at certain positions returns the nearest of these. The
        default returns `position_m`."""
        return position_m

    def with_margin(self) -> Chart:
        """Return the chart (knowledge of an agent about a building) with a safety margin to walls.

        In the returned chart, parts of the building may be unreachable. A chart without such a margin returns itself.
        """
        return self

    def after_collision(self, T_world_pano: np.ndarray, again: bool) -> Chart:
        """Return the chart (knowledge of an agent about a building) after a collision ahead of the agent; the same
        chart if the collision adds no knowledge.

        Args:
            T_world_pano: (4, 4) estimated pose of the agent.
            again: Whether the agent has collided near this position before.
        """
        return self


class FloorChart(Chart):
    """The floor masks of a building, and discs that the agent avoids: one around each point of a collision.

    Args:
        map: The topological map of the floors.
        grids: The pixels of each floor of the map, in the order of `map.floors`.
        radius_m: Radius of the agent.
    """

    max_move_m = 2.0
    aside_m = 0.3

    def __init__(self, map: TopologicalMap, grids: Sequence[FloorGrid], radius_m: float) -> None:
        self.map = map
        self._grids, self._radius_m = tuple(grids), radius_m
        self._floors = [grid.floor for grid in grids]

    def reach(self, position_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """Return the lengths (N,) in metres of straight walks from a position (3,) to points (N, 3), as `Chart.reach`.
        If the position is not clear, the nearest clear pixel of its floor is used in its place."""
        number = nearest_floor(self._floors, position_m)
        grid = self._grids[number]
        lengths_m = np.full(len(points_m), np.inf)
        start = nearest_pixel(grid.clear, np.clip(grid.to_pixel(position_m[:2]), 0, np.array(grid.clear.shape) - 0.5))
        there = np.flatnonzero(floor_numbers(self._floors, points_m) == number)
        if start is not None:
            ends = grid.to_pixel(points_m[there, :2])
            there = there[has_line_of_sight(grid.clear, np.broadcast_to(start, ends.shape), ends)]
            lengths_m[there] = np.linalg.norm(points_m[there, :2] - position_m[:2], axis=1)
        return lengths_m

    def with_margin(self) -> FloorChart:
        return self._restrict([grid.clearance_m >= self._radius_m + MARGIN_M for grid in self._grids])

    def after_collision(self, T_world_pano: np.ndarray, again: bool) -> FloorChart:
        """Return the chart (knowledge of the building) after a collision, as `Chart.after_collision`. A first collision
        near a wall or obstacle of the masks may result from a small deviation from the path, and changes nothing. For
        any other collision, an obstacle that is not in the masks is assumed: a disc around it is blocked, and the edges
        of the map are computed again."""
        number = nearest_floor(self._floors, T_world_pano[:3, 3])
        grid, yaw_rad = self._grids[number], pose_yaw(T_world_pano)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        next_pixel, centre = (
            grid.to_pixel(T_world_pano[:2, 3] + distance_m * ahead) for distance_m in (AHEAD_M, BUMP_AHEAD_M)
        )
        if not grid.inside(next_pixel) or (not again and grid.clearance_m[cell(next_pixel)] < CLEAR_M):
            return self
        row, column = np.indices(grid.clear.shape)
        distance_m = np.hypot(row + 0.5 - centre[0], column + 0.5 - centre[1]) * grid.floor.resolution_m
        free = [np.ones(other.clear.shape, bool) for other in self._grids]
        free[number] = distance_m >= BUMP_M
        return self._restrict(free)

    def _restrict(self, free: Sequence[np.ndarray]) -> FloorChart:
        """Return the chart whose clear pixels on each floor are limited to a mask of `free`, (rows, columns) bool.
        Nodes on other pixels are removed, and the edges are computed again."""
        grids = [copy(grid) for grid in self._grids]
        for grid, mask in zip(grids, free, strict=True):
            grid.clear = grid.clear & mask
        return FloorChart(_rebuild(self.map, grids), grids, self._radius_m)


def nearest_floor(floors: Sequence[FloorMasks], position_m: np.ndarray) -> int:
    """Return the index of the floor that an agent at a position (3,) is on.

    If no mask covers the position, return the highest floor below it; the lowest floor if there is none. `floors` are
    sorted by height.
    """
    number = find_floor(floors, position_m)
    below = [index for index, floor in enumerate(floors) if floor.z_m <= position_m[2]]
    return max(below, default=0) if number is None else number


def _rebuild(map: TopologicalMap, grids: Sequence[FloorGrid]) -> TopologicalMap:
    """Return the map without nodes on pixels that are not clear, with new edges over clear pixels, and with the stairs
    and lifts whose ends remain."""
    floors = floor_numbers(map.floors, np.array([node.xyz_m for node in map.nodes]).reshape(-1, 3))
    nodes: list[MapNode] = []
    edges: list[MapEdge] = []
    for number, grid in enumerate(grids):
        on_floor = [node for node, floor in zip(map.nodes, floors, strict=True) if floor == number]
        pixels = grid.to_pixel(np.array([node.xyz_m[:2] for node in on_floor]).reshape(-1, 2))
        clear = [index for index, pixel in enumerate(pixels) if grid.clear[cell(pixel)]]
        on_floor, pixels = [on_floor[index] for index in clear], pixels[clear]
        pairs = sight_pairs(grid, pixels)
        paths = [(i, j, pixels[[i, j]]) for i, j in pairs] + joining_paths(grid, pixels, components(len(pixels), pairs))
        nodes += on_floor
        edges += [make_edge(grid, on_floor[i].id, on_floor[j].id, corners) for i, j, corners in paths]
    left = {node.id for node in nodes}
    edges += [edge for edge in map.edges if edge.storeys and {edge.start, edge.end} <= left]
    return replace(map, nodes=tuple(nodes), edges=tuple(edges))
