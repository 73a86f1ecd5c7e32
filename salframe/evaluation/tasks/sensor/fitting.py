"""From a detector's answers beside the annotations of the same panoramas to a sensor model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from salframe.evaluation.tasks.detection.judging import NEAR_M
from salframe.graphs.detections import Detections
from salframe.graphs.sensor import Errors, FalseObjects, FoundModel, Provenance, SensorModel, quantiles
from salframe.graphs.sightings import Sightings
from salframe.graphs.vocabulary import common_label

REACH_SHARE, OTHER_REACH_SHARE = 0.5, 0.25
"""An object is found by a detection within NEAR_M, or this share of its longest side where that is more: half of it by
one of its label, a quarter by one of another."""
ROUNDS, TOLERANCE = 200, 1e-6
WEAK_PRECISION = 1e-3
"""Of the prior of what all objects share, so that slopes stay finite where every object was found, or none."""
FLOOR_VARIANCE = 1e-4
"""Of the offsets: less is taken for no difference between groups."""


@dataclass(frozen=True, eq=False)
class Look:
    """One panorama: the annotated objects, how each shows, and what the detector found there."""

    truth: Detections
    shown: Sightings
    found: Detections


@dataclass(frozen=True, eq=False)
class Observations:
    """What N annotated objects and the detections of several panoramas say together.

    shown: how the objects show; said: the detector's label of each, None where it was not found; bearing_rad (M, 2),
    range_log (M,), size_log (M,), height_m (M,): errors of the M found; of the false ones, the labels and (K,) range_m,
    elevation_rad, size_m. NaN where a detection does not tell.
    """

    panoramas: int
    shown: Sightings
    said: tuple[str | None, ...]
    bearing_rad: np.ndarray
    range_log: np.ndarray
    size_log: np.ndarray
    height_m: np.ndarray
    false_labels: tuple[str, ...]
    false_range_m: np.ndarray
    false_elevation_rad: np.ndarray
    false_size_m: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(N,) bool."""
        return np.array([said is not None for said in self.said], bool)

    @property
    def right(self) -> np.ndarray:
        """(N,) bool: found by a label that is right in the words that detectors share."""
        return np.array(
            [
                said is not None and common_label(said) == common_label(own)
                for said, own in zip(self.said, self.shown.labels, strict=True)
            ],
            bool,
        )


def match_objects(found: Detections, truth: Detections) -> np.ndarray:
    """(T,) int: the detection that finds each annotated object, -1 where none does.

    One to one, as many as can be, then the nearest: first among those of one label in the words that detectors share,
    then the others. A detection of unknown range is as far as its bearing at the object's range is.
    """
    answer = np.full(len(truth), -1)
    if not len(found) or not len(truth):
        return answer
    distance_m = _distances(found, truth)
    longest_m = np.nan_to_num(truth.size_m.max(1))
    group, own = (np.array([common_label(label) for label in side.labels]) for side in (found, truth))
    same = group[:, None] == own
    for eligible, share in ((same, REACH_SHARE), (~same, OTHER_REACH_SHARE)):
        near = eligible & (distance_m <= np.maximum(NEAR_M, share * longest_m))
        near &= (answer < 0) & ~np.isin(np.arange(len(found)), answer)[:, None]
        for detection, thing in zip(*_assign(near, distance_m), strict=True):
            answer[thing] = detection
    return answer


