"""Routes through a map from a node, a place or an estimated position, as legs and as walking directions."""

from __future__ import annotations

import itertools
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from salframe.framework.components.defaults import default_of
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, NoRoute, UnknownName, unknown
from salframe.graphs.texts import text_key
from salframe.panoramas.floors import find_floor
from salframe.panoramas.geometry import wrap_angle
from salframe.topology.edges import joining_paths, make_edge
from salframe.topology.grid import FloorGrid, cell, has_line_of_sight, nearest_pixel
from salframe.topology.planner import Planner, Route
from salframe.topology.topological_map import EdgeKind, MapEdge, MapNode, NodeKind, TopologicalMap
from salframe.topology.transitions import close_doorways

HERE = "here"
"""Id of the node that `with_position` adds at the position of an agent."""


@dataclass(frozen=True)
class Step:
    """A step of walking directions: turn, then walk straight ahead.

    Attributes:
        to: Id of the node where the step ends; None if it ends between two nodes, where the path bends.
        length_m: Length of the walk in metres.
        azimuth_rad: Azimuth of the walk in the world frame.
        turn_rad: Turn before the walk, positive to the left; None if the heading is unknown.
        kind: Walk, stairs or lift. Stairs and lifts have no turn, and the heading after them is unknown.
        floor: Number of the floor where stairs or a lift end, from 1 for the lowest floor; None for a walk.
    """

    to: str | None
    length_m: float
    azimuth_rad: float
    turn_rad: float | None
    kind: EdgeKind = EdgeKind.WALK
    floor: int | None = None

    def __str__(self) -> str:
        if self.floor is not None:
            return f"take the {self.kind} to floor {self.floor}, to {self.to}"
        towards = f"walk {self.length_m:.1f} m to {self.to or 'the corner'}"
        if self.turn_rad is None:
            return f"face {np.degrees(self.azimuth_rad):.0f} deg, {towards}"
        turn_deg = round(float(np.degrees(self.turn_rad)))
        side = "left" if turn_deg > 0 else "right"
        return f"turn {side} {abs(turn_deg)} deg, {towards}" if turn_deg else f"straight on, {towards}"


def directions(route: Route, heading_rad: float | None = None) -> list[Step]:
    """Return the walking directions along a route.

    Args:
        route: The route.
        heading_rad: Azimuth of the agent in the world frame before the first step; None if it is unknown. The turn of
            each later step is relative to the azimuth of the previous step. The heading after stairs or a lift is
            unknown.
    """
    steps = []
    for leg in route.legs:
        if leg.storeys:
            steps.append(Step(leg.end, leg.length_m, leg.azimuth_rad, None, leg.kind, leg.storeys[1]))
            heading_rad = None
            continue
        for to, length_m, azimuth_rad in _straight_parts(leg):
            turn_rad = (
                None if heading_rad is None else -float(wrap_angle(heading_rad - azimuth_rad))
            )  # in (-pi, pi]: a half turn is to the left
            steps.append(Step(to, length_m, azimuth_rad, turn_rad))
            heading_rad = azimuth_rad
    return steps


def _straight_parts(leg: MapEdge) -> list[tuple[str | None, float, float]]:
    """Return the straight parts of an edge. For each part: the id of the node where it ends (None if it ends at a
    corner), its length in metres, and its azimuth in radians."""
    if not leg.path_m:
        return [(leg.end, leg.length_m, leg.azimuth_rad)]
    along = np.diff(leg.path_m, axis=0)
    ends = [*[None] * (len(along) - 1), leg.end]
    return [(to, float(np.hypot(x, y)), float(np.arctan2(y, x))) for to, (x, y) in zip(ends, along, strict=True)]


def route_json(route: Route, heading_rad: float | None = None) -> dict[str, Any]:
    """Return a route and its walking directions as JSON: lengths in metres, angles in degrees, and each step in words.

    Args:
        route: The route.
        heading_rad: As in `directions`.
    """
    steps = [
        {
            "to": step.to,
            "length_m": step.length_m,
            "azimuth_deg": float(np.degrees(step.azimuth_rad)),
            "turn_deg": None if step.turn_rad is None else float(np.degrees(step.turn_rad)),
            "kind": str(step.kind),
            "floor": step.floor,
            "say": str(step),
        }
        for step in directions(route, heading_rad)
    ]
    return {"nodes": list(route.nodes), "length_m": route.length_m, "steps": steps}


