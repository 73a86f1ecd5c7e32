"""The best pose of a query in each place, and the pose that is answered (docs/explanation/method.md#pose)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.graphs.segments import top_per_group
from salframe.graphs.table import GraphNodes
from salframe_graphs.places.hypotheses import best_poses
from salframe_graphs.places.likelihood import PlaceLikelihood, Poses
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.rates import Likelihood, Rates

SETTLING_STEPS = 6
"""Number of reweighted fits of the pose that is answered."""
MIN_SHARE = 1e-7
"""Pairs whose share is below this do not pull at the pose."""

_RIDGE = 1e-6 * np.eye(3)
"""Added to the information matrix, so that it can be inverted."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best pose of each place of an index that has any: C poses, their places ascending, and score (C,) float64."""

    scorer: PlaceLikelihood
    poses: Poses
    score: np.ndarray


def search(query: GraphNodes, index: PlaceIndex, rates: Rates, likelihood: Likelihood, max_poses: int) -> SearchResult:
    """Return the best pose of a query in each place of an index, of `max_poses` that are refined in each."""
    scorer = PlaceLikelihood(query, index, rates, likelihood)
    poses, score = scorer.refine(best_poses(scorer, max_poses))
    best = top_per_group(score, poses.place, 1)
    return SearchResult(scorer, poses.take(best), score[best])


def settle(scorer: PlaceLikelihood, pose: Poses, share: np.ndarray, min_deviation_m: float) -> tuple[Poses, np.ndarray]:
    """Fit one pose to the objects that it explains.

    Errors are taken to be Cauchy distributed and fitted by reweighting: the visible part of an object moves with the
    viewpoint, that of some objects far more than that of most.

    Args:
        scorer: likelihood of the query in the places of an index.
        pose: one pose.
        share: (n, m) how surely each query object is each object of the pose's place.
        min_deviation_m: standard deviation added to each axis.

    Returns:
        The pose, and its first-order covariance (3, 3) of x, y, yaw in the axes of the world (m, rad).
    """
    own = slice(*scorer.index.segments.start[pose.place[0] : pose.place[0] + 2])
    i, j = np.nonzero(share > MIN_SHARE)
    along, across = scorer.variances(own)
    along, across, share = along[i, j], across[j], share[i, j].astype(np.float64)
    weight, off, slope = np.empty(2 * len(i)), np.empty(2 * len(i)), np.zeros((3, 2 * len(i)))
    forth, side = off[: len(i)], off[len(i) :]  # along the turned rays, and across them
    x, y = scorer.index.xy_m[own][j].T
    query_x, query_y = scorer.xy_m[i].T
    ray_x, ray_y = scorer.ray[i].T
    slope[2, len(i) :] = scorer.range_m[i]  # turning moves an object across its ray
    shift_m, yaw_rad = pose.shift_m[0], float(pose.yaw_rad[0])
    for _ in range(SETTLING_STEPS):
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        turned_x, turned_y = c * ray_x - s * ray_y, s * ray_x + c * ray_y
        apart_x = x - (c * query_x - s * query_y) - shift_m[0]
        apart_y = y - (s * query_x + c * query_y) - shift_m[1]
        forth[:] = apart_x * turned_x + apart_y * turned_y
        side[:] = apart_y * turned_x - apart_x * turned_y
        kept = share / (1 + forth * forth / along + side * side / across)
        weight[: len(i)], weight[len(i) :] = kept / along, kept / across
        slope[0, : len(i)], slope[0, len(i) :] = turned_x, -turned_y
        slope[1, : len(i)], slope[1, len(i) :] = turned_y, turned_x
        weighted = slope * weight
        information = weighted @ slope.T + _RIDGE
        step = np.linalg.solve(information, weighted @ off)
        shift_m, yaw_rad = shift_m + step[:2], yaw_rad + step[2]
    covariance = np.linalg.inv(information) + np.diag([min_deviation_m**2, min_deviation_m**2, 0.0])
    return Poses(pose.place, shift_m[None], np.array([yaw_rad])), covariance
