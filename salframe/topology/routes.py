"""Ways through a map: from a node, a place or an estimated position, as legs and as what to do at each corner."""

from __future__ import annotations

import itertools
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from salframe.framework.components.defaults import default_of
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, NoRoute, UnknownName, unknown
from salframe.panoramas.floors import find_floor
from salframe.panoramas.geometry import wrap_angle
from salframe.topology.edges import joining_paths, make_edge
from salframe.topology.grid import FloorGrid, cell, nearest_pixel, sees
from salframe.topology.planner import Planner, Route
from salframe.topology.topological_map import MapNode, NodeKind, TopologicalMap
from salframe.topology.transitions import close_doorways

HERE = "here"
"""The id of the node that `with_position` adds."""


@dataclass(frozen=True)
class Step:
    """Turn by turn_rad (left is positive; None where the heading is not known), then walk length_m straight at
    azimuth_rad in the world, to the node `to`, or to a corner where that is None."""

    to: str | None
    length_m: float
    azimuth_rad: float
    turn_rad: float | None

    def __str__(self) -> str:
        towards = f"walk {self.length_m:.1f} m to {self.to or 'the corner'}"
        if self.turn_rad is None:
            return f"face {np.degrees(self.azimuth_rad):.0f} deg, {towards}"
        turn_deg = round(float(np.degrees(self.turn_rad)))
        side = "left" if turn_deg > 0 else "right"
        return f"turn {side} {abs(turn_deg)} deg, {towards}" if turn_deg else f"straight on, {towards}"


def directions(route: Route, heading_rad: float | None = None) -> list[Step]:
    """The straight stretches of a route, the first turn from heading_rad (azimuth in the world), each further one from
    the stretch before."""
    steps: list[tuple[str | None, float, float]] = []
    for leg in route.legs:
        if not leg.path_m:
            steps.append((leg.end, leg.length_m, leg.azimuth_rad))
            continue
        along = np.diff(leg.path_m, axis=0)
        ends = [*[None] * (len(along) - 1), leg.end]
        steps += [(to, float(np.hypot(x, y)), float(np.arctan2(y, x))) for to, (x, y) in zip(ends, along, strict=True)]
    made = []
    for to, length_m, azimuth_rad in steps:
        turn_rad = (
            None if heading_rad is None else -float(wrap_angle(heading_rad - azimuth_rad))
        )  # (-pi, pi]: half a turn is to the left
        made.append(Step(to, length_m, azimuth_rad, turn_rad))
        heading_rad = azimuth_rad
    return made


def find_nodes(topology: TopologicalMap, name: str, doors: bool = False) -> list[str]:
    """The node of this id, or the scene nodes of the place of this name, its doors where it has none or `doors` asks
    for them.

    Raises UnknownName with the closest one.
    """
    ids = [node.id for node in topology.nodes]
    if name in ids:
        return [name]
    there = [node for node in topology.nodes if name in node.regions]
    if not there:
        places = sorted({region for node in topology.nodes for region in node.regions})
        raise UnknownName(unknown("node or place", name, [*places, *sorted(set(ids) - set(places))]))
    scenes = [node.id for node in there if node.kind is NodeKind.SCENE]
    at_doors = [node.id for node in there if node.kind is NodeKind.TRANSITION]
    return (at_doors or scenes) if doors else (scenes or at_doors)


def find_route(topology: TopologicalMap, start: str, goal: str, planner: str | None = None) -> Route:
    """The shortest route between two nodes or places, by the planner of this name. Raises NoRoute, UnknownName.

    A place is left and reached at whichever of its scene nodes makes the route shortest; where furniture shuts all of
    them in, at its doors.
    """
    made = cast(Planner, registry().get("planner", planner or default_of("planner"))())
    made.prepare(topology)
    for doors in (False, True):
        routes = []
        for pair in itertools.product(find_nodes(topology, start, doors), find_nodes(topology, goal, doors)):
            with suppress(NoRoute):
                routes.append(made.route(*pair))
        if routes:
            return min(routes, key=lambda route: route.length_m)
    raise NoRoute(f"no route from {start} to {goal}: they lie in parts of the map that no edge joins")


def with_position(topology: TopologicalMap, xyz_m: np.ndarray) -> TopologicalMap:
    """The map with one more node, `here`, below an agent or its camera at xyz_m (3,), on the nearest clear floor where
    it is taken to be in a wall.

    It is joined to every node it sees, and by the shortest way over clear floor where it sees none. Raises DataError
    off all floors, and where no node can be reached.
    """
    number = find_floor(topology.floors, xyz_m)
    if number is None:
        raise DataError(f"the position ({xyz_m[0]:.2f}, {xyz_m[1]:.2f}, {xyz_m[2]:.2f}) m is on no floor of the map")
    floor = topology.floors[number]
    grid = FloorGrid(floor, topology.parameters.robot_radius_m)
    close_doorways(grid, topology.parameters.min_doorway_m)
    pixel = nearest_pixel(grid.clear, grid.to_pixel(xyz_m[:2]))
    others = [node for node in topology.nodes if node.xyz_m[2] == floor.z_m]
    if pixel is None or not others:
        raise DataError(f"the floor at z = {floor.z_m:g} m has no node to walk to")
    pixels = grid.to_pixel(np.array([node.xyz_m[:2] for node in others]))
    seen = sees(grid.clear, np.broadcast_to(pixel, pixels.shape), pixels)
    ways = [(int(node), np.array([pixel, pixels[node]])) for node in np.flatnonzero(seen)]
    if not ways:
        apart = np.array([0] + [1] * len(others))
        ways = [(j - 1, corners) for _, j, corners in joining_paths(grid, np.vstack([pixel, pixels]), apart)]
    if not ways:
        raise DataError(f"no node of the map can be reached from ({xyz_m[0]:.2f}, {xyz_m[1]:.2f}) m over clear floor")
    region = grid.names.get(int(grid.label[cell(pixel)]))
    here = MapNode(HERE, NodeKind.SCENE, grid.world(pixel), () if region is None else (region,))
    edges = [make_edge(grid, HERE, others[node].id, corners) for node, corners in ways]
    return replace(topology, nodes=(*topology.nodes, here), edges=(*topology.edges, *edges))
