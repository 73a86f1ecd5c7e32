"""Saliency graphs as HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.markup import INK, LINE, PlanDrawing, element, to_html

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17a2b8", "#bc8f00")
"""Colours of labels. Labels get them in the order in which they first occur in the nodes."""
MAX_NAMES = 20
"""Maximum number of nodes with a printed label. These are the first nodes of the graph."""
RAY_M = 2.0
"""Length in metres of the line towards a node without range."""


def graph_html(
    labels: Sequence[str],
    saliency: np.ndarray,
    centroid_m: np.ndarray,
    footprints_m: np.ndarray,
    edges: np.ndarray,
    weights: np.ndarray,
    bearing: np.ndarray,
    origin_m: np.ndarray,
) -> str:
    """Return a drawing of a graph of N nodes viewed from above, as HTML, with +x up and +y to the left.

    Boxes are drawn as outlines. The area of the dot of a node grows with its saliency, and the width of an edge grows
    with its weight. A node without range is a line from the camera towards the node.

    Args:
        labels: N names.
        saliency: (N,) saliency of the nodes.
        centroid_m: (N, 3), NaN without range.
        footprints_m: (N, 4, 2) corners of the boxes, NaN without range.
        edges: (E, 2) pairs of nodes.
        weights: (E,) edge weights.
        bearing: (N, 3) unit vectors.
        origin_m: (N, 3) positions of the cameras that observed the nodes.
    """
    turn = np.array([(0.0, 1.0), (-1.0, 0.0)])  # +x of the panorama is up in the drawing
    has_range = np.isfinite(centroid_m).all(1)
    start_m, end_m = origin_m[:, :2], origin_m[:, :2] + RAY_M * bearing[:, :2]
    at_m = np.where(has_range[:, None], centroid_m[:, :2], end_m) @ turn
    start_m, footprints_m = start_m @ turn, footprints_m @ turn
    drawing = PlanDrawing(
        np.concatenate([np.zeros((1, 2)), at_m, start_m, footprints_m.reshape(-1, 2)]), description="graph from above"
    )
    distinct = list(dict.fromkeys(labels))
    colours = [COLOURS[distinct.index(label) % len(COLOURS)] for label in labels]
    for i in range(len(labels)):
        if has_range[i]:
            drawing.fill_rings([footprints_m[i]], fill=colours[i], fill_opacity="0.2", stroke=colours[i])
        else:
            drawing.line(np.stack([start_m[i], at_m[i]]), stroke=colours[i])
    for (a, b), share in zip(edges, weights / max(weights.max(initial=0), 1e-9), strict=True):
        drawing.line(at_m[[a, b]], stroke=LINE, stroke_width=f"{0.5 + 2.5 * share:.2f}")
    radius_px = 2 + 8 * np.sqrt(saliency / max(saliency.max(initial=0), 1e-9))
    for i, label in enumerate(labels):
        drawing.dot(at_m[i], radius_px[i], f"{label}: saliency {saliency[i]:.3f}", fill=colours[i], stroke="#ffffff")
    for i, label in enumerate(labels[:MAX_NAMES]):
        drawing.text(at_m[i] + (0, (radius_px[i] + 3) / drawing.scale), label)
    drawing.arrow(np.zeros(2), np.pi / 2, INK)
    return to_html(element("p", f"{len(labels)} nodes, {len(edges)} edges"), drawing.svg)
