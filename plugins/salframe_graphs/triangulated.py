"""Positions of the objects of reference frames without range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.graphs.boxes import MIN_SIDE_M
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, transform_points
from salframe_graphs.association import ObjectBearings, TriangulatedObjects, triangulate_objects

HIDDEN_LOG = 0.3
"""Mean of ln(projected area of an object / projected area of its visible part). It is `-size_bias_log` of the
likelihood."""


def place_objects(
    graphs: Sequence[SaliencyGraph], frames: Sequence[ReferenceFrame]
) -> list[tuple[Detections, np.ndarray]]:
    """Triangulate the objects that several reference frames show.

    The box of an object is a cube whose projected area agrees with the solid angles of the object.

    Args:
        graphs: The graph of each frame, without range.
        frames: The frames.

    Returns:
        For each frame its N objects with positions, and the variances (N,) of the positions along each horizontal axis.
    """
    if not graphs:
        return []
    rays = _rays(graphs, frames)
    objects = triangulate_objects(rays)
    first = np.cumsum([0, *map(len, graphs)])
    return [
        _objects_of(graph, frame, objects, objects.owner[start:stop])
        for graph, frame, start, stop in zip(graphs, frames, first[:-1], first[1:], strict=True)
    ]


def _rays(graphs: Sequence[SaliencyGraph], frames: Sequence[ReferenceFrame]) -> ObjectBearings:
    """Return the bearings of all objects in the world frame. A transition frame may show objects of several places."""
    number: dict[str, int] = {}
    kinds = {frame.kind for frame in frames}
    group = [
        number.setdefault(frame.place, len(number)) if frame.kind is FrameKind.SCENE or len(kinds) == 1 else -1
        for frame in frames
    ]
    count = [len(graph) for graph in graphs]
    origin_m = np.array([frame.T_world_pano[:3, 3] for frame in frames])
    direction = [graph.bearing @ frame.T_world_pano[:3, :3].T for graph, frame in zip(graphs, frames, strict=True)]
    return ObjectBearings(
        np.repeat(np.arange(len(frames)), count),
        np.array(group),
        np.array([label for graph in graphs for label in graph.labels], object),
        np.repeat(origin_m, count, 0),
        np.concatenate(direction),
        np.concatenate([graph.solid_angle_sr for graph in graphs]),
    )


def _objects_of(
    graph: SaliencyGraph, frame: ReferenceFrame, objects: TriangulatedObjects, owner: np.ndarray
) -> tuple[Detections, np.ndarray]:
    """Return the objects of a reference frame that have a position, in its panorama frame, and their variances."""
    nodes = np.flatnonzero(owner >= 0)
    owner = owner[nodes]
    # The mean projected area of a cube is 1.5 times the area of a side.
    side_m = np.sqrt(np.exp(objects.log_area[owner] + HIDDEN_LOG) / 1.5)
    side_m = np.maximum(np.nan_to_num(side_m, nan=MIN_SIDE_M), MIN_SIDE_M)
    detections = Detections(
        tuple(graph.labels[node] for node in nodes),
        graph.scores[nodes],
        transform_points(invert_pose(frame.T_world_pano), objects.position_m[owner]),
        np.repeat(side_m[:, None], 3, 1),
        np.zeros(len(nodes)),
        solid_angle_sr=graph.solid_angle_sr[nodes],
    )
    return detections, np.trace(objects.covariance_m2[owner][:, :2, :2], axis1=1, axis2=2) / 2
