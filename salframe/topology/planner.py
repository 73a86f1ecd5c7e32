"""The role `planner`: shortest routes on a topological map."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from salframe.framework.component import Role
from salframe.topology.topological_map import MapEdge, TopologicalMap


@dataclass(frozen=True)
class Route:
    """A shortest route: nodes in order, one leg from each to the next as it is walked, total length_m."""

    nodes: tuple[str, ...]
    legs: tuple[MapEdge, ...]
    length_m: float


class Planner(Role):
    """Plans routes on a topological map."""

    role = "planner"

    @abstractmethod
    def prepare(self, map: TopologicalMap) -> None:
        """Take a map in; called once before `route`."""

    @abstractmethod
    def route(self, start: str, goal: str) -> Route:
        """The shortest route between two nodes. Raises NoRoute."""
