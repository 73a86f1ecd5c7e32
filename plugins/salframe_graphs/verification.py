"""Geometric verification of many candidate graphs at once (method.md 3, step 4)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from salframe.graphs.table import ranges
from salframe.panoramas.geometry import poses_2d

MOST_HYPOTHESES = 120
"""Hypotheses made of two pairs of nodes that are tried in each candidate."""
LEAST_BASE_M, LONGEST_BASE_M, BASE_WORTH = 0.3, 4.0, 0.1
"""Distance below which two nodes say nothing of a heading, that above which more says no more, and what each metre
between is worth beside the similarity of the pairs."""


@dataclass(frozen=True)
class Verified:
    """The best pose of each of K candidates and what it explains.

    yaw_rad (K,), shift_m (K, 2): query to map frame, NaN where there is none; kernel (K, n, m): 1 for node pairs that
    coincide under that pose, down to 0 at the tolerance.
    """

    yaw_rad: np.ndarray
    shift_m: np.ndarray
    kernel: np.ndarray

    @classmethod
    def none(cls, shape: tuple[int, int, int]) -> Verified:
        """No pose for any of K candidates, to be filled in; shape (K, n, m)."""
        return cls(np.full(shape[0], np.nan), np.full((shape[0], 2), np.nan), np.zeros(shape))

    def take(self, candidates: np.ndarray) -> Verified:
        """Of some of the candidates, in this order."""
        return Verified(self.yaw_rad[candidates], self.shift_m[candidates], self.kernel[candidates])

    def poses(self) -> np.ndarray:
        """(K, 4, 4) the best pose of each candidate, query frame to map frame; NaN where there is none."""
        poses = poses_2d(self.shift_m, self.yaw_rad)
        poses[np.isnan(self.yaw_rad)] = np.nan
        return poses


@dataclass(frozen=True, eq=False)
class ScaleBound:
    """That a query's ranges are off by one factor, which is estimated.

    largest_error b: the factor that puts them right is in [1 - b, 1 + b]; query_z (n,), map_z (K, m): heights over the
    camera, which a factor changes; height_scale_m: the difference that halves similarity, or None.
    """

    largest_error: float
    query_z: np.ndarray
    map_z: np.ndarray
    height_scale_m: float | None

    def clip(self, scale):
        """Factors brought within the bound."""
        return np.clip(scale, 1 - self.largest_error, 1 + self.largest_error)

    def heights_alike(self, scale: np.ndarray, i: np.ndarray, k: np.ndarray, j: np.ndarray) -> np.ndarray | float:
        """(E,) similarity of the heights of query nodes i under factors, all (E,), and of nodes j of candidates k."""
        if self.height_scale_m is None:
            return 1.0
        apart = scale * self.query_z[i] - self.map_z[k, j]
        return (1 / (1 + (apart / self.height_scale_m) ** 2)).astype(np.float32)


def verify(
    query_xy: np.ndarray,
    map_xy: np.ndarray,
    similarity: np.ndarray,
    tolerance_m: np.ndarray,
    weights: np.ndarray,
    largest_shift_m: float,
    scale_bound: ScaleBound | None = None,
    most_hypotheses: int = MOST_HYPOTHESES,
) -> Verified:
    """Two-point hypotheses from alike nodes, each scored by all alike nodes.

    query_xy (n, 2), map_xy (K, m, 2) metres; similarity (K, n, m), 0 where two nodes cannot be the same; tolerance_m
    (K, n, m); weights (n,). A pose further than largest_shift_m from the map frame is none. With a scale_bound each
    hypothesis has a scale, the ratio of its two lengths within the bound. Per candidate the `most_hypotheses` with the
    most similar pairs are tried.
    """
    candidates = len(similarity)
    pair_k, pair_i, pair_j = np.nonzero(similarity)
    value = similarity[pair_k, pair_i, pair_j]
    first, second = two_pairs(pair_k, candidates)
    different = (pair_i[first] != pair_i[second]) & (pair_j[first] != pair_j[second])
    first, second = first[different], second[different]
    i1, i2, j1, j2, k = pair_i[first], pair_i[second], pair_j[first], pair_j[second], pair_k[first]
    query_edge, map_edge = query_xy[i2] - query_xy[i1], map_xy[k, j2] - map_xy[k, j1]
    query_length, map_length = np.hypot(*query_edge.T), np.hypot(*map_edge.T)
    slack = tolerance_m[k, i1, j1] + tolerance_m[k, i2, j2]
    scale = np.ones(len(k))
    if scale_bound is not None:
        scale = scale_bound.clip(map_length / np.maximum(query_length, 1e-9))
    possible = (np.abs(scale * query_length - map_length) < slack) & (
        np.minimum(query_length, map_length) > LEAST_BASE_M
    )
    worth = BASE_WORTH * np.minimum(query_length, LONGEST_BASE_M)
    rank = np.where(possible, value[first] + value[second] + worth, -np.inf)
    chosen = best_per_candidate(rank, k, most_hypotheses)
    k, i1, j1, i2, j2 = k[chosen], i1[chosen], j1[chosen], i2[chosen], j2[chosen]
    yaw = np.arctan2(map_edge[chosen, 1], map_edge[chosen, 0]) - np.arctan2(
        query_edge[chosen, 1], query_edge[chosen, 0]
    )
    scale = scale[chosen]
    c, s = scale * np.cos(yaw), scale * np.sin(yaw)
    rotation_t = np.stack([np.stack([c, s], 1), np.stack([-s, c], 1)], 1)
    middle = (query_xy[i1] + query_xy[i2]) / 2
    shift = (map_xy[k, j1] + map_xy[k, j2]) / 2 - (middle[:, None] @ rotation_t)[:, 0]
    near = np.hypot(*shift.T) < largest_shift_m
    k, rotation_t, shift, yaw, scale = k[near], rotation_t[near], shift[near], yaw[near], scale[near]
    # Single precision, and each hypothesis with the alike pairs of its candidate alone: most of a query's time is here.
    begin = np.searchsorted(pair_k, np.arange(candidates + 1))
    count = np.diff(begin)[k]
    pair, hypothesis = ranges(begin[k], count), np.repeat(np.arange(len(k)), count)
    moved = (query_xy @ rotation_t + shift[:, None]).astype(np.float32).reshape(-1, 2)
    there = map_xy.astype(np.float32)[pair_k, pair_j]
    sharpness = (1 / tolerance_m[pair_k, pair_i, pair_j] ** 2).astype(np.float32)
    node = hypothesis * len(query_xy) + pair_i.take(pair)
    x, y = (moved[:, axis].take(node) - there[:, axis].take(pair) for axis in (0, 1))
    kernel = np.maximum(1 - (x * x + y * y) * sharpness.take(pair), 0) * value.astype(np.float32).take(pair)
    if scale_bound is not None:
        kernel *= scale_bound.heights_alike(scale[hypothesis], pair_i[pair], pair_k[pair], pair_j[pair])
    explained = np.zeros((len(k), len(query_xy)), np.float32)
    if len(node):
        first = np.flatnonzero(np.append(True, node[1:] != node[:-1]))
        explained.ravel()[node[first]] = np.maximum.reduceat(kernel, first)
    best = best_per_candidate(explained @ weights, k, 1)
    result = Verified.none(similarity.shape)
    result.yaw_rad[k[best]], result.shift_m[k[best]] = yaw[best], shift[best]
    is_best = np.zeros(len(k), bool)
    is_best[best] = True
    kept = is_best[hypothesis]
    result.kernel[pair_k[pair[kept]], pair_i[pair[kept]], pair_j[pair[kept]]] = kernel[kept]
    return result


def two_pairs(candidate: np.ndarray, candidates: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions of every two node pairs of the same candidate; `candidate` (P,) is sorted."""
    starts = np.searchsorted(candidate, np.arange(candidates + 1))
    blocks = [_pairs(high - low) for low, high in pairwise(starts)]
    first = [a + low for (a, _), low in zip(blocks, starts[:-1], strict=True)]
    second = [b + low for (_, b), low in zip(blocks, starts[:-1], strict=True)]
    return np.concatenate(first), np.concatenate(second)


@lru_cache(maxsize=256)
def _pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.triu_indices(count, 1)


def best_per_candidate(value: np.ndarray, candidate: np.ndarray, most: int) -> np.ndarray:
    """Positions of the `most` largest finite values of each candidate, ties in order."""
    order = np.flatnonzero(np.isfinite(value))
    order = order[np.lexsort((-value[order], candidate[order]))]
    starts = np.searchsorted(candidate[order], candidate[order])
    return order[np.arange(len(order)) - starts < most]
