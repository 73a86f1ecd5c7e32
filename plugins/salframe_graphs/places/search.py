"""The best pose of a query in each place, and the pose that is answered (docs/explanation/method.md#pose)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from salframe.graphs.segments import top_per_group
from salframe.graphs.table import GraphNodes
from salframe_graphs.places.hypotheses import best_poses
from salframe_graphs.places.likelihood import PlaceLikelihood, Poses, RefinedPoses
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
    """The best pose of each place of an index that has any: C poses, their places ascending, and score (C,) float64.

    best: (C,) their positions among the refined poses.
    """

    scorer: PlaceLikelihood
    poses: Poses
    score: np.ndarray
    refined: RefinedPoses
    best: np.ndarray

    def share(self, row: int) -> np.ndarray:
        """Return how surely each query object is each object of the place, (n, m), under a pose (row of the C)."""
        share = self.refined.share_of(int(self.best[row]))
        return self.scorer.score(self.poses.take(np.array([row])))[1] if share is None else share


def search(query: GraphNodes, index: PlaceIndex, rates: Rates, likelihood: Likelihood, max_poses: int) -> SearchResult:
    """Return the best pose of a query in each place of an index, of `max_poses` that are refined in each."""
    scorer = PlaceLikelihood(query, index, rates, likelihood)
    refined = scorer.refine(best_poses(scorer, max_poses))
    best = top_per_group(refined.score, refined.poses.place, 1)
    return SearchResult(scorer, refined.poses.take(best), refined.score[best], refined, best)


def settle(scorer: PlaceLikelihood, pose: Poses, share: np.ndarray, min_deviation_m: float) -> tuple[Poses, np.ndarray]:
    """Fit one pose to the objects that it explains.

    Errors are taken to be Cauchy distributed and fitted by reweighting: the visible part of an object moves with the
    viewpoint, and for a few objects it moves far.

    Args:
        scorer: likelihood of the query in the places of an index.
        pose: one pose.
        share: (n, m) how surely each query object is each object of the pose's place.
        min_deviation_m: standard deviation added to each axis.

    Returns:
        The pose, and its first-order covariance (3, 3) of x, y, yaw in the axes of the world (m, rad).
    """
    objects = slice(*scorer.index.segments.start[pose.place[0] : pose.place[0] + 2])
    i, j = np.nonzero(share > MIN_SHARE)
    along, across = scorer.variances(objects)
    along, across, share = along[i, j], across[j], share[i, j].astype(np.float64)
    inverse = 1 / np.array([along, across])
    position, query, ray = scorer.index.xy_m[objects][j].T, scorer.position[i], scorer.ray[i]
    # Columns: slopes of the deviation along each ray, of that across it, and the query object, all turned together.
    base = np.concatenate([ray.real, -ray.imag, query.real, ray.imag, ray.real, query.imag]).reshape(2, -1)
    slope = np.zeros((3, 2, len(i)))
    slope[2, 1] = scorer.range_m[i]  # turning moves an object across its ray
    shift_m, yaw_rad = pose.shift_m[0], float(pose.yaw_rad[0])
    for _ in range(SETTLING_STEPS):
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        turned = (np.array([[c, -s], [s, c]]) @ base).reshape(2, 3, -1)
        slope[:2] = turned[:, :2]
        apart = position - turned[:, 2] - shift_m[:, None]
        off = apart[0] * slope[0] + apart[1] * slope[1]
        squares = off * off * inverse
        weight = share / (1 + squares[0] + squares[1]) * inverse
        flat, weighted = slope.reshape(3, -1), (slope * weight).reshape(3, -1)
        information = weighted @ flat.T + _RIDGE
        step = np.linalg.solve(information, weighted @ off.ravel())
        shift_m, yaw_rad = shift_m + step[:2], yaw_rad + step[2]
    covariance = np.linalg.inv(information) + np.diag([min_deviation_m**2, min_deviation_m**2, 0.0])
    return Poses(pose.place, shift_m[None], np.array([yaw_rad])), covariance
