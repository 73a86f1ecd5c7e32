"""The next view of a camera in a map with a topology: a turn on the spot, or a walk to a node."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from salframe.framework.errors import DataError
from salframe.localization.answers import Localization
from salframe.localization.next_view import NextView, best_view
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw, wrap_angle
from salframe.topology.routes import HERE, with_position
from salframe.topology.topological_map import TopologicalMap


def next_view_in(topology: TopologicalMap, answer: Localization) -> NextView | None:
    """Return the turn or the walk whose view is expected to tell the likely places apart best.

    Walks lead straight from the estimated pose to a node in line of sight. The same motion is assumed in every likely
    place. Without a pose on a floor of the map, only turns are compared.

    Args:
        topology: The topological map.
        answer: The answer of the localization map.

    Returns:
        The motion; None if neither a turn nor a walk is possible, or for a method without `Localizer.place_poses`.
    """
    predictor, T_world_query = answer.view_predictor, answer.T_world_query
    if predictor is None:
        return None
    turn = predictor.turn()
    views = [] if turn is None else [turn]
    if T_world_query is None:
        return turn
    with suppress(DataError):  # the pose is on no floor
        topology = with_position(topology, T_world_query[:3, 3])
        position_m = {node.id: node.xyz_m for node in topology.nodes}
        for edge in sorted((edge for edge in topology.edges if edge.start == HERE), key=lambda edge: edge.length_m):
            x_m, y_m, _ = position_m[edge.end]
            if edge.path_m or np.allclose([x_m, y_m], T_world_query[:2, 3]):
                continue
            T_world_next = pose_2d(x_m, y_m, edge.azimuth_rad, T_world_query[2, 3])
            turn_deg = float(np.degrees(wrap_angle(edge.azimuth_rad - pose_yaw(T_world_query))))
            expected = predictor.expected_entropy(invert_pose(T_world_query) @ T_world_next)
            views.append(NextView(turn_deg, expected, predictor.entropy, edge.end, edge.length_m))
    return best_view(views)
