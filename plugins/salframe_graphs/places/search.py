"""The best pose of a query in each place, and the pose that is answered (method.md 3b)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from salframe_graphs.agreement import agreed
from salframe_graphs.places.evidence import label_evidence
from salframe_graphs.places.hypotheses import best_poses
from salframe_graphs.places.likelihood import PlaceLikelihood, Poses
from salframe_graphs.places.outline import MapOutlines
from salframe_graphs.places.place_index import PlaceIndex, QueryObjects
from salframe_graphs.places.rates import Likelihood, Rates
from salframe_graphs.verification import best_per_candidate

__all__ = ["agreed", "label_evidence", "outline_ratio", "search", "settle"]

SETTLING_STEPS = 6
"""So often the pose that is answered is fitted with what it explains unchanged."""

outline_ratio = MapOutlines.ratio
"""How well outlines of free space fit poses."""


@dataclass(frozen=True, eq=False)
class Found:
    """The best pose of each of K places that has any: C poses, their place (C,) one of the K, ascending; score (C,)
    float64; share, of the number of one of the poses: how surely each query object is each of the place's (n, m).
    unplaced (K,): the score of each place without a pose."""

    poses: Poses
    score: np.ndarray
    share: Callable[[int], np.ndarray]
    unplaced: np.ndarray


def search(
    query: QueryObjects, index: PlaceIndex, places: np.ndarray, rates: Rates, likelihood: Likelihood, refined: int
) -> Found:
    """What a query finds in places (K,) of an index, so many of the best hypotheses refined in each."""
    index = index.take(places)
    scorer = PlaceLikelihood(query, index, rates, likelihood)
    poses, score, share = scorer.refine(best_poses(query, index, scorer, refined))
    best = best_per_candidate(score, poses.place, 1)
    found = share[best]
    return Found(poses.take(best), score[best].astype(np.float64), found.__getitem__, scorer.unplaced())


def settle(
    query: QueryObjects, index: PlaceIndex, rates: Rates, pose: Poses, share: np.ndarray, least_m: float
) -> tuple[Poses, np.ndarray]:
    """One pose in a place of an index, fitted to its shares (n, m) with ranges as uncertain as they are and directions
    as certain, and its first-order covariance (3, 3) (x, y, yaw) in the world's axes; least_m is added an axis.

    Errors are taken to be Cauchy's, fitted by reweighting: what is visible of an object moves with the viewpoint, of
    some by far more than of most.
    """
    objects = slice(share.shape[1])
    there, variance = (values[pose.place[0], objects] for values in (index.xy_m, index.variance_m2))
    across = np.broadcast_to(variance + rates.position_error_m**2, share.shape)
    along = across + ((rates.range_error_share * query.range_m) ** 2)[:, None]
    variances = [some.astype(np.float32).astype(np.float64) for some in (along, across)]
    for _ in range(SETTLING_STEPS):
        c, s = np.cos(pose.yaw_rad[0]), np.sin(pose.yaw_rad[0])
        turn = np.array([[c, -s], [s, c]])
        ray, moved = query.ray @ turn.T, query.xy_m @ turn.T
        apart = there[None] - (moved + pose.shift_m)[:, None]
        axes = (ray, np.stack([-ray[:, 1], ray[:, 0]], 1))
        off = [(apart @ axis[:, :, None])[..., 0] for axis in axes]
        kept = share / (1 + sum(o**2 / of for o, of in zip(off, variances, strict=True)))
        information, pull = 1e-6 * np.eye(3), np.zeros(3)
        for axis, o, of in zip(axes, off, variances, strict=True):
            slope = np.column_stack([axis, axis[:, 1] * moved[:, 0] - axis[:, 0] * moved[:, 1]])
            weight = kept / of
            information += (slope * weight.sum(1)[:, None]).T @ slope
            pull += slope.T @ (weight * o).sum(1)
        step = np.linalg.solve(information, pull)
        pose = Poses(pose.place, pose.shift_m + step[:2], pose.yaw_rad + step[2])
    return pose, np.linalg.inv(information) + np.diag([least_m**2, least_m**2, 0.0])
