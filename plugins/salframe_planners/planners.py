"""Shortest routes by scipy's graph algorithms (docs/how-to/maps.md#what-the-map-is-made-of)."""

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

_NO_NODE = -9999  # scipy's predecessor of the start and of what cannot be reached


class _GraphPlanner(Planner):
    """Nodes numbered, the shortest edge of each pair as a sparse matrix, and routes read off the nodes before each
    node."""

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
        self._take(coo_matrix((length_m, tuple(ends.T)), (len(self._names),) * 2).tocsr())

    def route(self, start: str, goal: str) -> Route:
        """The shortest route. Raises NoRoute where none leads to the goal, UnknownName on a node that the map does not
        have."""
        for name in (start, goal):
            if name not in self._number:
                raise UnknownName(unknown("node", name, self._names))
        first, last = self._number[start], self._number[goal]
        before = self._before(first)
        walked = [last]
        while walked[-1] != first:
            walked.append(before[walked[-1]])
            if walked[-1] == _NO_NODE:
                raise NoRoute(f"no route from {start} to {goal}: they lie in parts of the map that no edge joins")
        walked.reverse()
        legs = tuple(self._edges[pair] for pair in pairwise(walked))
        return Route(tuple(self._names[number] for number in walked), legs, math.fsum(leg.length_m for leg in legs))

    @abstractmethod
    def _take(self, lengths_m: csr_matrix) -> None:
        """Take the (N, N) sparse matrix of edge lengths in."""

    @abstractmethod
    def _before(self, start: int) -> list[int]:
        """The node before each of the N nodes on the shortest route from `start`."""


class FloydWarshall(_GraphPlanner):
    """Shortest routes between all nodes at once by Floyd and Warshall, as in the paper."""

    name = "floyd-warshall"
    version = "1"

    def _take(self, lengths_m: csr_matrix) -> None:
        from scipy.sparse.csgraph import floyd_warshall

        self._all_before = floyd_warshall(lengths_m, return_predecessors=True)[1].tolist()

    def _before(self, start: int) -> list[int]:
        return self._all_before[start]


class Dijkstra(_GraphPlanner):
    """Shortest routes by Dijkstra, from one start when it is asked for: for large, sparse maps."""

    name = "dijkstra"
    version = "1"

    def _take(self, lengths_m: csr_matrix) -> None:
        self._lengths_m = lengths_m

    def _before(self, start: int) -> list[int]:
        from scipy.sparse.csgraph import dijkstra

        return dijkstra(self._lengths_m, indices=start, return_predecessors=True)[1].tolist()
