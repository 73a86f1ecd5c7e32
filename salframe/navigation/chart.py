"""What an agent knows of a building: the topological map, where it can walk straight, and what it has bumped into."""

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
"""An agent that is a little off its line keeps this much farther from walls than its radius, where it can."""
AHEAD_M, CLEAR_M = 0.1, 0.30
"""What stops an agent where the masks have this clearance, so much farther ahead, is something they do not show."""
BUMP_M, BUMP_AHEAD_M = 0.2, 0.3
"""Radius of the disc that an agent keeps out of after such a collision, and how far ahead its centre is: more takes
more bumps to learn."""


class Chart(ABC):
    """A building as an agent knows it. Positions are those of agents, points of the map lie on the floor below."""

    map: TopologicalMap
    max_move_m: ClassVar[float]
    """An agent looks again after walking this far."""
    aside_m: ClassVar[float]
    """How far an agent steps aside where it cannot go on."""

    @abstractmethod
    def reach(self, position_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """(N,) metres straight from a position (3,) to points (N, 3), inf where one cannot walk straight."""

    def spot(self, position_m: np.ndarray) -> np.ndarray:
        """Where an agent at this position (3,), as believed, must be: here there, for it may be anywhere."""
        return position_m

    def roomy(self) -> Chart:
        """The chart of what can be walked with room to spare, which may leave parts of the building out of reach."""
        return self

    def stopped(self, T_world_pano: np.ndarray, again: bool) -> Chart:
        """The chart after a collision on the way ahead, at a pose as the agent believes it: another one where that
        tells something new.

        `again`: it has been stopped hereabouts before.
        """
        return self


class FloorChart(Chart):
    """The masks of a floor, and discs that turned out not to be free."""

    max_move_m = 2.0
    aside_m = 0.3

    def __init__(self, map: TopologicalMap, grid: FloorGrid, radius_m: float) -> None:
        self.map = map
        self._grid, self._radius_m = grid, radius_m

    def reach(self, position_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """See Chart. A position that is not clear, as estimates may be, sees what the nearest clear pixel does."""
        clear = self._grid.clear
        start = nearest_pixel(clear, np.clip(self._grid.to_pixel(position_m[:2]), 0, np.array(clear.shape) - 0.5))
        ends = self._grid.to_pixel(points_m[:, :2])
        seen = False if start is None else sees(clear, np.broadcast_to(start, ends.shape), ends)
        return np.where(seen, np.linalg.norm(points_m[:, :2] - position_m[:2], axis=1), np.inf)

    def roomy(self) -> FloorChart:
        return self._narrowed(self._grid.clearance_m >= self._radius_m + ROOM_M)

    def stopped(self, T_world_pano: np.ndarray, again: bool) -> FloorChart:
        """See Chart. Near a wall or obstacle of the masks the agent may have been but a little off its line, once;
        elsewhere, or again, there is something that they do not show, and the map's edges are made again around it."""
        yaw_rad = pose_yaw(T_world_pano)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        next_pixel, centre = (
            self._grid.to_pixel(T_world_pano[:2, 3] + reach_m * ahead) for reach_m in (AHEAD_M, BUMP_AHEAD_M)
        )
        inside = ((next_pixel >= 0) & (next_pixel < self._grid.clear.shape)).all()
        if not inside or (not again and self._grid.clearance_m[cell(next_pixel)] < CLEAR_M):
            return self
        row, column = np.indices(self._grid.clear.shape)
        away_m = np.hypot(row + 0.5 - centre[0], column + 0.5 - centre[1]) * self._grid.floor.resolution_m
        return self._narrowed(away_m >= BUMP_M)

    def _narrowed(self, free: np.ndarray) -> FloorChart:
        """The chart of what is clear and free; the map's nodes that are, with edges made again."""
        grid = copy(self._grid)
        grid.clear = grid.clear & free
        return FloorChart(_made_again(self.map, grid), grid, self._radius_m)


def _made_again(map: TopologicalMap, grid: FloorGrid) -> TopologicalMap:
    """The map's nodes that are still clear, with edges over what is clear now."""
    pixels = grid.to_pixel(np.array([node.xyz_m[:2] for node in map.nodes]))
    clear = [number for number, pixel in enumerate(pixels) if grid.clear[cell(pixel)]]
    names, pixels = [map.nodes[number].id for number in clear], pixels[clear]
    pairs = sight_pairs(grid, pixels)
    ways = [(i, j, pixels[[i, j]]) for i, j in pairs] + joining_paths(grid, pixels, components(len(pixels), pairs))
    edges = tuple(make_edge(grid, names[i], names[j], corners) for i, j, corners in ways)
    return replace(map, nodes=tuple(map.nodes[number] for number in clear), edges=edges)
