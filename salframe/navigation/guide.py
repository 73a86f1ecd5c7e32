"""Shortest paths along the map of a chart, from any position to a node."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.errors import NoRoute
from salframe.navigation.chart import Chart
from salframe.topology.planner import Planner
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap

REACHED_M = 0.1
"""Maximum distance in metres from a corner of the path at which the corner is treated as reached."""
ENTERED_M = 0.3
"""Maximum distance in metres from the start of stairs or of a lift at which the agent takes them."""


@dataclass(frozen=True, eq=False)
class WalkingPath:
    """A path to walk.

    Attributes:
        length_m: Length in metres.
        corners_m: (K, 3) corners of the path on the floor. The first corner is the node where the path enters the map.
            The last corner is the goal.
        edges: The K - 1 edges between the corners.
    """

    length_m: float
    corners_m: np.ndarray
    edges: tuple[MapEdge, ...]

    def leg(self, position_m: np.ndarray) -> np.ndarray | MapEdge:
        """Return the horizontal vector (2,) in metres from a position (3,) to the first corner that is not reached; to
        the goal if all corners are reached. If the position is at the start of stairs or of a lift, return their
        edge."""
        legs_m = self.corners_m[:, :2] - position_m[:2]
        for leg_m, edge in zip(legs_m, (*self.edges, None), strict=True):
            takes_stairs = edge is not None and bool(edge.storeys)
            if np.linalg.norm(leg_m) > (ENTERED_M if takes_stairs else REACHED_M):
                return leg_m
            if edge is not None and takes_stairs:
                return edge
        return legs_m[-1]


class Guide:
    """Plans paths on the topological map that an agent has of a building. A path may start between its nodes.

    Args:
        chart: What the agent knows about the building; contains the map.
        planner: The configuration of the planner.
    """

    def __init__(self, chart: Chart, planner: ComponentConfig) -> None:
        self.chart, self.planner = chart, planner
        self._planner: Planner = registry().build("planner", planner)
        map = straighten(chart.map)
        self._planner.prepare(map)
        self._point_m = {node.id: np.array(node.xyz_m) for node in map.nodes}

    @cached_property
    def with_margin(self) -> Guide:
        """The guide that plans paths with a safety margin to walls, if the chart has such a margin."""
        return Guide(self.chart.with_margin(), self.planner)

    def shortest_path(self, position_m: np.ndarray, goal: str) -> WalkingPath:
        """Return the shortest path from a position (3,) to a node: straight to a node in reach, then along the map.

        Raises:
            NoRoute: No path leads to the goal.
        """
        names = list(self._point_m)
        straight_m = (
            self.chart.reach(position_m, np.array(list(self._point_m.values()))) if goal in names else np.zeros(0)
        )
        best = None
        for number in np.argsort(straight_m, kind="stable"):
            if straight_m[number] >= (np.inf if best is None else best.length_m):
                break
            try:
                route = self._planner.route(names[number], goal)
            except NoRoute:
                continue
            length_m = float(straight_m[number]) + route.length_m
            if best is None or length_m < best.length_m:
                best = WalkingPath(length_m, np.array([self._point_m[name] for name in route.nodes]), route.legs)
        if best is None:
            x, y, _ = position_m
            raise NoRoute(f"no path leads from ({x:.2f}, {y:.2f}) m to {goal}")
        return best


def straighten(map: TopologicalMap) -> TopologicalMap:
    """Return the map with an additional node at each corner of its edges. All edges are then straight, and a path can
    enter an edge at its corners."""
    nodes, edges = list(map.nodes), []
    z_m = {node.id: node.xyz_m[2] for node in nodes}
    for edge in map.edges:
        if not edge.path_m:
            edges.append(edge)
            continue
        names = [edge.start, *(f"{edge.start} > {edge.end} > {k}" for k in range(1, len(edge.path_m) - 1)), edge.end]
        nodes += [
            MapNode(name, NodeKind.CORNER, (x, y, z_m[edge.start]), ())
            for name, (x, y) in zip(names[1:-1], edge.path_m[1:-1], strict=True)
        ]
        for (start, a), (end, b) in pairwise(zip(names, edge.path_m, strict=True)):
            edges.append(
                MapEdge(
                    start, end, float(np.hypot(b[0] - a[0], b[1] - a[1])), float(np.arctan2(b[1] - a[1], b[0] - a[0]))
                )
            )
    return replace(map, nodes=tuple(nodes), edges=tuple(edges))
