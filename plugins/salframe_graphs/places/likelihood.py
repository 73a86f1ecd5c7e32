"""Log likelihood ratio of a query's objects: objects of a place viewed from a pose, against clutter
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
from salframe_graphs.sectors import Sectors

MIN_RANGE_M, REFERENCE_M = 0.5, 2.0
"""Distance below which the probability of detection is constant, and the distance to which `detection_logit` refers."""
MIN_SCORE = 1e-3
"""Lower bound of a detector's score, which keeps its logarithm finite."""
MAX_LOGIT, MAX_LOG_RATIO = 6.0, 50.0
"""Bounds of a detection logit and of a log ratio, which keep exponentials finite."""
MAX_GAIN_NATS = 30.0
"""Maximum difference between the best score and that of a pose to refine. Refinement increases a score by 0.7 in the
median, by 9 at the 99th percentile, and by at most 21 (126 queries of `house-42`, seed 100)."""
STEPS = 2
"""Number of times that a pose is fitted to the objects that it explains."""


@dataclass(frozen=True, eq=False)
class Poses:
    """C poses of a query in the world.

    Attributes:
        place: (C,) number of the place of each pose.
        shift_m: (C, 2) x and y in the world, metres.
        yaw_rad: (C,) heading in the world.
    """

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
    """The objects of the places of C poses, one pose after the other.

    Attributes:
        objects: (T,) numbers of the objects in the index.
        poses: The objects grouped by pose.
    """

    objects: np.ndarray
    poses: Segments

    def take(self, poses: np.ndarray) -> tuple[_Columns, np.ndarray]:
        """Return the columns of a subset of the poses, and their positions among all columns."""
        count = self.poses.count[poses]
        position = ranges(self.poses.start[poses], count)
        return _Columns(self.objects[position], Segments(count)), position


@dataclass(frozen=True, eq=False)
class RefinedPoses:
    """C poses with their scores, of which R were refined.

    Attributes:
        poses: The poses.
        score: (C,) score of each pose.
        rows: (R,) numbers of the refined poses, whose initial scores were near the best one.
        refined: The columns of `share`, grouped by refined pose.
        share: (n, T) probability that each query object is each object of the pose's place.
    """

    poses: Poses
    score: np.ndarray
    rows: np.ndarray
    refined: Segments
    share: np.ndarray

    def share_of(self, pose: int) -> np.ndarray | None:
        """Return the shares (n, m) of a pose; None where it was not refined."""
        row = int(np.searchsorted(self.rows, pose))
        if row == len(self.rows) or self.rows[row] != pose:
            return None
        return self.share[:, slice(*self.refined.start[row : row + 2])]


