"""The log likelihood ratio of a query's objects: those of a place seen from a pose, against clutter
(docs/explanation/method.md#the-likelihood-ratio)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.graphs.segments import Segments, ranges
from salframe.graphs.table import GraphNodes
from salframe.panoramas.geometry import as_complex
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.rates import Likelihood, Rates

MIN_RANGE_M, REFERENCE_M = 0.5, 2.0
"""Distance below which the probability of detection stays the same, and the distance at which `detection_logit` holds."""
MIN_SCORE = 1e-3
"""Lower bound of a detector's score, so that its logarithm is finite."""
MAX_LOGIT, MAX_LOG_RATIO = 6.0, 50.0
"""Bounds of a detection logit and of a log ratio, so that exponentials stay finite."""
MAX_GAIN_NATS = 30.0
"""Poses whose score is this much below the best one are not refined: refinement raises a score by 0.7 in the median, by
9 in one of a hundred cases, and by 21 at most (126 queries of `house-42`, seed 100)."""
STEPS = 2
"""Number of times a pose is fitted to the objects that it explains."""


@dataclass(frozen=True, eq=False)
class Poses:
    """C poses of a query in the world: place (C,) in the index, shift_m (C, 2), yaw_rad (C,)."""

    place: np.ndarray
    shift_m: np.ndarray
    yaw_rad: np.ndarray

    def __len__(self) -> int:
        return len(self.place)

    def take(self, rows: np.ndarray) -> Poses:
        """Return the poses of these rows."""
        return Poses(self.place[rows], self.shift_m[rows], self.yaw_rad[rows])


@dataclass(frozen=True, eq=False)
class _Columns:
    """The objects of the places of C poses, one pose after the other: objects (T,) of the index, poses as groups."""

    objects: np.ndarray
    poses: Segments

    def take(self, poses: np.ndarray) -> tuple[_Columns, np.ndarray]:
        """Return the columns of some poses, and their positions among these."""
        count = self.poses.count[poses]
        position = ranges(self.poses.start[poses], count)
        return _Columns(self.objects[position], Segments(count)), position


@dataclass(frozen=True, eq=False)
class RefinedPoses:
    """C poses with their scores (C,); of those that were refined, `near` (R,), how surely each query object is each
    object of the pose's place: share (n, T), in columns of `refined`."""

    poses: Poses
    score: np.ndarray
    near: np.ndarray
    refined: Segments
    share: np.ndarray

    def share_of(self, pose: int) -> np.ndarray | None:
        """Return the shares (n, m) of a pose, None of one that was not refined."""
        row = int(np.searchsorted(self.near, pose))
        if row == len(self.near) or self.near[row] != pose:
            return None
        return self.share[:, slice(*self.refined.start[row : row + 2])]


