"""Conformance rules for components of the role `planner`."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from salframe.framework.errors import NoRoute
from salframe.testing.expectations import call_twice, expect
from salframe.testing.rules import Rules
from salframe.topology.planner import Planner, Route
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap

PLACES = {
    "hall": (0.0, 0.0, 0.0),
    "door": (3.0, 0.0, 0.0),
    "room": (3.0, 4.0, 0.0),
    "yard": (-9.0, 0.0, 0.0),
    "island": (50.0, 0.0, 0.0),
}
WALKS = (("hall", "door"), ("door", "room"), ("hall", "yard"), ("yard", "room"))
BEND = ((3.0, 0.0), (3.0, 2.0), (3.0, 4.0))
"""Path from the door to the room, which has a bend. The other paths are straight."""


class PlannerRules(Rules[Planner]):
    """The planner returns the shortest route, with legs in walking direction. A route to its start has no leg, and an
    unreachable goal raises NoRoute."""

    @cached_property
    def _planner(self) -> Planner:
        nodes = tuple(MapNode(name, NodeKind.SCENE, xyz_m, (name,)) for name, xyz_m in PLACES.items())
        edges = tuple(
            replace(_walk(*walk), path_m=BEND) if walk == ("door", "room") else _walk(*walk) for walk in WALKS
        )
        planner = self.make()
        call_twice("prepare", planner.prepare, TopologicalMap(nodes, edges))
        return planner

    def the_shortest_route_is_returned(self) -> None:
        self._check_route("hall", "room", ("hall", "door", "room"))

    def the_reverse_route_is_returned(self) -> None:
        self._check_route("room", "hall", ("room", "door", "hall"))

    def a_route_to_its_start_has_no_leg(self) -> None:
        self._check_route("hall", "hall", ("hall",))

    def an_unreachable_goal_raises_no_route(self) -> None:
        try:
            self._planner.route("hall", "island")
        except NoRoute:
            return
        expect(False, "route to a node without edges", "a route", "NoRoute")

    def _check_route(self, start: str, goal: str, through: tuple[str, ...]) -> None:
        checked = f"route from {start} to {goal}"
        route: Route = call_twice(checked, self._planner.route, start, goal)
        expect(isinstance(route, Route), checked, type(route).__name__, "Route")
        expect(route.nodes == through, checked, f"{route.nodes}", f"the shortest route, {through}")
        legs = [(leg.start, leg.end) for leg in route.legs]
        expect(legs == list(pairwise(through)), checked, f"the legs {legs}", "one leg from each node to the next")
        length_m = sum(_walk(*leg).length_m for leg in legs)
        expect(abs(route.length_m - length_m) < 1e-9, checked, f"a length of {route.length_m} m", f"{length_m} m")
        for leg in route.legs:
            _check_leg(checked, leg)


def _check_leg(checked: str, leg: MapEdge) -> None:
    walk = leg.start, leg.end
    off_rad = np.angle(np.exp(1j * (leg.azimuth_rad - _walk(*walk).azimuth_rad)))
    received = f"azimuth {leg.azimuth_rad:.4f} from {leg.start} to {leg.end}"
    expect(abs(off_rad) < 1e-9, checked, received, f"{_walk(*walk).azimuth_rad:.4f}, the walking direction")
    path_m = {("door", "room"): BEND, ("room", "door"): BEND[::-1]}.get(walk, ())
    received = f"the path {leg.path_m} from {leg.start} to {leg.end}"
    expect(leg.path_m == path_m, checked, received, f"{path_m}, in the walking direction")


def _walk(start: str, end: str) -> MapEdge:
    along = np.subtract(PLACES[end], PLACES[start])
    return MapEdge(start, end, float(np.linalg.norm(along)), float(np.arctan2(along[1], along[0])))
