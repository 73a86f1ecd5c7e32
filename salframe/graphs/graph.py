"""The 360-degree saliency graph G = (N, E, S): which objects become nodes, and which nodes are in context, that is,
connected by an edge (docs/explanation/method.md#from-panorama-to-graph)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.framework.validation import Settings
from salframe.graphs.detections import Detections, unit_vectors

REACH_M = 32.767
"""Maximum absolute coordinate of a node along each axis, in metres. Packed positions cannot exceed this limit. An
object farther away is an error of the range image rather than an object in the room."""


_NODE_COLUMNS = (
    *("scores", "saliency", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr", "origin_m", "variance_m2"),
)


@dataclass(frozen=True, eq=False)
class SaliencyGraph:
    """A 360-degree saliency graph (docs/explanation/method.md#from-panorama-to-graph): the nodes are salient objects,
    and the edges connect objects that are close to each other.

    A node without range has a bearing only: its centroid_m, size_m and yaw_rad are NaN, and it has no edges. In a graph
    of one panorama, either all nodes have a range or none has. If none has, the saliency of a node is its share of the
    solid angle of all nodes. In a graph of several views, the nodes with range come before the nodes without range. A
    graph that contains nodes without range can be a query, but it cannot be part of a map.

    Attributes:
        labels: N names.
        scores: (N,) float64 in [0, 1], scores of the detector.
        saliency: (N,) float64, saliency of each object: by default, its volume divided by the volume of all objects.
        centroid_m: (N, 3) float64, in metres, in the panorama frame.
        size_m: (N, 3) float64, length, width and height of the upright boxes in metres.
        yaw_rad: (N,) float64, azimuth of the longer horizontal side of the box in the panorama frame.
        edges: (E, 2) int64, indices of the two nodes of each edge, edges[:, 0] < edges[:, 1].
        bearing: (N, 3) float64, unit vectors towards the nodes; by default the directions of the centroids.
        solid_angle_sr: (N,) float64, solid angle that each node covers, NaN where it is unknown, and for nodes with
            range.
        origin_m: (N, 3) float64, position of the camera that observed each node, in metres, in the panorama frame. It
            is the origin, except for nodes without range in a graph of several views.
        variance_m2: (N,) float64, variance of the position of each node along each horizontal axis, if the position was
            triangulated from several panoramas. The graphs of these panoramas share this error, so that it does not
            average out. 0 for a measured position.
        texts: N strings, the text written on each node, "" where no text was read. By default, no node has a text.
        out_of_reach: Number of objects that were left out because a coordinate exceeds REACH_M.
    """

    labels: tuple[str, ...]
    scores: np.ndarray
    saliency: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray
    yaw_rad: np.ndarray
    edges: np.ndarray
    bearing: np.ndarray = None  # type: ignore[assignment]  # set in __post_init__
    solid_angle_sr: np.ndarray = None  # type: ignore[assignment]
    origin_m: np.ndarray = None  # type: ignore[assignment]
    variance_m2: np.ndarray = None  # type: ignore[assignment]
    out_of_reach: int = 0
    texts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", tuple(self.labels))
        n = len(self.labels)
        check_array(self, "scores", np.float64, n)
        check_array(self, "saliency", np.float64, n)
        check_array(self, "centroid_m", np.float64, n, 3)
        check_array(self, "size_m", np.float64, n, 3)
        check_array(self, "yaw_rad", np.float64, n)
        if self.bearing is None:
            object.__setattr__(self, "bearing", unit_vectors(self.centroid_m))
        if self.solid_angle_sr is None:
            object.__setattr__(self, "solid_angle_sr", np.full(n, np.nan))
        if self.origin_m is None:
            object.__setattr__(self, "origin_m", np.zeros((n, 3)))
        if self.variance_m2 is None:
            object.__setattr__(self, "variance_m2", np.zeros(n))
        check_array(self, "bearing", np.float64, n, 3)
        check_array(self, "solid_angle_sr", np.float64, n)
        check_array(self, "origin_m", np.float64, n, 3)
        check_array(self, "variance_m2", np.float64, n)
        object.__setattr__(self, "texts", tuple(self.texts) or ("",) * n)
        if len(self.texts) != n:
            raise DataError(f"SaliencyGraph.texts has {len(self.texts)} strings, expected {n}, one for each node")
        edges = check_array(self, "edges", np.int64, None, 2)
        wrong = edges[~((edges[:, 0] >= 0) & (edges[:, 0] < edges[:, 1]) & (edges[:, 1] < n))]
        if len(wrong):
            raise DataError(
                f"SaliencyGraph.edges has the row {wrong[0].tolist()}, expected node indices (a, b), 0 <= a < b < {n}"
            )

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def bearings_only(self) -> bool:
        """Whether the graph has at least one node, and no node has a known range."""
        return without_positions(self.centroid_m)

    @cached_property
    def range_m(self) -> np.ndarray:
        """(N,) distances of the centroids from the camera, in metres."""
        return np.linalg.norm(self.centroid_m, axis=1)

    @cached_property
    def weights(self) -> np.ndarray:
        """(E,) edge weights w_ab = sqrt(S_a S_b)."""
        return np.sqrt(self.saliency[self.edges[:, 0]] * self.saliency[self.edges[:, 1]])

    @cached_property
    def adjacency(self) -> np.ndarray:
        """(N, N) bool, symmetric: whether an edge connects two nodes."""
        matrix = np.zeros((len(self), len(self)), bool)
        matrix[self.edges[:, 0], self.edges[:, 1]] = matrix[self.edges[:, 1], self.edges[:, 0]] = True
        return matrix

    def _repr_html_(self) -> str:
        """Return a drawing of the graph viewed from above, as HTML for notebooks. The +x axis of the panorama points
        up."""
        from salframe.graphs.graph_html import graph_html

        return graph_html(
            self.labels,
            self.saliency,
            self.centroid_m,
            box_footprints(self),
            self.edges,
            self.weights,
            self.bearing,
            self.origin_m,
        )


def without_positions(centroid_m: np.ndarray) -> bool:
    """Return whether there is at least one object, and no centroid (N, 3) is known."""
    return len(centroid_m) > 0 and bool(np.isnan(centroid_m).any(1).all())


def without_range(graph: SaliencyGraph) -> SaliencyGraph:
    """Return a copy of a graph whose nodes have bearings only. Positions, sizes and yaws are NaN, and it has no
    edges."""
    unknown = np.full((len(graph), 3), np.nan)
    return replace(graph, centroid_m=unknown, size_m=unknown, yaw_rad=unknown[:, 0], edges=np.zeros((0, 2), np.int64))


def with_range(graph: SaliencyGraph) -> SaliencyGraph:
    """Return the graph without its nodes that have no range. The nodes with range must be the first nodes."""
    count = int(np.isfinite(graph.centroid_m).all(1).sum())
    if count == len(graph):
        return graph
    first = {name: getattr(graph, name)[:count] for name in ("labels", "texts", *_NODE_COLUMNS)}
    return replace(graph, **first)


def concatenate_graphs(parts: Sequence[SaliencyGraph]) -> SaliencyGraph:
    """Join graphs, at least one, into one graph with all of their nodes and edges."""
    first = np.cumsum([0, *(len(part) for part in parts)])
    edges = [part.edges + offset for part, offset in zip(parts, first[:-1], strict=True)]
    return SaliencyGraph(
        tuple(label for part in parts for label in part.labels),
        edges=np.concatenate(edges),
        out_of_reach=sum(part.out_of_reach for part in parts),
        texts=tuple(text for part in parts for text in part.texts),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _NODE_COLUMNS},
    )


class GraphConfig(Settings):
    """Settings of a graph: which objects become nodes, and which nodes are connected by an edge."""

    min_share: float = Field(
        0.0, ge=0, le=1, description="minimum saliency (0 to 1) of an object that becomes a node of the graph"
    )
    top_k: int | None = Field(
        None,
        ge=1,
        description="maximum number of nodes of the graph. The most salient objects become nodes; null: all objects",
    )
    extent: Literal["mean", "max"] = Field(
        "mean",
        description="measure of the size of an object. An edge connects two objects if their distance is smaller than "
        "the sizes of both (Eq. 1 of the paper). mean: mean of the three sides of the box; max: longest side of the "
        "box",
    )
    distance: Literal["surface", "centroid"] = Field(
        "surface",
        description="measure of the distance of two objects, for the edges (see `graph.extent`). surface: distance "
        "between their boxes; centroid: distance between their centroids",
    )


def build_graph(
    detections: Detections, saliency: np.ndarray, config: GraphConfig, variance_m2: np.ndarray | None = None
) -> SaliencyGraph:
    """Return the saliency graph of detections.

    Its nodes are the detections with known positions within REACH_M that `config` selects. If no position is known, the
    graph has bearings only. Nodes are sorted by decreasing saliency. Two nodes a and b are connected by an edge if
    min(l_a, l_b) > d_s(a, b), with the box sizes l and the distance d_s (paper Eq. 1).

    Args:
        detections: N detections.
        saliency: (N,) saliency of the detections.
        config: Which detections become nodes, and how edges are computed.
        variance_m2: (N,) as in SaliencyGraph; None: 0, for measured positions.
    """
    has_position = np.isfinite(detections.centroid_m).all(1)
    # Break ties by position: the order of the detections changes when the panorama is rotated.
    height = detections.centroid_m[:, 2] if has_position.any() else detections.bearing[:, 2]
    usable = has_position if has_position.any() else np.isfinite(detections.bearing).all(1)
    with np.errstate(invalid="ignore"):
        far = has_position & (np.abs(detections.centroid_m) > REACH_M).any(1)
    nodes = np.flatnonzero((saliency >= config.min_share) & usable & ~far)
    nodes = nodes[np.lexsort((height[nodes], -saliency[nodes]))][: config.top_k]
    chosen, saliency = detections.take(nodes), saliency[nodes]
    bearings_only = not has_position.any()
    return SaliencyGraph(
        chosen.labels,
        chosen.scores,
        saliency,
        chosen.centroid_m,
        chosen.size_m,
        chosen.yaw_rad,
        np.zeros((0, 2), np.int64) if bearings_only else _edges(chosen, config),
        chosen.bearing if bearings_only else unit_vectors(chosen.centroid_m),
        chosen.solid_angle_sr if bearings_only else np.full(len(nodes), np.nan),
        variance_m2=None if variance_m2 is None else variance_m2[nodes],  # type: ignore[arg-type]
        out_of_reach=int(far.sum()),
        texts=chosen.texts,
    )


def _edges(chosen: Detections, config: GraphConfig) -> np.ndarray:
    """Return the edges, (E, 2) int64: the pairs of nodes in context (paper Eq. 1)."""
    extent = chosen.size_m.mean(1) if config.extent == "mean" else chosen.size_m.max(1, initial=0)
    a, b = np.triu_indices(len(chosen), 1)
    if config.distance == "surface":
        distance = box_distances(chosen, a, b)
    else:
        distance = np.linalg.norm(chosen.centroid_m[a] - chosen.centroid_m[b], axis=1)
    linked = np.minimum(extent[a], extent[b]) > distance
    return np.column_stack([a[linked], b[linked]])


def box_distances(detections: Detections, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances in metres between the surfaces of pairs of upright boxes, (E,) float64; 0 for boxes that
    touch or overlap.

    Args:
        detections: N detections.
        a: (E,) indices of the first box of each pair.
        b: (E,) indices of the second box of each pair.
    """
    import shapely

    corners = box_footprints(detections)
    footprint = shapely.polygons(corners) if len(corners) else np.empty(0, object)
    z, half = detections.centroid_m[:, 2], detections.size_m[:, 2] / 2
    gap = np.maximum(np.abs(z[a] - z[b]) - half[a] - half[b], 0)
    return np.hypot(shapely.distance(footprint[a], footprint[b]), gap)


def box_footprints(boxes: Detections | SaliencyGraph) -> np.ndarray:
    """Return the four corners (x, y) of each upright box in metres, clockwise viewed from above, (N, 4, 2) float64."""
    c, s = np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad)
    along = np.stack([c, s], 1) * boxes.size_m[:, :1] / 2
    across = np.stack([-s, c], 1) * boxes.size_m[:, 1:2] / 2
    corners = np.stack([along + across, along - across, -along - across, across - along], 1)
    return boxes.centroid_m[:, None, :2] + corners
