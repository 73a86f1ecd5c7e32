"""Shortest routes with the graph algorithms of SciPy (docs/how-to/maps.md#what-the-map-is-made-of)."""

from __future__ import annotations

import math
from abc import abstractmethod
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from salframe.framework.errors import NoRoute, UnknownName, unknown
from salframe.topology.planner import Planner, Route
from salframe.topology.topological_map import MapEdge, TopologicalMap

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

_NO_NODE = -9999
"""Predecessor that SciPy returns for the start and for unreachable nodes."""


class _GraphPlanner(Planner):
    """Base class of planners that compute the predecessor of each node on the shortest routes.

    If there are several edges between two nodes, only the shortest edge is used.
    """

    def prepare(self, map: TopologicalMap) -> None:
        from scipy.sparse import coo_matrix

        self._names = [node.id for node in map.nodes]
        self._number = {name: number for number, name in enumerate(self._names)}
        self._edges: dict[tuple[int, int], MapEdge] = {}
        for edge in map.edges:
            start, end = self._number[edge.start], self._number[edge.end]
            if (start, end) not in self._edges or edge.length_m < self._edges[start, end].length_m:
                self._edges[start, end], self._edges[end, start] = edge, edge.reversed()
        ends = np.array(list(self._edges), int).reshape(-1, 2)
        length_m = np.array([edge.length_m for edge in self._edges.values()])
        self._set_lengths(coo_matrix((length_m, tuple(ends.T)), (len(self._names),) * 2).tocsr())

    def route(self, start: str, goal: str) -> Route:
        """Return the shortest route.

        Raises:
            NoRoute: No route leads to the goal.
            UnknownName: The map has no such node.
        """
        for name in (start, goal):
            if name not in self._number:
                raise UnknownName(unknown("node", name, self._names))
        first, last = self._number[start], self._number[goal]
        predecessors = self._predecessors(first)
        path = [last]
        while path[-1] != first:
            path.append(predecessors[path[-1]])
            if path[-1] == _NO_NODE:
                raise NoRoute(f"no route from {start} to {goal}: the map has no path between them")
        path.reverse()
        legs = tuple(self._edges[pair] for pair in pairwise(path))
        return Route(tuple(self._names[number] for number in path), legs, math.fsum(leg.length_m for leg in legs))

    @abstractmethod
    def _set_lengths(self, lengths_m: csr_matrix) -> None:
        """Store or process the sparse matrix (N, N) of edge lengths in metres."""

    @abstractmethod
    def _predecessors(self, start: int) -> list[int]:
        """Return the predecessor of each of the N nodes on its shortest route from `start`."""


class FloydWarshall(_GraphPlanner):
    """Computes the shortest routes between all pairs of nodes in advance, by the Floyd-Warshall algorithm.

    The paper uses this algorithm.
    """

    name = "floyd-warshall"
    version = "1"

    def _set_lengths(self, lengths_m: csr_matrix) -> None:
        from scipy.sparse.csgraph import floyd_warshall

        self._all_predecessors = floyd_warshall(lengths_m, return_predecessors=True)[1].tolist()

    def _predecessors(self, start: int) -> list[int]:
        return self._all_predecessors[start]


class Dijkstra(_GraphPlanner):
    """Computes each requested route by Dijkstra's algorithm, without preparation.

    Use it for large maps.
    """

    name = "dijkstra"
    version = "1"

    def _set_lengths(self, lengths_m: csr_matrix) -> None:
        self._lengths_m = lengths_m

    def _predecessors(self, start: int) -> list[int]:
        from scipy.sparse.csgraph import dijkstra

        return dijkstra(self._lengths_m, indices=start, return_predecessors=True)[1].tolist()
