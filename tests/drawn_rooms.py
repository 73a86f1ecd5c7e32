"""Rooms of objects drawn at random, and their graphs."""

import numpy as np

from salframe.graphs.detections import Detections
from salframe.graphs.graph import GraphConfig, build_graph
from salframe.panoramas.geometry import invert_pose, transform_points

LABELS = ("bed", "sofa", "chair", "table", "lamp", "plant", "tv", "desk", "picture", "cabinet")


def room(seed, nodes=8, labels=LABELS):
    """A random room's objects seen from its middle, biggest first."""
    rng = np.random.default_rng(seed)
    centroid = np.column_stack(
        [rng.uniform(-2.5, 2.5, nodes), rng.uniform(-2, 2, nodes), rng.uniform(-1.2, 0.8, nodes)]
    )
    size = rng.uniform(0.3, 1.8, (nodes, 3))
    return Detections(
        [str(name) for name in rng.choice(labels, nodes)], np.ones(nodes), centroid, size, rng.uniform(0, np.pi, nodes)
    )


def graph_of(detections, T=None):
    """The graph of these objects seen from pose T in their frame; every object keeps its saliency."""
    volume = detections.size_m.prod(1)
    if T is not None:
        moved = transform_points(invert_pose(T), detections.centroid_m)
        detections = Detections(detections.labels, detections.scores, moved, detections.size_m, detections.yaw_rad)
    return build_graph(detections, volume / volume.sum(), GraphConfig())


def candidates_of(matcher, query, graphs):
    """Return the numbers of the graphs that a matcher ranks."""
    return {match.scene for match in matcher.match(query, matcher.index(graphs), len(graphs))}