class PlaceLikelihood:
    """Scores a query's objects against the places of a map.

    The score of place r and pose T is the sum over query objects i of
    log(1 + sum_j o_j p(i | j, T) / (c p(i | clutter))) and over the place's objects j of log(1 - P_j), where P_j is the
    probability that j is detected from T, o_j = P_j / (1 - P_j), and c is the rate of clutter. Query objects that
    compete for the same object of the place share its odds. The second sum is over objects that the query should show:
    in its sectors, and not behind walls.

    Attributes:
        log_ratio: (n, M) float32, log ratio of label, height and size of query objects i and map objects j.
        position: (n,) complex128, positions x + iy of the query's objects in the query frame, metres.
        ray: (n,) complex128, unit vectors to the query's objects.
        range_m: (n,) horizontal distances of the query's objects.
    """

    def __init__(
        self,
        query: GraphNodes,
        index: PlaceIndex,
        rates: Rates,
        likelihood: Likelihood,
        sectors: Sectors | None = None,
        camera_height_m: float = np.nan,
    ) -> None:
        """Compare a query with the places of an index.

        Args:
            query: One graph with known positions and labels numbered by the index's vocabulary.
            index: The places.
            rates: Error rates of the detector.
            likelihood: Constants of the likelihood.
            sectors: Sectors that the query shows; None: all of them.
            camera_height_m: Height of the query's camera over the floor; NaN: unknown, equal to that of the map.
        """
        self.query, self.index, self.rates, self.likelihood = query, index, rates, likelihood
        self.sectors = sectors
        self.position = as_complex(query.centroid_m)
        self.range_m = np.abs(self.position)
        self.ray = self.position / np.maximum(self.range_m, 1e-9)
        self.same_label = query.label[:, None] == index.label
        self.log_ratio = self._log_ratio(index.appearance(camera_height_m))
        self._across = index.variance_m2 + rates.position_error_m**2
        self._along = self._across + ((rates.range_error_share * self.range_m) ** 2)[:, None]
        self._minus_log_clutter = float(-np.log(rates.clutter))

    def _log_ratio(self, map_appearance: np.ndarray) -> np.ndarray:
        """Return the log ratio of label, height and size, including the detector's score of the query object.

        A query object that is real with probability s (the score) contributes 1 + s x ratio. The normal densities of
        height, log length and log box height are quadratic forms of the map object's values, so one matrix product
        evaluates all of them.
        """
        query, rates, likelihood = self.query, self.rates, self.likelihood
        appearance = np.array([query.centroid_m[:, 2], query.log_size[:, 0], query.log_size[:, 2]]).T
        variance = np.empty_like(appearance)
        variance[:, 0] = 2 * (rates.height_error_m**2 + (rates.range_error_share * appearance[:, 0]) ** 2)
        variance[:, 1:] = 2 * rates.length_error_log**2, 2 * rates.box_height_error_log**2
        span = np.array([likelihood.height_span_m, likelihood.size_span_log, likelihood.size_span_log])
        constant = (np.log(span) - 0.5 * (appearance**2 / variance + np.log(2 * np.pi * variance))).sum(1)
        constant += np.log(np.maximum(query.scores, MIN_SCORE))
        log_ratio_sum = np.concatenate([appearance / variance, -0.5 / variance, constant[:, None]], 1) @ map_appearance
        same_label_ratio = np.log(rates.label_agreement / self.index.frequency[query.label])[:, None]
        log_ratio_sum += np.where(self.same_label, same_label_ratio, np.log(1 - rates.label_agreement))
        return np.maximum(log_ratio_sum, -MAX_LOG_RATIO).astype(np.float32)

    @cached_property
    def peak(self) -> np.ndarray:
        """(n, M) float32: log odds of query and map objects at the same position, without the detection logit."""
        at_peak = np.log(self.likelihood.area_m2 / (2 * np.pi)) - 0.5 * np.log(self._along * self._across)
        return (self.log_ratio + at_peak + self._minus_log_clutter).astype(np.float32)

    @cached_property
    def exponents(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, M) and (M,) float32: factors of the squared deviation along the query object's ray and across it."""
        return (-0.5 / self._along).astype(np.float32), (-0.5 / self._across).astype(np.float32)

    def variances(self, objects: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return the variances of map objects along the ray of each query object (n, m), and across it (m,)."""
        return self._along[:, objects], self._across[objects]

    def detection_logit(self, objects: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
        """Return the logit (T,) float32 of the probability to detect map objects (T,) from distances (T,)."""
        distance = np.maximum(distance_m, MIN_RANGE_M)
        logit = self.index.detection_logit[objects] + self.rates.detection_per_distance * np.log(distance / REFERENCE_M)
        return np.minimum(np.maximum(logit, -MAX_LOGIT), MAX_LOGIT).astype(np.float32)

    @cached_property
    def _rays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vectors along and across the rays of the query's objects, (n, 2) each, and ranges (n, 1); float32."""
        x, y = self.ray.real, self.ray.imag
        return np.array([x, y], np.float32).T, np.array([-y, x], np.float32).T, self.range_m.astype(np.float32)[:, None]

    @cached_property
    def first_camera_logit(self) -> np.ndarray:
        """(M,) float32: logit of the probability to detect each object from the first camera of its place."""
        index = self.index
        camera = as_complex(index.cameras_m[:, 0])
        return self.detection_logit(np.arange(len(index.label)), np.abs(index.position - camera[index.place]))

    def score_without_pose(self) -> np.ndarray:
        """Return the score (K,) of each place without a pose.

        Positions are ignored, and the odds of an object are multiplied by `unplaced_share`. The logarithm of the
        probability that no object is detected is multiplied by the share of sectors that the query shows.
        """
        columns = _Columns(np.arange(len(self.index.label)), self.index.segments)
        odds = np.exp(np.minimum(self.log_ratio + self.first_camera_logit + self._minus_log_clutter, MAX_LOG_RATIO))
        _, total = _share_odds(odds, columns)
        score = np.log1p(self.likelihood.unplaced_share * total).sum(0)
        seen_share = 1.0 if self.sectors is None else self.sectors.share
        return (score + seen_share * _log_undetected(self.first_camera_logit, columns)).astype(np.float64)

    def score(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Return the scores of poses (C,), and the probability that each query object is each object of the place.

        The probabilities are (n, T), with the objects of the places one pose after the other.
        """
        columns = self._columns(poses)
        score, odds, total = self._evaluate(poses, columns)
        return score, odds / columns.poses.spread(total)

    def refine(self, poses: Poses) -> RefinedPoses:
        """Fit poses to the objects that they explain. A score never decreases.

        Poses with scores more than MAX_GAIN_NATS below the best one are not refined.
        """
        columns = self._columns(poses)
        score, odds, total = self._evaluate(poses, columns)
        rows = np.flatnonzero(score >= score.max(initial=-np.inf) - MAX_GAIN_NATS)
        columns, position = columns.take(rows)
        best, best_score = poses.take(rows), score[rows]
        share = odds[:, position] / columns.poses.spread(total[:, rows])
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
        shift_m[rows], yaw_rad[rows], score[rows] = best.shift_m, best.yaw_rad, best_score
        return RefinedPoses(Poses(poses.place, shift_m, yaw_rad), score, rows, columns.poses, share)

    def _columns(self, poses: Poses) -> _Columns:
        count = self.index.count[poses.place]
        return _Columns(ranges(self.index.segments.start[poses.place], count), Segments(count))

    def _evaluate(self, poses: Poses, columns: _Columns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return scores (C,), odds (n, T) of each pair, and 1 + the sum of odds of each query object (n, C)."""
        objects = columns.objects
        offset = self.index.position[objects] - columns.poses.spread(as_complex(poses.shift_m))
        logit = self.detection_logit(objects, np.abs(offset))
        offset *= columns.poses.spread(np.exp(-1j * poses.yaw_rad))
        rotated = np.array([offset.real, offset.imag], np.float32)
        is_shown = None if self.sectors is None else self.sectors.show(offset)
        ray, normal, range_m = self._rays
        along_m = ray @ rotated
        along_m -= range_m  # the query object lies on its own ray
        across_m = normal @ rotated
        along, across = self.exponents
        log_odds = along_m
        log_odds *= along_m
        log_odds *= along.take(objects, 1)
        across_m *= across_m
        across_m *= across[objects]
        log_odds += across_m
        log_odds += self.peak.take(objects, 1)
        log_odds += logit
        odds, total = _share_odds(np.exp(np.minimum(log_odds, MAX_LOG_RATIO, out=log_odds), out=log_odds), columns)
        total = 1 + total
        undetected = _log_undetected(logit, columns, is_shown)
        return (np.log(total).sum(0) + undetected).astype(np.float64), odds, total

    def _fit(self, poses: Poses, columns: _Columns, share: np.ndarray) -> Poses:
        """Return poses fitted in closed form to pairs weighted by their shares (n, T) and the inverse variance."""
        objects = columns.objects
        weight = share / self._along[:, objects]
        by_query, by_object = columns.poses.sum(weight), weight.sum(0)
        total = np.maximum(by_query.sum(0), 1e-12)
        map_position = self.index.position[objects]
        query_mean = (self.position @ by_query) / total
        map_mean = columns.poses.sum(by_object * map_position) / total
        x, y = np.array([self.position.real, self.position.imag]) @ weight  # a complex factor would copy the weights
        products = columns.poses.sum((x - 1j * y) * map_position)
        yaw = np.angle(products - total * query_mean.conj() * map_mean)
        shift = map_mean - np.exp(1j * yaw) * query_mean
        return Poses(poses.place, np.array([shift.real, shift.imag]).T, yaw)


def _share_odds(odds: np.ndarray, columns: _Columns) -> tuple[np.ndarray, np.ndarray]:
    """Divide the odds of each map object among the query objects that compete for it.

    Returns:
        The odds (n, T), and their sums for each query object and pose (n, C).
    """
    certainty = columns.poses.spread(1 / (1 + columns.poses.sum(odds)))
    odds /= np.maximum(np.einsum("it,it->t", odds, certainty), 1)
    return odds, columns.poses.sum(odds)


def _log_undetected(logit: np.ndarray, columns: _Columns, is_shown: np.ndarray | None = None) -> np.ndarray:
    """Return the log probability (C,) that none of the objects is detected, from their logits (T,).

    Only objects in sectors that the query shows count, `is_shown` (T,) bool; None: all of them.
    """
    loss = np.log1p(np.exp(logit))
    return -columns.poses.sum(loss if is_shown is None else loss * is_shown)
