"""The role `planner`: plans shortest routes on a topological map."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from salframe.framework.component import Role
from salframe.topology.topological_map import MapEdge, TopologicalMap


@dataclass(frozen=True)
class Route:
    """A shortest route.

    Attributes:
        nodes: Ids of the nodes, from start to goal.
        legs: The edge from each node to the next, in walking direction.
        length_m: Total length.
    """

    nodes: tuple[str, ...]
    legs: tuple[MapEdge, ...]
    length_m: float


class Planner(Role):
    """Plans routes on a topological map."""

    role = "planner"

    @abstractmethod
    def prepare(self, map: TopologicalMap) -> None:
        """Prepare planning on a map. Called once before `route`."""

    @abstractmethod
    def route(self, start: str, goal: str) -> Route:
        """Return the shortest route between two nodes.

        Raises:
            NoRoute: The map does not connect the nodes.
        """
