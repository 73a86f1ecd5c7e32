"""The trajectories of navigation runs, on the floor plan or the viewpoint graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.page import floor_plan
from salframe.evaluation.tasks.navigation.rows import EpisodeRow
from salframe.evaluation.tasks.navigation.view import NavigationView
from salframe.navigation.chart import nearest_floor
from salframe.panoramas.floors import FloorMasks
from salframe.topology.topological_map import TopologicalMap

MARGIN_M = 1.0
"""Margin around a plan, and between two floors."""
SHOWN = {
    "episode",
    "world",
    "goal",
    "status",
    "success",
    "shortest_m",
    "travelled_m",
    "left_m",
    "panoramas",
    "collisions",
}
"""Fields of an episode that a page shows."""


def list_walks(arms: Sequence[Arm], views: Sequence[NavigationView]) -> list[dict[str, Any]]:
    """Return, for JSON, the maps of the worlds (buildings) of each run, and the finished episodes of each arm (a method
    with its settings).

    The floors of a world are drawn beside each other, the lowest one on the left.
    """
    walks = []
    for run, view in enumerate(views):
        plans = {id: WalkPlan(map) for id, map in view.maps.items()}
        episodes = {
            str(number): [
                _episode(row, plans[row.world])
                for row in view.records[entry.method].rows
                if row is not None and row.path is not None
            ]
            for number, arm in enumerate(arms)
            for entry in arm.entries
            if entry.run == run
        }
        visited = {episode["world"] for rows in episodes.values() for episode in rows}
        worlds = {id: plan.background() for id, plan in plans.items() if id in visited}
        walks.append({"name": view.name, "worlds": worlds, "episodes": episodes})
    return walks


def _episode(row: EpisodeRow, plan: WalkPlan) -> dict[str, Any]:
    """Return the fields of an episode that a page shows, with positions in centimetre precision."""
    path = [plan.point(one, 2) for one in row.path or ()]
    believed = [None if one is None else plan.point(one, 2) for one in row.believed or ()]
    return {**row.model_dump(include=SHOWN), "path": path, "believed": believed}


class WalkPlan:
    """A map seen from above, with its floors beside each other."""

    def __init__(self, map: TopologicalMap) -> None:
        self._map = map
        widths_m = [floor.region.shape[1] * floor.resolution_m + MARGIN_M for floor in map.floors]
        lefts_m = np.concatenate([[0.0], np.cumsum(widths_m)[:-1]]) if map.floors else np.zeros(0)
        first_m = map.floors[0].origin_m[0] if map.floors else 0.0
        self._shifts_m = [first_m + left - floor.origin_m[0] for left, floor in zip(lefts_m, map.floors, strict=True)]

    def point(self, xyz_m: Sequence[float], digits: int) -> list[float]:
        """Return the rounded position (x, y) of a point (x, y, z) or pose (x, y, z, yaw) on the plan."""
        floors = self._map.floors
        shift_m = self._shifts_m[nearest_floor(floors, np.array(xyz_m[:3]))] if floors else 0.0
        return [round(float(xyz_m[0] + shift_m), digits), round(float(xyz_m[1]), digits)]

    def background(self) -> dict[str, Any]:
        """Return the nodes with the floor plan, or with the edges if there are no floors, for JSON."""
        nodes = {node.id: self.point(node.xyz_m, 3) for node in self._map.nodes}
        if self._map.floors:
            shifted = [
                replace(floor, origin_m=(floor.origin_m[0] + shift_m, floor.origin_m[1]))
                for floor, shift_m in zip(self._map.floors, self._shifts_m, strict=True)
            ]
            return {**floor_plan(_beside(shifted)), "floors": len(shifted), "edges": [], "nodes": nodes}
        low, high = np.min(list(nodes.values()), 0) - MARGIN_M, np.max(list(nodes.values()), 0) + MARGIN_M
        edges = [[*nodes[edge.start], *nodes[edge.end]] for edge in self._map.edges]
        return {
            "picture": None,
            "floors": 0,
            "box": [float(low[0]), float(high[1]), *(high - low).tolist()],
            "edges": edges,
            "nodes": nodes,
        }


def _beside(floors: Sequence[FloorMasks]) -> FloorMasks:
    """Return the masks of floors that lie beside each other, from left to right, as the masks of one floor."""
    resolution_m, left_m = floors[0].resolution_m, floors[0].origin_m[0]
    top_m = max(floor.origin_m[1] for floor in floors)
    corners = [
        (round((top_m - floor.origin_m[1]) / resolution_m), round((floor.origin_m[0] - left_m) / resolution_m))
        for floor in floors
    ]
    ends = np.add(corners, [floor.region.shape for floor in floors])
    free, region, obstacle = (np.zeros(ends.max(0), dtype) for dtype in (bool, np.int32, bool))
    regions: dict[int, str] = {}
    for floor, (row, column), (last_row, last_column) in zip(floors, corners, ends.tolist(), strict=True):
        at, count = (slice(row, last_row), slice(column, last_column)), max(int(region.max()), *regions, 0)
        free[at], obstacle[at] = floor.free, floor.obstacle
        region[at] = np.where(floor.region > 0, floor.region + count, 0)
        regions |= {label + count: place for label, place in floor.regions.items()}
    return FloorMasks(free, region, obstacle, resolution_m, (left_m, top_m), regions)