class PlaceLikelihood:
    """Scores a query's objects against the places of a map.

    The score of place r and pose T is the sum over query objects i of
    log(1 + sum_j o_j p(i | j, T) / (c p(i | clutter))) and over the place's objects j of log(1 - P_j), where P_j is the
    probability that j is detected from T, o_j = P_j / (1 - P_j), and c is the rate of clutter. Query objects that claim
    the same object of the place share its odds.

    log_ratio: (n, M) float32, log ratio of label, height and size of query objects i and map objects j.
    position, ray: (n,) complex128, positions of the query's objects in its own frame, x + iy, and unit vectors to them.
    range_m: (n,) their distances in the plane.
    """

    def __init__(self, query: GraphNodes, index: PlaceIndex, rates: Rates, likelihood: Likelihood) -> None:
        """query: one graph, its labels numbered by the index's vocabulary, with known positions."""
        self.query, self.index, self.rates, self.likelihood = query, index, rates, likelihood
        self.position = as_complex(query.centroid_m)
        self.range_m = np.abs(self.position)
        self.ray = self.position / np.maximum(self.range_m, 1e-9)
        self.same_label = query.label[:, None] == index.label
        self.log_ratio = self._log_ratio()
        self._across = index.variance_m2 + rates.position_error_m**2
        self._along = self._across + ((rates.range_error_share * self.range_m) ** 2)[:, None]
        self._minus_log_clutter = float(-np.log(rates.clutter))

    def _log_ratio(self) -> np.ndarray:
        """The log ratio of an object that is there; one that is there with probability s has 1 + s x the ratio.

        Normal densities of height, log length and log box height are quadratic forms of the map object's values, so
        that a product of matrices evaluates all of them.
        """
        query, rates, likelihood = self.query, self.rates, self.likelihood
        look = np.array([query.centroid_m[:, 2], query.log_size[:, 0], query.log_size[:, 2]]).T
        variance = np.empty_like(look)
        variance[:, 0] = 2 * (rates.height_error_m**2 + (rates.range_error_share * look[:, 0]) ** 2)
        variance[:, 1:] = 2 * rates.length_error_log**2, 2 * rates.box_height_error_log**2
        span = np.array([likelihood.height_span_m, likelihood.size_span_log, likelihood.size_span_log])
        constant = (np.log(span) - 0.5 * (look**2 / variance + np.log(2 * np.pi * variance))).sum(1)
        constant += np.log(np.maximum(query.scores, MIN_SCORE))
        alike = np.concatenate([look / variance, -0.5 / variance, constant[:, None]], 1) @ self.index.appearance
        same = np.log(rates.label_agreement / self.index.frequency[query.label])[:, None]
        alike += np.where(self.same_label, same, np.log(1 - rates.label_agreement))
        return np.maximum(alike, -MAX_LOG_RATIO).astype(np.float32)

    @cached_property
    def peak(self) -> np.ndarray:
        """(n, M) float32: log odds of a query and a map object that coincide, but for the logit of detection."""
        at_peak = np.log(self.likelihood.area_m2 / (2 * np.pi)) - 0.5 * np.log(self._along * self._across)
        return (self.log_ratio + at_peak + self._minus_log_clutter).astype(np.float32)

    @cached_property
    def exponents(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, M) and (M,) float32: factors of a squared deviation along the query object's ray and across it."""
        return (-0.5 / self._along).astype(np.float32), (-0.5 / self._across).astype(np.float32)

    def variances(self, objects: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return the variances of a deviation along the ray, (n, m), and across it, (m,), of some map objects."""
        return self._along[:, objects], self._across[objects]

    def detection_logit(self, objects: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
        """Return the logit of detecting map objects (T,) from distances (T,), (T,) float32."""
        distance = np.maximum(distance_m, MIN_RANGE_M)
        logit = self.index.detection_logit[objects] + self.rates.detection_per_distance * np.log(distance / REFERENCE_M)
        return np.minimum(np.maximum(logit, -MAX_LOGIT), MAX_LOGIT).astype(np.float32)

    @cached_property
    def _rays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vectors along (n, 2) and across (n, 2) the rays of the query's objects, and ranges (n, 1), float32."""
        x, y = self.ray.real, self.ray.imag
        return np.array([x, y], np.float32).T, np.array([-y, x], np.float32).T, self.range_m.astype(np.float32)[:, None]

    @cached_property
    def first_camera_logit(self) -> np.ndarray:
        """(M,) float32: the logit of detecting each object from the first camera of its place."""
        index = self.index
        camera = as_complex(index.cameras_m[:, 0])
        return self.detection_logit(np.arange(len(index.label)), np.abs(index.position - camera[index.place]))

    def unplaced(self) -> np.ndarray:
        """Return the score of each place without a pose, (K,): positions are left out, and an object counts less."""
        columns = _Columns(np.arange(len(self.index.label)), self.index.segments)
        odds = np.exp(np.minimum(self.log_ratio + self.first_camera_logit + self._minus_log_clutter, MAX_LOG_RATIO))
        _, total = _share_odds(odds, columns)
        score = np.log1p(self.likelihood.unplaced_share * total).sum(0)
        return (score + _missed(self.first_camera_logit, columns)).astype(np.float64)

    def score(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Return the scores of poses (C,), and how surely each query object is each object of the pose's place.

        The shares are (n, T), the objects of the places one pose after the other.
        """
        columns = self._columns(poses)
        score, odds, total = self._evaluate(poses, columns)
        return score, odds / columns.poses.spread(total)

    def refine(self, poses: Poses) -> RefinedPoses:
        """Return poses fitted to what they explain; no score is lower than before.

        Poses that score far below the best one stay as they are.
        """
        columns = self._columns(poses)
        score, odds, total = self._evaluate(poses, columns)
        near = np.flatnonzero(score >= score.max(initial=-np.inf) - MAX_GAIN_NATS)
        columns, position = columns.take(near)
        best, best_score = poses.take(near), score[near]
        share = odds[:, position] / columns.poses.spread(total[:, near])
        for _ in range(STEPS):
            fitted = self._fit(best, columns, share)
            fitted_score, odds, total = self._evaluate(fitted, columns)
            is_better = fitted_score > best_score
            best = Poses(
                best.place,
                np.where(is_better[:, None], fitted.shift_m, best.shift_m),
                np.where(is_better, fitted.yaw_rad, best.yaw_rad),
            )
            best_score = np.where(is_better, fitted_score, best_score)
            share = np.where(columns.poses.spread(is_better), odds / columns.poses.spread(total), share)
        shift_m, yaw_rad = poses.shift_m.copy(), poses.yaw_rad.copy()
        shift_m[near], yaw_rad[near], score[near] = best.shift_m, best.yaw_rad, best_score
        return RefinedPoses(Poses(poses.place, shift_m, yaw_rad), score, near, columns.poses, share)

    def _columns(self, poses: Poses) -> _Columns:
        count = self.index.count[poses.place]
        return _Columns(ranges(self.index.segments.start[poses.place], count), Segments(count))

    def _evaluate(self, poses: Poses, columns: _Columns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The scores of poses (C,), the odds (n, T) of each pair, and 1 + their sum for each query object (n, C)."""
        objects = columns.objects
        away = self.index.position[objects] - columns.poses.spread(as_complex(poses.shift_m))
        logit = self.detection_logit(objects, np.abs(away))
        away *= columns.poses.spread(np.exp(-1j * poses.yaw_rad))
        turned = np.array([away.real, away.imag], np.float32)
        ray, normal, range_m = self._rays
        forth = ray @ turned
        forth -= range_m  # the query object lies on its own ray
        side = normal @ turned
        along, across = self.exponents
        log_odds = forth
        log_odds *= forth
        log_odds *= along.take(objects, 1)
        side *= side
        side *= across[objects]
        log_odds += side
        log_odds += self.peak.take(objects, 1)
        log_odds += logit
        odds, total = _share_odds(np.exp(np.minimum(log_odds, MAX_LOG_RATIO, out=log_odds), out=log_odds), columns)
        total = 1 + total
        return (np.log(total).sum(0) + _missed(logit, columns)).astype(np.float64), odds, total

    def _fit(self, poses: Poses, columns: _Columns, share: np.ndarray) -> Poses:
        """Poses fitted in closed form to shares (n, T), pairs weighted by their certainty."""
        objects = columns.objects
        weight = share / self._along[:, objects]
        by_query, by_object = columns.poses.sum(weight), weight.sum(0)
        total = np.maximum(by_query.sum(0), 1e-12)
        there = self.index.position[objects]
        middle = (self.position @ by_query) / total
        middle_there = columns.poses.sum(by_object * there) / total
        products = columns.poses.sum((self.position.conj() @ weight) * there)
        yaw = np.angle(products - total * middle.conj() * middle_there)
        shift = middle_there - np.exp(1j * yaw) * middle
        return Poses(poses.place, np.array([shift.real, shift.imag]).T, yaw)


def _share_odds(odds: np.ndarray, columns: _Columns) -> tuple[np.ndarray, np.ndarray]:
    """Odds (n, T) after query objects that claim the same map object share them, and their sums (n, C)."""
    certainty = columns.poses.spread(1 / (1 + columns.poses.sum(odds)))
    odds /= np.maximum(np.einsum("it,it->t", odds, certainty), 1)
    return odds, columns.poses.sum(odds)


def _missed(logit: np.ndarray, columns: _Columns) -> np.ndarray:
    """Log probability that no object is detected, (C,), of logits (T,)."""
    return -columns.poses.sum(np.log1p(np.exp(logit)))
