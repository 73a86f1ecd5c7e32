"""Geometric verification of many candidate graphs at once (docs/explanation/single-panoramas.md#verification)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.graphs.segments import pairs_within, ranges, run_starts, top_per_group
from salframe.panoramas.geometry import as_complex, poses_2d
from salframe_graphs.node_pairs import NodePairs

MAX_HYPOTHESES = 120
"""Maximum number of hypotheses for each candidate. A hypothesis consists of two node pairs."""
MIN_BASE_M, MAX_BASE_M, BASE_WEIGHT = 0.3, 4.0, 0.1
"""Base: the distance between the two nodes of a hypothesis, whose direction gives the heading. Minimum base (m),
maximum base that increases the rank of a hypothesis (m), and value of one metre of base (in similarity) when hypotheses
are ranked."""


@dataclass(frozen=True, eq=False)
class VerifiedPoses:
    """The best pose of each of K candidates, and the node pairs that it explains.

    Attributes:
        yaw_rad: (K,) yaw of the query frame in the reference frame, NaN where there is no pose.
        shift_m: (K, 2) position of the query frame in the reference frame, NaN where there is no pose.
        kernel: (P,) for each node pair, its similarity times a factor. The factor is 1 if both nodes coincide under the
            pose of the candidate, and falls to 0 at a distance equal to the tolerance.
    """

    yaw_rad: np.ndarray
    shift_m: np.ndarray
    kernel: np.ndarray

    @classmethod
    def none(cls, pairs: NodePairs) -> VerifiedPoses:
        """Return an instance without a pose for any candidate."""
        return cls(np.full(pairs.num_graphs, np.nan), np.full((pairs.num_graphs, 2), np.nan), np.zeros(len(pairs)))

    def poses(self, candidates: np.ndarray) -> np.ndarray:
        """Return the best poses (T, 4, 4), query frame to reference frame, of candidates (T,); NaN without a pose."""
        poses = poses_2d(self.shift_m[candidates], self.yaw_rad[candidates])
        poses[np.isnan(self.yaw_rad[candidates])] = np.nan
        return poses


@dataclass(frozen=True, eq=False)
class ScaleBound:
    """Bounds of the scale that corrects all ranges of a query.

    Attributes:
        max_error: The scale lies in [1 - max_error, 1 + max_error].
        query_z: (n,) heights of the query's nodes above the camera (m), which change with the scale.
        map_z: (N,) heights of the map's nodes above the camera (m).
        height_scale_m: Difference in height that halves similarity; None if heights are ignored.
    """

    max_error: float
    query_z: np.ndarray
    map_z: np.ndarray
    height_scale_m: float | None

    def clip(self, scale):
        """Return scales clipped to the bounds."""
        return np.clip(scale, 1 - self.max_error, 1 + self.max_error)

    def height_similarity(self, scale: np.ndarray, i: np.ndarray, node: np.ndarray) -> np.ndarray | float:
        """Return the similarity (E,) of the heights of query nodes i (E,) and map nodes (E,).

        The heights of the query nodes are multiplied by `scale` (E,).
        """
        if self.height_scale_m is None:
            return 1.0
        difference_m = scale * self.query_z[i] - self.map_z[node]
        return (1 / (1 + (difference_m / self.height_scale_m) ** 2)).astype(np.float32)


def verify(
    query_xy: np.ndarray,
    map_xy: np.ndarray,
    pairs: NodePairs,
    similarity: np.ndarray,
    tolerance_m: np.ndarray,
    weights: np.ndarray,
    max_shift_m: float,
    scale_bound: ScaleBound | None = None,
) -> VerifiedPoses:
    """Find the pose with the largest support for each candidate.

    A hypothesis is a pose that follows from two node pairs. Its support is summed over all node pairs of the candidate
    that agree with the pose. Only the MAX_HYPOTHESES hypotheses with the most similar pairs are evaluated for each
    candidate.

    Args:
        query_xy: (n, 2) positions of the query's nodes in metres.
        map_xy: (N, 2) positions of the map's nodes in metres, each in the coordinates of the panorama that shows it.
        pairs: The P node pairs, over all candidates, that may be the same object.
        similarity: (P,) similarity of each pair, above 0.
        tolerance_m: (P,) maximum distance in metres between the two nodes of the same object.
        weights: (n,) weights of the query's nodes.
        max_shift_m: Maximum distance in metres of a pose from the reference frame.
        scale_bound: Bounds of the scale of the query's ranges; None if the ranges are metric. With bounds, each
            hypothesis has a scale: the distance between its two map nodes divided by the distance between its two query
            nodes.
    """
    result = VerifiedPoses.none(pairs)
    i, node = pairs.query, pairs.node
    first, second = pairs_within(pairs.segments.start)
    is_base = (i[first] != i[second]) & (node[first] != node[second])
    first, second = first[is_base], second[is_base]
    i1, i2, j1, j2 = i[first], i[second], node[first], node[second]
    query, map_position = as_complex(query_xy), as_complex(map_xy)
    query_edge, map_edge = query[i2] - query[i1], map_position[j2] - map_position[j1]
    query_length, map_length = np.abs(query_edge), np.abs(map_edge)
    scale = np.ones(len(first))
    if scale_bound is not None:
        scale = scale_bound.clip(map_length / np.maximum(query_length, 1e-9))
    fits = np.abs(scale * query_length - map_length) < tolerance_m[first] + tolerance_m[second]
    fits &= np.minimum(query_length, map_length) > MIN_BASE_M
    base_value = BASE_WEIGHT * np.minimum(query_length, MAX_BASE_M)
    rank = np.where(fits, similarity[first] + similarity[second] + base_value, -np.inf)
    rows = top_per_group(rank, pairs.graph[first], MAX_HYPOTHESES)
    i1, i2, j1, j2, scale, graph = (a[rows] for a in (i1, i2, j1, j2, scale, pairs.graph[first]))
    turn = map_edge[rows] * query_edge[rows].conj()
    turn *= scale / np.abs(turn)
    shift = (map_position[j1] + map_position[j2]) / 2 - turn * (query[i1] + query[i2]) / 2
    valid = np.flatnonzero(np.abs(shift) < max_shift_m)
    if not len(valid):
        return result
    graph, turn, shift, scale = (a[valid] for a in (graph, turn, shift, scale))
    # Single precision, and only the pairs of the hypothesis's candidate, because this takes much of a query's time.
    count = pairs.segments.count[graph]
    pair, hypothesis = ranges(pairs.segments.start[graph], count), np.arange(len(graph)).repeat(count)
    moved_query = (turn[:, None] * query + shift[:, None]).astype(np.complex64)
    row = hypothesis * len(query) + i.take(pair)
    offset = moved_query.ravel().take(row) - map_position.astype(np.complex64)[node].take(pair)
    x, y = offset.real, offset.imag
    sharpness = (1 / tolerance_m**2).astype(np.float32)
    kernel = np.maximum(1 - (x * x + y * y) * sharpness.take(pair), 0) * similarity.astype(np.float32).take(pair)
    if scale_bound is not None:
        kernel *= scale_bound.height_similarity(scale[hypothesis], i[pair], node[pair])
    begin = run_starts(row)
    explained = np.maximum.reduceat(kernel, begin) * weights[i[pair[begin]]]
    support = np.bincount(hypothesis[begin], explained, len(graph))
    best = top_per_group(support, graph, 1)
    result.yaw_rad[graph[best]] = np.angle(turn[best])
    result.shift_m[graph[best], 0], result.shift_m[graph[best], 1] = shift[best].real, shift[best].imag
    is_best = np.zeros(len(graph), bool)
    is_best[best] = True
    entry = np.flatnonzero(is_best[hypothesis])
    result.kernel[pair[entry]] = kernel[entry]
    return result
