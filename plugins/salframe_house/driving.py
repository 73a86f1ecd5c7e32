"""Driven queries: views along a shortest path through free space that ends at the query."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from salframe.topology.grid import FloorGrid, cell, nearest_pixel, pixel_graph
from salframe_house.building import Building
from salframe_house.frames import CLEARANCE_M, HouseFrame

STEP_M = 0.5
"""Distance in metres from one view to the next along the path."""
MIN_STEPS = 11
"""Minimum number of steps of a path. A query with fewer views takes only the last views of the path."""
_START_TOLERANCE_M = 0.05
_SMOOTHING_M = 0.3  # length of the path over which a heading is measured


class Drives:
    """Generates random paths through a building, along which a moving camera takes the views of queries."""

    def __init__(self, building: Building, seed: int) -> None:
        """Create the drives through a building as the queries see it."""
        self._grid = FloorGrid(building.floor_masks(), CLEARANCE_M)
        self._centres = np.argwhere(self._grid.clear) + 0.5
        self._number = np.full(self._grid.clear.shape, -1)
        self._number[self._grid.clear] = np.arange(len(self._centres))
        self._graph: csr_matrix = pixel_graph(self._grid.clear)
        self._seed = (building.seed, seed, 7)

    def drive(self, query: HouseFrame, num_views: int) -> list[HouseFrame]:
        """Return the views of a query, STEP_M apart, in the order in which they are taken.

        The path is the shortest path from a random point to the query. It has at least MIN_STEPS steps. If no point is
        that far away, the path begins at the farthest point, and its views may be less than STEP_M apart. Every view
        looks along the path.

        Args:
            query: The query. The last view has its id and position.
            num_views: Number of views, at least 2.
        """
        resolution_m = self._grid.floor.resolution_m
        end = nearest_pixel(self._grid.clear, self._grid.to_pixel(np.array([query.x_m, query.y_m])))
        if end is None:
            raise AssertionError(
                f"the building of the query {query.id} has no free floor on which the camera can drive"
            )
        length = max(num_views - 1, MIN_STEPS) * STEP_M / resolution_m
        distance, before = dijkstra(
            self._graph, indices=self._number[cell(end)], limit=length + 1, return_predecessors=True
        )
        distance[~np.isfinite(distance)] = -np.inf
        far = np.flatnonzero(distance >= min(length, distance.max()) - _START_TOLERANCE_M / resolution_m)
        pixel = int(np.random.default_rng((*self._seed, zlib.crc32(query.id.encode()))).choice(far))
        path = [pixel]
        while before[path[-1]] >= 0:
            path.append(int(before[path[-1]]))
        points_m = self._grid.to_metres(self._centres[path])
        points_m[-1] = query.x_m, query.y_m
        return self._views(query, points_m, num_views)

    def _views(self, query: HouseFrame, points_m: np.ndarray, num_views: int) -> list[HouseFrame]:
        """Return views at equal distances along the last part of the path `points_m` (P, 2), each looking along it."""
        along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])

        def at(distance_m: float) -> np.ndarray:
            return np.array([np.interp(distance_m, along_m, points_m[:, axis]) for axis in range(2)])

        views = []
        first_m = max(along_m[-1] - (num_views - 1) * STEP_M, 0.0)
        for number, distance_m in enumerate(np.linspace(first_m, along_m[-1], num_views)):
            start_m = min(distance_m, max(along_m[-1] - _SMOOTHING_M, 0.0))
            x, y = at(start_m + _SMOOTHING_M) - at(start_m)
            position = at(float(distance_m))
            back = num_views - 1 - number
            views.append(
                replace(
                    query,
                    id=f"{query.id}-{back}-before" if back else query.id,
                    place=self._place(position) if back else query.place,
                    x_m=round(float(position[0]), 4),
                    y_m=round(float(position[1]), 4),
                    yaw_rad=round(math.atan2(y, x), 6),
                )
            )
        return views

    def _place(self, xy_m: np.ndarray) -> str:
        """Return the room at a position; outside all rooms, the nearest room."""
        label = self._grid.label
        pixel = nearest_pixel(label > 0, self._grid.to_pixel(xy_m))
        if pixel is None:
            raise AssertionError("the building has no rooms, expected at least one")
        return self._grid.names[int(label[cell(pixel)])]


def drive_all(building: Building, queries: Sequence[HouseFrame], num_views: int, seed: int) -> list[list[HouseFrame]]:
    """Return the views of each query (see `Drives.drive`)."""
    drives = Drives(building, seed)
    return [drives.drive(query, num_views) for query in queries]
