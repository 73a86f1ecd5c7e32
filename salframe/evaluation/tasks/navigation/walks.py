"""The trajectories of navigation runs, on the floor plan or the viewpoint graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.page import floor_plan
from salframe.evaluation.tasks.navigation.rows import EpisodeRow
from salframe.evaluation.tasks.navigation.view import NavigationView
from salframe.topology.topological_map import TopologicalMap

MARGIN_M = 1.0
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
    """Return, for JSON, the maps of the worlds of each run, and the finished episodes of each arm."""
    walks = []
    for run, view in enumerate(views):
        episodes = {
            str(number): [
                _episode(row) for row in view.records[entry.method].rows if row is not None and row.path is not None
            ]
            for number, arm in enumerate(arms)
            for entry in arm.entries
            if entry.run == run
        }
        visited = {episode["world"] for rows in episodes.values() for episode in rows}
        worlds = {id: _plan(map) for id, map in view.maps.items() if id in visited}
        walks.append({"name": view.name, "worlds": worlds, "episodes": episodes})
    return walks


def _episode(row: EpisodeRow) -> dict[str, Any]:
    """Return the fields of an episode that a page shows, with positions in centimetre precision."""
    path = [[round(x, 2), round(y, 2)] for x, y, *_ in row.path or ()]
    believed = [None if one is None else [round(one[0], 2), round(one[1], 2)] for one in row.believed or ()]
    return {**row.model_dump(include=SHOWN), "path": path, "believed": believed}


def _plan(map: TopologicalMap) -> dict[str, Any]:
    """Return the background of trajectories: the nodes with the floor plan, or with the edges if there is none."""
    nodes = {node.id: [round(node.xyz_m[0], 3), round(node.xyz_m[1], 3)] for node in map.nodes}
    if map.floors:
        return {**floor_plan(map.floors[0]), "edges": [], "nodes": nodes}
    low, high = np.min(list(nodes.values()), 0) - MARGIN_M, np.max(list(nodes.values()), 0) + MARGIN_M
    edges = [[*nodes[edge.start], *nodes[edge.end]] for edge in map.edges]
    return {
        "picture": None,
        "box": [float(low[0]), float(high[1]), *(high - low).tolist()],
        "edges": edges,
        "nodes": nodes,
    }
