"""The role `planner`: plans shortest routes on a topological map."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from salframe.framework.component import Role
from salframe.topology.topological_map import MapEdge, TopologicalMap


@dataclass(frozen=True)
class Route:
    """A shortest route.

    Attributes:
        nodes: Ids of the nodes, from start to goal.
        legs: The edge from each node to the next, in walking direction.
        length_m: Total length in metres.
    """

    nodes: tuple[str, ...]
    legs: tuple[MapEdge, ...]
    length_m: float

    def _repr_html_(self) -> str:
        """Return the route as HTML for notebooks: a table of its legs, and a drawing viewed from above, with the x axis
        to the right."""
        from salframe.framework.markup import PlanDrawing, element, table, to_html

        rows = [[leg.start, leg.end, f"{leg.length_m:.2f}", f"{np.degrees(leg.azimuth_rad):.0f}"] for leg in self.legs]
        ends = f"{self.nodes[0]} to {self.nodes[-1]}: " if self.nodes else ""
        parts = [element("p", f"{ends}{self.length_m:.2f} m")]
        if self.legs:
            lines_m = [np.zeros((1, 2))]
            for leg in self.legs:
                line_m = np.array(leg.path_m) if leg.path_m else _straight(leg)
                lines_m.append(line_m - line_m[0] + lines_m[-1][-1])
            drawing = PlanDrawing(np.concatenate(lines_m), 320, "the route from above")
            drawing.line(np.concatenate(lines_m), stroke="#1f4ea0", stroke_width="2")
            for id, line_m in zip(self.nodes, lines_m, strict=True):
                drawing.dot(line_m[-1], 4, id, fill="#1f4ea0", stroke="#ffffff")
            parts += [table(["from", "to", "length (m)", "azimuth (deg)"], rows), drawing.svg]
        return to_html(*parts)


def _straight(leg: MapEdge) -> np.ndarray:
    """Return the two ends (2, 2) of a straight edge that is moved to start at the origin."""
    return leg.length_m * np.array([(0.0, 0.0), (np.cos(leg.azimuth_rad), np.sin(leg.azimuth_rad))])


class Planner(Role):
    """Plans routes between the nodes of a topological map."""

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
