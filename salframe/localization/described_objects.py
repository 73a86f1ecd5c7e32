"""The objects of a panorama, from its description, if the description is a saliency graph."""

from __future__ import annotations

import numpy as np

from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import GRAPH_ARRAYS, graph_from_arrays
from salframe.localization.level_frames import split_level
from salframe.localization.localizer import Description

_CORNERS = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T


def described_objects(description: Description) -> tuple[SaliencyGraph, Detections] | None:
    """Return the saliency graph of a description, and its nodes as detections in the frame of the panorama before it
    was levelled (rotated upright).

    The detections are in the order of the nodes. Their points are the corners of the boxes.

    Args:
        description: The description of a panorama.

    Returns:
        The graph of the levelled panorama and the detections; None if the description is not a saliency graph.
    """
    level, rotation = split_level(description)
    if not level.keys() >= GRAPH_ARRAYS:
        return None
    graph = graph_from_arrays(level)
    return graph, _in_panorama(graph, np.eye(3) if rotation is None else rotation.T)


def _in_panorama(graph: SaliencyGraph, R_pano_level: np.ndarray) -> Detections:
    """Return the nodes of the graph of a levelled panorama as detections in the frame before levelling. Their points
    are the corners of the boxes."""
    corners_m = []
    for centroid_m, size_m, yaw_rad in zip(graph.centroid_m, graph.size_m, graph.yaw_rad, strict=True):
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        box = centroid_m + (_CORNERS * size_m) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        corners_m.append((box @ R_pano_level.T).astype(np.float32))
    return Detections(
        graph.labels,
        graph.scores,
        graph.centroid_m @ R_pano_level.T,
        graph.size_m,
        graph.yaw_rad,
        points_m=tuple(corners_m),
        bearing=graph.bearing @ R_pano_level.T,
        solid_angle_sr=graph.solid_angle_sr,
    )