def _assign(near: np.ndarray, distance_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pairs of a one-to-one assignment among those near: as many as can be, then the least distance."""
    from scipy.optimize import linear_sum_assignment

    most = 1 + np.where(near, distance_m, 0).sum()
    rows, columns = linear_sum_assignment(np.where(near, distance_m - most, 0))
    kept = near[rows, columns]
    return rows[kept], columns[kept]


def _distances(found: Detections, truth: Detections) -> np.ndarray:
    """(F, T) metres between centroids; across the bearing where a detection's range is unknown."""
    apart = np.linalg.norm(found.centroid_m[:, None] - truth.centroid_m, axis=2)
    across = np.arccos(np.clip(found.bearing @ truth.bearing.T, -1, 1)) * np.linalg.norm(truth.centroid_m, axis=1)
    return np.nan_to_num(np.where(np.isnan(apart), across, apart), nan=np.inf)


def observe(looks: Iterable[Look]) -> Observations:
    """Match the detections of each panorama with its annotations and gather what they say."""
    looks = list(looks)
    said: list[str | None] = []
    errors, false = [np.zeros((0, 5))], [np.zeros((0, 3))]
    false_labels: list[str] = []
    for look in looks:
        index = match_objects(look.found, look.truth)
        said += [None if i < 0 else look.found.labels[i] for i in index]
        errors.append(_errors(look.found.take(index[index >= 0]), look.truth.take(np.flatnonzero(index >= 0))))
        extra = look.found.take(np.setdiff1d(np.arange(len(look.found)), index))
        false_labels += extra.labels
        range_m = np.linalg.norm(extra.centroid_m, axis=1)
        false.append(np.column_stack([range_m, _elevation(extra), _size(extra)]))
    shown = [look.shown for look in looks]
    labels = tuple(label for one in shown for label in one.labels)
    columns = ("solid_angle_sr", "range_m", "hidden_share")
    together = Sightings(labels, *(np.concatenate([[], *(getattr(one, name) for one in shown)]) for name in columns))
    error, extras = np.concatenate(errors), np.concatenate(false)
    return Observations(
        panoramas=len(looks),
        shown=together,
        said=tuple(said),
        bearing_rad=error[:, :2],
        range_log=error[:, 2],
        size_log=error[:, 3],
        height_m=error[:, 4],
        false_labels=tuple(false_labels),
        false_range_m=extras[:, 0],
        false_elevation_rad=extras[:, 1],
        false_size_m=extras[:, 2],
    )


def _errors(found: Detections, truth: Detections) -> np.ndarray:
    """(M, 5): errors of bearing to the left and up in rad, logarithms of range and size, and of height in m."""
    left = np.stack([-truth.bearing[:, 1], truth.bearing[:, 0], np.zeros(len(truth))], 1)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    up = np.cross(truth.bearing, left)
    ahead = (found.bearing * truth.bearing).sum(1)
    bearing = [np.arctan2((found.bearing * axis).sum(1), ahead) for axis in (left, up)]
    ranges = [np.linalg.norm(one.centroid_m, axis=1) for one in (found, truth)]
    height = found.centroid_m[:, 2] - truth.centroid_m[:, 2]
    return np.column_stack([*bearing, np.log(ranges[0] / ranges[1]), np.log(_size(found) / _size(truth)), height])


def _elevation(detections: Detections) -> np.ndarray:
    return np.arctan2(detections.bearing[:, 2], np.hypot(detections.bearing[:, 0], detections.bearing[:, 1]))


def _size(detections: Detections) -> np.ndarray:
    """(N,) metres: cube root of the boxes' volume."""
    return np.cbrt(detections.size_m.prod(1))


def fit_sensor(seen: Observations, provenance: Mapping[str, object]) -> SensorModel:
    """The sensor model that observations say; `provenance`: its fields but for the counts."""
    confusion: dict[str, Counter[str]] = {}
    for own, said in zip(seen.shown.labels, seen.said, strict=True):
        if said is not None:
            confusion.setdefault(own, Counter())[said] += 1
    false = (seen.false_range_m, seen.false_elevation_rad, seen.false_size_m)
    range_m, elevation_rad, size_m = (quantiles(values[np.isfinite(values)]) for values in false)
    return SensorModel(
        provenance=Provenance(
            **provenance, panoramas=seen.panoramas, objects=len(seen.said), found=int(seen.found.sum())
        ),
        found=fit_found(seen.shown, seen.found),
        confusion={label: dict(sorted(confusion[label].items())) for label in sorted(confusion)},
        false_objects=FalseObjects(
            per_panorama=_rounded(len(seen.false_labels) / max(seen.panoramas, 1)),
            labels=dict(sorted(Counter(seen.false_labels).items())),
            range_m=range_m,
            elevation_rad=elevation_rad,
            size_m=size_m,
        ),
        errors=Errors(
            bearing_rad=robust_deviation(seen.bearing_rad.ravel()),
            range_share=robust_deviation(seen.range_log),
            size_log=robust_deviation(seen.size_log),
            height_m=robust_deviation(seen.height_m),
        ),
    )


def robust_deviation(values: np.ndarray) -> float:
    """1.4826 times the median distance from the median, of the finite values; 0 of none."""
    values = values[np.isfinite(values)]
    return _rounded(1.4826 * np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def fit_found(shown: Sightings, found: np.ndarray) -> FoundModel:
    """The model of P(found) by penalized likelihood: a logistic regression whose offsets by group are drawn from a
    normal distribution, the variance of which comes from expectation maximization with Laplace's approximation."""
    groups = sorted({common_label(label) for label in shown.labels})
    group = np.array([groups.index(common_label(label)) for label in shown.labels], int)
    references = {
        "reference_solid_angle_sr": _median(shown.solid_angle_sr, 0.01),
        "reference_range_m": _median(shown.range_m, 3.0),
        "reference_hidden_share": _median(shown.hidden_share, 0.0),
    }
    flat = FoundModel(
        intercept=0, per_log_solid_angle=0, per_log_range=0, per_hidden_share=0, offsets={}, offset_deviation=0,
        **references,
    )  # fmt: skip
    terms = flat.terms(len(group), shown.solid_angle_sr, shown.range_m, shown.hidden_share)
    design = np.column_stack([np.ones(len(group)), terms, np.eye(len(groups))[group]])
    answer, variance = np.zeros(design.shape[1]), 1.0
    for _ in range(ROUNDS):
        precision = np.repeat([WEAK_PRECISION, 1 / variance], [4, len(groups)])
        answer, covariance = _maximize(design, found.astype(float), precision, answer)
        spread = float(np.mean(answer[4:] ** 2 + np.diag(covariance)[4:])) if groups else 0.0
        settled, variance = abs(spread - variance) < TOLERANCE * variance, max(spread, FLOOR_VARIANCE)
        if settled:
            break
    intercept, *slopes = map(_rounded, answer[:4])
    names = ("per_log_solid_angle", "per_log_range", "per_hidden_share")
    return FoundModel(
        intercept=intercept,
        **dict(zip(names, slopes, strict=True)),
        **references,
        offsets=dict(zip(groups, map(_rounded, answer[4:]), strict=True)),
        offset_deviation=_rounded(np.sqrt(variance)),
    )


def _maximize(
    design: np.ndarray, found: np.ndarray, precision: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The most likely coefficients under a normal prior of these precisions, by Newton's steps, halved where one would
    overshoot; and the inverse of the curvature there."""

    def loss(weights: np.ndarray) -> float:
        logit = design @ weights
        return float(np.logaddexp(0, logit).sum() - found @ logit + precision @ weights**2 / 2)

    answer, least = start, loss(start)
    for _ in range(ROUNDS):
        chance = 1 / (1 + np.exp(-(design @ answer)))
        curvature = (design * (chance * (1 - chance))[:, None]).T @ design + np.diag(precision)
        step = np.linalg.solve(curvature, design.T @ (found - chance) - precision * answer)
        while (lower := loss(answer + step)) > least and np.abs(step).max() > TOLERANCE:
            step = step / 2
        answer, least = answer + step, lower
        if np.abs(step).max() <= TOLERANCE:
            break
    return answer, np.linalg.inv(curvature)


def _median(values: np.ndarray, otherwise: float) -> float:
    known = values[np.isfinite(values)]
    return _rounded(np.median(known)) if len(known) else otherwise


def _rounded(value: float) -> float:
    """Five significant digits, so that a file does not tell one machine's rounding from another's."""
    return float(f"{value:.5g}")
