"""Plan the route of a request: from a pose, a place or a reference frame to a place or a point."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

import numpy as np

from salframe.framework.errors import DataError, shorten
from salframe.serving.problems import Problem
from salframe.serving.schemas import RouteGoal, RouteStart, StartPose
from salframe.serving.served_map import ServedMap
from salframe.topology.planner import Route
from salframe.topology.routes import HERE, find_route, route_json, with_position
from salframe.topology.topological_map import TopologicalMap

POINT = "point"
"""Id of the node at the point where a route ends."""


def plan_route(served: ServedMap, start: RouteStart, goal: RouteGoal) -> dict[str, Any]:
    """Return the shortest route as JSON.

    Raises:
        Problem: 409 if the map has no topology, or if no route can start at this pose or frame.
        NoRoute: Start and goal are not connected.
        UnknownName: There is no such node or place.
        DataError: The point is on no floor.
    """
    topology = served.topology
    if topology is None:
        raise Problem(
            HTTPStatus.CONFLICT,
            "the map has no topology (graph for routes): build the map again without --no-topology, from data with "
            "floor masks (images of the free floor) or range images",
        )
    first, heading_rad = start.place or "", None
    if start.pose is not None:
        try:
            topology, first = with_position(topology, _position(start.pose)), HERE
        except DataError as error:
            raise Problem(HTTPStatus.CONFLICT, f"no route starts at this pose: {error}") from None
        heading_rad = None if start.pose.yaw_deg is None else float(np.radians(start.pose.yaw_deg))
    elif start.frame is not None:
        first = _node_of_frame(topology, start.frame)
    last = goal.place or ""
    if goal.point is not None:
        topology, last = with_position(topology, _position(goal.point), POINT), POINT
    route = find_route(topology, first, last)
    return {**route_json(route, heading_rad), "line": _line(topology, route)}


def _position(pose: StartPose) -> np.ndarray:
    return np.array([pose.x_m, pose.y_m, pose.z_m])


def _node_of_frame(topology: TopologicalMap, frame: str) -> str:
    """Return the id of the node of a reference frame. Raises Problem 409 if the frame has no node."""
    for node in topology.nodes:
        if frame in node.frames:
            return node.id
    raise Problem(
        HTTPStatus.CONFLICT,
        f"no route starts at the reference frame {shorten(repr(frame))}, because it has no node in the topology (graph "
        "for routes): send `pose` or `place` instead of `frame`",
    )


def _line(topology: TopologicalMap, route: Route) -> list[list[float]]:
    """Return the corners (x, y, z) of a route in the world frame, in metres."""
    xyz_m = {node.id: node.xyz_m for node in topology.nodes}
    line = [list(xyz_m[route.nodes[0]])]
    for leg in route.legs:
        z_m = xyz_m[leg.end][2]
        line += [[x, y, z_m] for x, y in leg.path_m[1:-1]]
        line.append(list(xyz_m[leg.end]))
    return line
