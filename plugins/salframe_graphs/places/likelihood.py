"""Log likelihood ratio of a query's objects. Hypothesis: objects of a place, viewed from a pose. Alternative: clutter
(docs/explanation/likelihood-ratio.md#the-likelihood-ratio)."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from salframe.graphs.segments import Segments, ranges
from salframe.panoramas.geometry import as_complex
from salframe_graphs.places.bearing_objects import BearingObjects
from salframe_graphs.places.fitting import fit_positions, fit_step
from salframe_graphs.places.observations import MAX_LOG_RATIO, ObservedObjects
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.poses import PoseColumns, Poses, RefinedPoses, RelativeObjects
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.ranged_objects import RangedObjects
from salframe_graphs.places.rates import Likelihood, Rates
from salframe_graphs.sectors import Sectors

MIN_RANGE_M, REFERENCE_M = 0.5, 2.0
"""Distance (m) below which the probability of detection is constant, and the distance (m) to which the constant
`detection_logit` refers."""
MAX_LOGIT = 6.0
"""Bound of a detection logit, which keeps exponentials finite."""
MAX_GAIN_NATS = 30.0
"""Poses with a score further below the best score are not refined. Refinement increases a score by 0.7 in the median,
by 9 at the 99th percentile, and by at most 21 (126 queries of `house-42`, seed 100)."""
STEPS = 2
"""Number of times that a pose is fitted to the objects that it explains."""
MIN_PAIR_SHARE = 1e-3
"""Minimum probability that a query object is a map object. A pose is fitted to bearings with such pairs only."""


class PlaceLikelihood:
    """Scores a query's objects against the places of a map.

    The score of a place and a pose T is the sum of two sums:

    - over the query objects i: log(1 + sum_j o_j p(i | j, T) / (c p(i | clutter)))
    - over the objects j of the place: log(1 - P_j)

    P_j is the probability that j is detected from T, and o_j = P_j / (1 - P_j). Clutter consists of the query objects
    that are not in the place, and c is its rate. If several query objects match the same object of the place, the odds
    of this object are divided among them. The second sum contains only objects that the query should show: objects in
    its sectors that are not behind walls. The height of the camera and the scale of the ranges are also unknown. Their
    normal priors are terms of the score.

    Attributes:
        query: The n objects of the query, first those with range.
        index: The places, with M objects.
        object_groups: The query's objects with range, and those without range; an empty group is left out.
        log_ratio: (n, M) float32, log ratio of the observations that do not depend on the pose.
        same_label: (n, M) bool, whether query object and map object have the same label.
    """

    def __init__(
        self,
        query: QueryObjects,
        index: PlaceIndex,
        rates: Rates,
        likelihood: Likelihood,
        sectors: Sectors | None = None,
        camera_height_m: float = np.nan,
    ) -> None:
        """Compare a query with the places of an index.

        Args:
            query: The objects of the query, with labels numbered by the index's vocabulary.
            index: The places.
            rates: Error rates of the detector.
            likelihood: Constants of the likelihood.
            sectors: Sectors that the query shows; None: all of them.
            camera_height_m: Height of the query's camera above the floor; NaN: unknown, assumed equal to the height of
                the map's cameras.
        """
        self.query, self.index, self.rates, self.likelihood = query, index, rates, likelihood
        self.sectors = sectors
        self._map_height_m = index.z_m + index.segments.spread(index.camera_height_offset_m(camera_height_m))
        self.object_groups: list[ObservedObjects] = []
        if query.num_ranged:
            self.object_groups.append(RangedObjects(query.ranged, index, rates, likelihood, camera_height_m))
        if self.has_bearings:
            self.object_groups.append(BearingObjects(query.bearings, index, rates, likelihood, self._map_height_m))
        self.same_label = np.concatenate([group.same_label for group in self.object_groups])
        self.log_ratio = np.concatenate([group.log_ratio for group in self.object_groups])
        self._minus_log_clutter = float(-np.log(rates.clutter))
        self._detection_logit, self._detection_per_distance = index.detection_logit, rates.detection_per_distance
        if not query.num_ranged:
            bearings = likelihood.bearings
            self._detection_logit = bearings.detection_logit + bearings.detection_per_logit * index.detection_logit
            self._detection_per_distance = bearings.detection_per_distance

    @property
    def has_bearings(self) -> bool:
        """Whether the query has objects without range."""
        return self.query.num_ranged < len(self.query)

    def rows_of(self, i: np.ndarray) -> list[tuple[ObservedObjects, np.ndarray | slice, np.ndarray]]:
        """Split query objects i (P,) by group: objects with range, and objects with a bearing only.

        Returns:
            For each group that contains objects of `i`: the group, the positions of its objects in `i`, and the indices
            of these objects in the group.
        """
        if len(self.object_groups) == 1:
            return [(self.object_groups[0], slice(None), i)]
        first = 0
        rows: list[tuple[ObservedObjects, np.ndarray | slice, np.ndarray]] = []
        for group in self.object_groups:
            count = len(group.log_ratio)
            position = np.flatnonzero((i >= first) & (i < first + count))
            if len(position):
                rows.append((group, position, i[position] - first))
            first += count
        return rows

    def pair_log_odds(self, i: np.ndarray, relative: RelativeObjects) -> np.ndarray:
        """Return the log odds (T,) that query object i[t] is map object t, without the detection logit.

        Args:
            i: (T,) indices of the query objects.
            relative: The T map objects.
        """
        log_odds = np.empty(len(i))
        for group, position, row in self.rows_of(i):
            log_odds[position] = group.pair_log_odds(row, relative.take(position))
        return log_odds

    def detection_logit(self, objects: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
        """Return the logit (T,) float32 of the probability that a camera at a given distance detects a map object.

        Args:
            objects: (T,) indices of the objects in the index.
            distance_m: (T,) horizontal distances between camera and object.
        """
        distance = np.maximum(distance_m, MIN_RANGE_M)
        logit = self._detection_logit[objects] + self._detection_per_distance * np.log(distance / REFERENCE_M)
        return np.minimum(np.maximum(logit, -MAX_LOGIT), MAX_LOGIT).astype(np.float32)

    @cached_property
    def first_camera_logit(self) -> np.ndarray:
        """(M,) float32: logit of the probability to detect each object from the first camera of its place."""
        index = self.index
        camera = as_complex(index.cameras_m[:, 0])
        return self.detection_logit(np.arange(len(index.label)), np.abs(index.position - camera[index.place]))

    def log_prior(self, poses: Poses) -> np.ndarray:
        """Return the log prior (C,) of the height of the camera and of the scale of the ranges, relative to its
        maximum."""
        likelihood = self.likelihood
        deviation = np.array(
            [
                poses.camera_height_offset_m / likelihood.camera_height_error_m,
                (poses.scale - 1) / likelihood.scale_error,
            ]
        )
        return -0.5 * (deviation * deviation).sum(0)

    def score_without_pose(self) -> np.ndarray:
        """Return a score (K,) for every place, computed without a pose of the query.

        Positions are ignored, and the odds of an object are multiplied by `unplaced_share`. The logarithm of the
        probability that no object is detected is multiplied by the fraction of sectors that the query shows.
        """
        columns = PoseColumns(np.arange(len(self.index.label)), self.index.segments)
        odds = np.exp(np.minimum(self.log_ratio + self.first_camera_logit + self._minus_log_clutter, MAX_LOG_RATIO))
        _, total = _share_odds(odds, columns)
        score = np.log1p(self.likelihood.unplaced_share * total).sum(0)
        visible_share = 1.0 if self.sectors is None else self.sectors.share
        return (score + visible_share * _log_undetected(self.first_camera_logit, columns)).astype(np.float64)

    def score(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Return the scores (C,) of poses, and the probability (n, T) that a query object is an object of the place.

        The T columns are the objects of the first pose's place, then the objects of the second pose's place, and so on.
        """
        columns = self._columns(poses)
        score, odds, total = self._evaluate(poses, columns)
        return score, odds / columns.segments.spread(total)

    def refine(self, poses: Poses) -> RefinedPoses:
        """Fit each pose to the objects that it explains. A fit that would lower the score is discarded.

        Poses with scores more than MAX_GAIN_NATS below the best one are not refined.
        """
        columns = self._columns(poses)
        score, odds, total = self._evaluate(poses, columns)
        rows = np.flatnonzero(score >= score.max(initial=-np.inf) - MAX_GAIN_NATS)
        columns, position = columns.take(rows)
        best, best_score = poses.take(rows), score[rows]
        share = odds[:, position] / columns.segments.spread(total[:, rows])
        for _ in range(STEPS):
            fitted = self._fit(best, columns, share)
            fitted_score, odds, total = self._evaluate(fitted, columns)
            is_better = fitted_score > best_score
            best = fitted.where(is_better, best)
            best_score = np.where(is_better, fitted_score, best_score)
            share = np.where(columns.segments.spread(is_better), odds / columns.segments.spread(total), share)
        score[rows] = best_score
        return RefinedPoses(poses.put(rows, best), score, rows, columns.segments, share)

    def relative(self, poses: Poses, columns: PoseColumns) -> RelativeObjects:
        """Return the map objects of the place of each pose, relative to the query's camera at that pose."""
        objects, spread = columns.objects, columns.segments.spread
        yaw_rad = spread(poses.yaw_rad)
        offset = self.index.position[objects] - spread(as_complex(poses.shift_m))
        offset *= spread(np.exp(-1j * poses.yaw_rad))
        height_m = self._map_height_m[objects] - spread(poses.camera_height_offset_m)
        return RelativeObjects(objects, offset, height_m, yaw_rad, spread(poses.scale))

    def _columns(self, poses: Poses) -> PoseColumns:
        count = self.index.count[poses.place]
        return PoseColumns(ranges(self.index.segments.start[poses.place], count), Segments(count))

    def _evaluate(self, poses: Poses, columns: PoseColumns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return scores (C,), odds (n, T) of each pair, and 1 + the sum (n, C) of the odds of each query object."""
        relative = self.relative(poses, columns)
        logit = self.detection_logit(columns.objects, np.abs(relative.offset))
        is_shown = None if self.sectors is None else self.sectors.show(relative.offset)
        by_group = [group.log_odds(relative) for group in self.object_groups]
        log_odds = by_group[0] if len(by_group) == 1 else np.concatenate(by_group)
        log_odds += logit
        odds, total = _share_odds(np.exp(np.minimum(log_odds, MAX_LOG_RATIO, out=log_odds), out=log_odds), columns)
        total = 1 + total
        undetected = _log_undetected(logit, columns, is_shown)
        score = (np.log(total).sum(0) + undetected).astype(np.float64) + self.log_prior(poses)
        return score, odds, total

    def _fit(self, poses: Poses, columns: PoseColumns, share: np.ndarray) -> Poses:
        """Return poses fitted to pairs with the weights `share` (n, T).

        The fit is in closed form if all objects have range. Otherwise it is one Gauss-Newton step.
        """
        group = self.object_groups[0]
        if len(self.object_groups) == 1 and isinstance(group, RangedObjects):
            return fit_positions(group, self.index, poses, columns, share, self.likelihood.scale_error)
        t, i = np.nonzero(share.T > MIN_PAIR_SHARE)
        pose = columns.segments.spread(np.arange(len(poses)))[t]
        return fit_step(self, poses, pose, i, self.relative(poses, columns).take(t), share[i, t])[0]


def _share_odds(odds: np.ndarray, columns: PoseColumns) -> tuple[np.ndarray, np.ndarray]:
    """Divide the odds of each map object among the query objects that compete for it.

    Returns:
        The divided odds (n, T), and their sums (n, C) for each query object and pose.
    """
    certainty = columns.segments.spread(1 / (1 + columns.segments.sum(odds)))
    odds /= np.maximum(np.einsum("it,it->t", odds, certainty), 1)
    return odds, columns.segments.sum(odds)


def _log_undetected(logit: np.ndarray, columns: PoseColumns, is_shown: np.ndarray | None = None) -> np.ndarray:
    """Return the log probability (C,) that none of the objects is detected, from their logits (T,).

    Only the objects with `is_shown` (T,) bool count, which are in sectors that the query shows; None: all objects.
    """
    loss = np.log1p(np.exp(logit))
    return -columns.segments.sum(loss if is_shown is None else loss * is_shown)
