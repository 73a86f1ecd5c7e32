"""Charts: the knowledge of an agent about a building. A chart has the topological map, the clear floor, and the
collisions of the agent."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import replace
from typing import ClassVar

import numpy as np

from salframe.panoramas.geometry import pose_yaw
from salframe.topology.edges import components, joining_paths, make_edge, sight_pairs
from salframe.topology.grid import FloorGrid, cell, nearest_pixel, sees
from salframe.topology.topological_map import TopologicalMap

ROOM_M = 0.07
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
        """Return the position (3,) that an agent with this estimated position is assumed to have. A chart in which
        agents can be only at certain positions returns the nearest of these. The default returns `position_m`."""
        return position_m

    def roomy(self) -> Chart:
        """Return the chart with a safety margin to walls. In this chart, parts of the building may be out of reach. The
        default returns the chart itself."""
        return self

    def stopped(self, T_world_pano: np.ndarray, again: bool) -> Chart:
        """Return the chart after a collision ahead of the agent; the same chart if the collision adds no knowledge.

        Args:
            T_world_pano: (4, 4) estimated pose of the agent.
            again: Whether the agent has collided near this position before.
        """
        return self


class FloorChart(Chart):
    """The masks of a floor, and discs around the obstacles of collisions, which the agent avoids."""

    max_move_m = 2.0
    aside_m = 0.3

    def __init__(self, map: TopologicalMap, grid: FloorGrid, radius_m: float) -> None:
        self.map = map
        self._grid, self._radius_m = grid, radius_m

    def reach(self, position_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """See Chart. If the estimated position is not clear, the nearest clear pixel is used in its place."""
        clear = self._grid.clear
        start = nearest_pixel(clear, np.clip(self._grid.to_pixel(position_m[:2]), 0, np.array(clear.shape) - 0.5))
        ends = self._grid.to_pixel(points_m[:, :2])
        visible = False if start is None else sees(clear, np.broadcast_to(start, ends.shape), ends)
        return np.where(visible, np.linalg.norm(points_m[:, :2] - position_m[:2], axis=1), np.inf)

    def roomy(self) -> FloorChart:
        return self._restrict(self._grid.clearance_m >= self._radius_m + ROOM_M)

    def stopped(self, T_world_pano: np.ndarray, again: bool) -> FloorChart:
        """See Chart. A first collision near a wall or obstacle of the masks may result from a small deviation from the
        path, and changes nothing. For any other collision, an obstacle that is not in the masks is assumed: a disc
        around it is blocked, and the edges of the map are computed again."""
        yaw_rad = pose_yaw(T_world_pano)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        next_pixel, centre = (
            self._grid.to_pixel(T_world_pano[:2, 3] + distance_m * ahead) for distance_m in (AHEAD_M, BUMP_AHEAD_M)
        )
        inside = ((next_pixel >= 0) & (next_pixel < self._grid.clear.shape)).all()
        if not inside or (not again and self._grid.clearance_m[cell(next_pixel)] < CLEAR_M):
            return self
        row, column = np.indices(self._grid.clear.shape)
        distance_m = np.hypot(row + 0.5 - centre[0], column + 0.5 - centre[1]) * self._grid.floor.resolution_m
        return self._restrict(distance_m >= BUMP_M)

    def _restrict(self, free: np.ndarray) -> FloorChart:
        """Return the chart whose clear pixels are limited to `free` (rows, columns) bool. Nodes on other pixels are
        removed, and the edges are computed again."""
        grid = copy(self._grid)
        grid.clear = grid.clear & free
        return FloorChart(_rebuild(self.map, grid), grid, self._radius_m)


def _rebuild(map: TopologicalMap, grid: FloorGrid) -> TopologicalMap:
    """Return the map without nodes on pixels of the grid that are not clear, and with new edges over clear pixels."""
    pixels = grid.to_pixel(np.array([node.xyz_m[:2] for node in map.nodes]))
    clear = [number for number, pixel in enumerate(pixels) if grid.clear[cell(pixel)]]
    names, pixels = [map.nodes[number].id for number in clear], pixels[clear]
    pairs = sight_pairs(grid, pixels)
    paths = [(i, j, pixels[[i, j]]) for i, j in pairs] + joining_paths(grid, pixels, components(len(pixels), pairs))
    edges = tuple(make_edge(grid, names[i], names[j], corners) for i, j, corners in paths)
    return replace(map, nodes=tuple(map.nodes[number] for number in clear), edges=edges)
