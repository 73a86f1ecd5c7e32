"""Geometric verification of many candidate graphs at once (docs/explanation/method.md#verification)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.graphs.segments import pairs_within, ranges, run_starts, top_per_group
from salframe.panoramas.geometry import as_complex, poses_2d
from salframe_graphs.node_pairs import NodePairs

MAX_HYPOTHESES = 120
"""Maximum number of hypotheses, made of two pairs of nodes, in each candidate."""
MIN_BASE_M, MAX_BASE_M, BASE_WORTH = 0.3, 4.0, 0.1
"""Distance below which two nodes do not tell a heading, the distance above which more does not help, and the value of a
metre beside the similarity of the pairs."""


@dataclass(frozen=True, eq=False)
class VerifiedPoses:
    """The best pose of each of K candidates and what it explains.

    yaw_rad: (K,), shift_m: (K, 2), from the query's frame to the reference frame, NaN where there is none. kernel: (P,) for
    each node pair, 1 if both coincide under its candidate's pose, down to 0 at the tolerance.
    """

    yaw_rad: np.ndarray
    shift_m: np.ndarray
    kernel: np.ndarray

    @classmethod
    def none(cls, pairs: NodePairs) -> VerifiedPoses:
        """Return no pose for any candidate, to be filled in."""
        return cls(np.full(pairs.num_graphs, np.nan), np.full((pairs.num_graphs, 2), np.nan), np.zeros(len(pairs)))

    def poses(self, candidates: np.ndarray) -> np.ndarray:
        """Return the best pose of candidates (T,), query frame to reference frame, (T, 4, 4); NaN where there is none."""
        poses = poses_2d(self.shift_m[candidates], self.yaw_rad[candidates])
        poses[np.isnan(self.yaw_rad[candidates])] = np.nan
        return poses


@dataclass(frozen=True, eq=False)
class ScaleBound:
    """All ranges of a query may be off by one factor, which is estimated.

    max_error: b; the factor that corrects them lies in [1 - b, 1 + b]. query_z: (n,), map_z: (N,), heights over the
    camera, which a factor changes. height_scale_m: the difference that halves similarity, or None.
    """

    max_error: float
    query_z: np.ndarray
    map_z: np.ndarray
    height_scale_m: float | None

    def clip(self, scale):
        """Return factors brought within the bound."""
        return np.clip(scale, 1 - self.max_error, 1 + self.max_error)

    def height_similarity(self, scale: np.ndarray, i: np.ndarray, node: np.ndarray) -> np.ndarray | float:
        """Return the similarity of the heights of query nodes i under factors and of map nodes, all (E,)."""
        if self.height_scale_m is None:
            return 1.0
        apart = scale * self.query_z[i] - self.map_z[node]
        return (1 / (1 + (apart / self.height_scale_m) ** 2)).astype(np.float32)


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
    """Find the pose of each candidate that explains most, among two-point hypotheses from similar nodes.

    Each hypothesis is scored by all similar nodes; in each candidate at most MAX_HYPOTHESES with the most similar pairs
    are tried.

    Args:
        query_xy: (n, 2) metres.
        map_xy: (N, 2) metres, each in its reference frame.
        pairs: the node pairs that may be the same.
        similarity: (P,) of each pair, over 0.
        tolerance_m: (P,) distance at which the two cannot be the same.
        weights: (n,) of the query's nodes.
        max_shift_m: a pose further from the reference frame than this is discarded.
        scale_bound: if given, each hypothesis has a scale, the ratio of its two lengths within the bound.
    """
    result = VerifiedPoses.none(pairs)
    i, node = pairs.query, pairs.node
    first, second = pairs_within(pairs.segments.start)
    is_base = (i[first] != i[second]) & (node[first] != node[second])
    first, second = first[is_base], second[is_base]
    i1, i2, j1, j2 = i[first], i[second], node[first], node[second]
    query, there = as_complex(query_xy), as_complex(map_xy)
    query_edge, map_edge = query[i2] - query[i1], there[j2] - there[j1]
    query_length, map_length = np.abs(query_edge), np.abs(map_edge)
    scale = np.ones(len(first))
    if scale_bound is not None:
        scale = scale_bound.clip(map_length / np.maximum(query_length, 1e-9))
    fits = np.abs(scale * query_length - map_length) < tolerance_m[first] + tolerance_m[second]
    fits &= np.minimum(query_length, map_length) > MIN_BASE_M
    worth = BASE_WORTH * np.minimum(query_length, MAX_BASE_M)
    rank = np.where(fits, similarity[first] + similarity[second] + worth, -np.inf)
    chosen = top_per_group(rank, pairs.graph[first], MAX_HYPOTHESES)
    i1, i2, j1, j2, scale, graph = (a[chosen] for a in (i1, i2, j1, j2, scale, pairs.graph[first]))
    turn = map_edge[chosen] * query_edge[chosen].conj()
    turn *= scale / np.abs(turn)
    shift = (there[j1] + there[j2]) / 2 - turn * (query[i1] + query[i2]) / 2
    near = np.flatnonzero(np.abs(shift) < max_shift_m)
    if not len(near):
        return result
    graph, turn, shift, scale = (a[near] for a in (graph, turn, shift, scale))
    # Single precision, and each hypothesis with the pairs of its own candidate: much of a query's time is spent here.
    count = pairs.segments.count[graph]
    pair, hypothesis = ranges(pairs.segments.start[graph], count), np.arange(len(graph)).repeat(count)
    moved = (turn[:, None] * query + shift[:, None]).astype(np.complex64)
    row = hypothesis * len(query) + i.take(pair)
    off = moved.ravel().take(row) - there.astype(np.complex64)[node].take(pair)
    x, y = off.real, off.imag
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
