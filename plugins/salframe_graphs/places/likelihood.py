"""The log likelihood ratio of a query's objects: those of a place seen from a pose, against clutter (method.md 3b)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe_graphs.places.place_index import PlaceIndex, QueryObjects
from salframe_graphs.places.rates import Likelihood, Rates

NEAREST_M, REFERENCE_M = 0.5, 2.0
"""Distance below which no object is found any better, and that at which `found_logit` holds."""
LEAST_SCORE = 1e-3
"""An object that its detector is not sure of at all counts so much."""
MOST_LOGIT, MOST_LOG = 6.0, 50.0
FAR_NATS = 30.0
"""A pose whose score is so much below the best is not fitted: fitting raises scores by 0.7 in the median, 9 in one case
of a hundred, and 21 at most (126 queries of `house-42`, seed 100)."""
STEPS = 2
"""So often a pose is fitted to what it explains, and what it explains looked for again."""


@dataclass(frozen=True, eq=False)
class Poses:
    """C poses of a query in the world: place (C,) in the index, shift_m (C, 2), yaw_rad (C,)."""

    place: np.ndarray
    shift_m: np.ndarray
    yaw_rad: np.ndarray

    def __len__(self) -> int:
        return len(self.place)

    def take(self, rows: np.ndarray) -> Poses:
        """Those of these rows."""
        return Poses(self.place[rows], self.shift_m[rows], self.yaw_rad[rows])


class PlaceLikelihood:
    """Scores a query's objects against the places of a map.

    The score of place r and pose T is the sum over query objects i of
    log(1 + sum_j o_j p(i | j, T) / (c p(i | clutter))) and over the place's objects j of log(1 - P_j), P_j the
    probability that j is found from T, o_j = P_j / (1 - P_j), c
    the rate of clutter. Query objects that claim the same object of the place share its odds.
    """

    def __init__(self, query: QueryObjects, index: PlaceIndex, rates: Rates, likelihood: Likelihood) -> None:
        self._query, self._index, self.rates, self.likelihood = query, index, rates, likelihood
        self.alike = self._alike()
        self._along, self._across = self._variances()
        self._log_spread = np.log(self._along * self._across)

    def _alike(self) -> np.ndarray:
        """(K, n, m) float32: log ratio of label, height and size, of an object that is there; -inf of padding. An
        object that is one with probability s, else clutter, has 1 + s x the ratio of one that is."""
        query, index, rates, taken = self._query, self._index, self.rates, self.likelihood
        same = query.label[None, :, None] == index.label[:, None]
        frequency = index.frequency[query.label][None, :, None]
        ratio = np.where(same, np.log(rates.label_agreement / frequency), np.log(1 - rates.label_agreement))
        ratio += np.log(np.maximum(query.score, LEAST_SCORE))[:, None]
        height_m2 = rates.height_error_m**2 + (rates.range_error_share * query.z_m) ** 2
        ratio += log_normal(query.z_m[:, None] - index.z_m[:, None], 2 * height_m2[:, None]) + np.log(
            taken.height_span_m
        )
        for axis, error in ((0, rates.length_error_log), (2, rates.box_height_error_log)):
            apart = query.log_size[:, None, axis] - index.log_size[:, None, :, axis]
            ratio += log_normal(apart, 2 * error**2) + np.log(taken.size_span_log)
        return np.where((index.label >= 0)[:, None], np.maximum(ratio, -MOST_LOG), -np.inf).astype(np.float32)

    def found_logit(self, place: np.ndarray, position_m: np.ndarray) -> np.ndarray:
        """(C, m) float32: logit that each object of place (C,) is found from position_m (C, 2); of padding too."""
        away = self._index.xy_m[place] - position_m[:, None]
        distance = np.maximum(np.sqrt((away**2).sum(2)), NEAREST_M)
        logit = self._index.found_logit[place] + self.rates.found_per_distance * np.log(distance / REFERENCE_M)
        return np.clip(logit, -MOST_LOGIT, MOST_LOGIT).astype(np.float32)

    def missed(self, place: np.ndarray, logit: np.ndarray) -> np.ndarray:
        """(C,) log probability that no object of place (C,) is found, from logit (C, m)."""
        return -np.where(self._index.label[place] >= 0, np.log1p(np.exp(logit)), 0).sum(1)

    def unplaced(self) -> np.ndarray:
        """(K,) the score of each place without a pose: positions are left out, and what an object counts is lowered."""
        every = np.arange(len(self._index.label))
        logit = self.found_logit(every, self._index.cameras_m[:, 0])
        odds = self._odds(self.alike + logit[:, None])
        return np.log1p(self.likelihood.unplaced_share * odds.sum(2)).sum(1) + self.missed(every, logit)

    def score(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """(C,) scores of poses, and (C, n, m) how surely each query object is each of the place's."""
        x, y = self._apart(poses)
        along, across = self._along[poses.place], self._across[poses.place]
        ray = self._query.ray.astype(np.float32)[None, :, None]
        forth, side = x * ray[..., 0] + y * ray[..., 1], y * ray[..., 0] - x * ray[..., 1]
        at = np.log(self.likelihood.area_m2 / (2 * np.pi)) - 0.5 * (
            forth * forth / along + side * side / across + self._log_spread[poses.place]
        )
        logit = self.found_logit(poses.place, poses.shift_m)
        odds = self._odds(self.alike[poses.place] + at + logit[:, None])
        total = 1 + odds.sum(2)
        return np.log(total).sum(1) + self.missed(poses.place, logit), odds / total[..., None]

    def refine(self, poses: Poses) -> tuple[Poses, np.ndarray, np.ndarray]:
        """Poses fitted to what they explain, with their scores and shares as of `score`; no worse than before. Those
        that are far worse than the best stay as they are."""
        score, share = self.score(poses)
        near = np.flatnonzero(score >= score.max(initial=-np.inf) - FAR_NATS)
        best, score_best, share_best = poses.take(near), score[near], share[near]
        for _ in range(STEPS):
            fitted = self._fit(best, share_best)
            again, share_again = self.score(fitted)
            better = again > score_best
            best = Poses(
                best.place,
                np.where(better[:, None], fitted.shift_m, best.shift_m),
                np.where(better, fitted.yaw_rad, best.yaw_rad),
            )
            score_best = np.where(better, again, score_best)
            share_best = np.where(better[:, None, None], share_again, share_best)
        shift_m, yaw_rad = poses.shift_m.copy(), poses.yaw_rad.copy()
        shift_m[near], yaw_rad[near] = best.shift_m, best.yaw_rad
        score[near], share[near] = score_best, share_best
        return Poses(poses.place, shift_m, yaw_rad), score, share

    def _odds(self, log_odds: np.ndarray) -> np.ndarray:
        """(C, n, m) odds against clutter that query objects are a place's; where several claim one, they share its
        odds."""
        odds = np.exp(np.minimum(log_odds - np.log(self.rates.clutter), MOST_LOG))
        claimed = (odds / (1 + odds.sum(2, keepdims=True))).sum(1, keepdims=True)
        return odds / np.maximum(claimed, 1)

    def _apart(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """(C, n, m) float32: from query object to map object, along the axes of the query's frame."""
        away = (self._index.xy_m[poses.place] - poses.shift_m[:, None]).astype(np.float32)
        c, s = (turn(poses.yaw_rad).astype(np.float32)[:, None] for turn in (np.cos, np.sin))
        query = self._query.xy_m.astype(np.float32)[None, :, None]
        x = (c * away[..., 0] + s * away[..., 1])[:, None] - query[..., 0]
        y = (c * away[..., 1] - s * away[..., 0])[:, None] - query[..., 1]
        return x, y

    def _variances(self) -> tuple[np.ndarray, np.ndarray]:
        """(K, n, m) float32 of the difference of two centroids, along the query object's ray and across it."""
        there = self._index.variance_m2[:, None]
        across = there + self.rates.position_error_m**2
        along = across + ((self.rates.range_error_share * self._query.range_m) ** 2)[None, :, None]
        return along.astype(np.float32), np.broadcast_to(across, along.shape).astype(np.float32)

    def _fit(self, poses: Poses, share: np.ndarray) -> Poses:
        """Poses (C,) fitted in closed form to shares (C, n, m), pairs weighted by their certainty."""
        weight = share / self._along[poses.place]
        total = np.maximum(weight.sum((1, 2)), 1e-12)[:, None]
        query, there = self._query.xy_m, self._index.xy_m[poses.place]
        middle = (weight.sum(2) @ query) / total
        middle_there = (weight.sum(1)[:, None] @ there)[:, 0] / total
        spread = query.T @ weight @ there - total[:, :, None] * middle[:, :, None] * middle_there[:, None]
        yaw = np.arctan2(spread[:, 0, 1] - spread[:, 1, 0], spread[:, 0, 0] + spread[:, 1, 1])
        c, s = np.cos(yaw), np.sin(yaw)
        moved = np.stack([c * middle[:, 0] - s * middle[:, 1], s * middle[:, 0] + c * middle[:, 1]], 1)
        return Poses(poses.place, middle_there - moved, yaw)


def log_normal(off: np.ndarray, variance: np.ndarray | float) -> np.ndarray:
    """Logarithm of the normal density of a deviation."""
    return -0.5 * (off**2 / variance + np.log(2 * np.pi * variance))