def find_nodes(topology: TopologicalMap, name: str, doors: bool = False) -> list[str]:
    """Return the ids of the nodes that a name refers to: the node with this id, the nodes of the place with this name,
    or the node nearest to the sign with this text.

    Args:
        topology: The map.
        name: Id of a node, name of a place, or text of a sign.
        doors: Whether to return the transition nodes (doorways) of a place instead of its scene nodes (positions in the
            room). If the place has no nodes of the requested kind, its nodes of the other kind are returned.

    Raises:
        UnknownName: There is no such node, place or sign. The message suggests the most similar name.
    """
    ids = [node.id for node in topology.nodes]
    if name in ids:
        return [name]
    there = [node for node in topology.nodes if name in node.regions]
    if not there and text_key(name) in topology.signs:
        return [topology.signs[text_key(name)]]
    if not there:
        places = sorted({region for node in topology.nodes for region in node.regions})
        kind = "node, place or sign" if topology.signs else "node or place"
        raise UnknownName(unknown(kind, name, [*places, *sorted(set(ids) - set(places)), *sorted(topology.signs)]))
    scenes = [node.id for node in there if node.kind is NodeKind.SCENE]
    at_doors = [node.id for node in there if node.kind is NodeKind.TRANSITION]
    return (at_doors or scenes) if doors else (scenes or at_doors)


def find_route(topology: TopologicalMap, start: str, goal: str, planner: str | None = None) -> Route:
    """Return the shortest route between two nodes, places or signs.

    If the start or the goal is a place, the route uses the scene node (position in the room) of this place with the
    shortest route. If no route connects scene nodes, for example because of furniture, transition nodes (positions in
    doorways) of the places are used.

    Args:
        topology: The map.
        start: Id of a node, name of a place, or text of a sign.
        goal: As `start`.
        planner: Name of the planner, None for the default.

    Raises:
        NoRoute: No route connects start and goal.
        UnknownName: There is no such node, place, sign or planner.
    """
    prepared = cast(Planner, registry().get("planner", planner or default_of("planner"))())
    prepared.prepare(topology)
    for doors in (False, True):
        routes = []
        for pair in itertools.product(find_nodes(topology, start, doors), find_nodes(topology, goal, doors)):
            with suppress(NoRoute):
                routes.append(prepared.route(*pair))
        if routes:
            return min(routes, key=lambda route: route.length_m)
    raise NoRoute(f"no route from {start} to {goal}: the map has no path between them")


def with_position(topology: TopologicalMap, xyz_m: np.ndarray, node_id: str = HERE) -> TopologicalMap:
    """Return the map with an additional node below the position of an agent or its camera.

    If the position is inside a wall or obstacle, the node is placed on the nearest clear floor. Edges connect it to
    every node in line of sight. If no node is in line of sight, one edge to another node follows the shortest path over
    clear floor.

    Args:
        topology: The map.
        xyz_m: (3,), position in the world frame.
        node_id: Id of the node.

    Raises:
        DataError: The position is on no floor, or no node can be reached from it.
    """
    number = find_floor(topology.floors, xyz_m)
    if number is None:
        raise DataError(
            f"the position ({xyz_m[0]:.2f}, {xyz_m[1]:.2f}, {xyz_m[2]:.2f}) m is not on a floor of the map, expected a "
            "position inside a floor mask"
        )
    floor = topology.floors[number]
    grid = FloorGrid(floor, topology.parameters.robot_radius_m)
    close_doorways(grid, topology.parameters.min_doorway_m)
    pixel = nearest_pixel(grid.clear, grid.to_pixel(xyz_m[:2]))
    others = [node for node in topology.nodes if find_floor(topology.floors, node.xyz_m) == number]
    if pixel is None or not others:
        missing = "no free space" if pixel is None else "no topology node"
        raise DataError(
            f"the floor at z = {floor.z_m:g} m has {missing}, expected free space and a topology node, which a route "
            "needs"
        )
    pixels = grid.to_pixel(np.array([node.xyz_m[:2] for node in others]))
    visible = has_line_of_sight(grid.clear, np.broadcast_to(pixel, pixels.shape), pixels)
    paths = [(int(node), np.array([pixel, pixels[node]])) for node in np.flatnonzero(visible)]
    if not paths:
        component = np.array([0] + [1] * len(others))
        paths = [(j - 1, corners) for _, j, corners in joining_paths(grid, np.vstack([pixel, pixels]), component)]
    if not paths:
        raise DataError(
            f"no node of the map can be reached from ({xyz_m[0]:.2f}, {xyz_m[1]:.2f}) m: obstacles block every path"
        )
    region = grid.names.get(int(grid.label[cell(pixel)]))
    added = MapNode(node_id, NodeKind.SCENE, grid.world(pixel), () if region is None else (region,))
    edges = [make_edge(grid, node_id, others[node].id, corners) for node, corners in paths]
    return replace(topology, nodes=(*topology.nodes, added), edges=(*topology.edges, *edges))
