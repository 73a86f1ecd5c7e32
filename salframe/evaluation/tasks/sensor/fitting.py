"""Fit a sensor model to the detections and the annotations of the same panoramas."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from salframe.evaluation.tasks.detection.judging import NEAR_M
from salframe.graphs.detections import Detections
from salframe.graphs.sensor import DetectionModel, Errors, FalseObjects, Provenance, SensorModel, quantiles
from salframe.graphs.visibility import ObjectVisibility
from salframe.graphs.vocabulary import common_label

REACH_SHARE, OTHER_REACH_SHARE = 0.5, 0.25
"""Maximum distance between a detection and its object, relative to the longest side of the object: for detections with
the label of the object, and for other detections. The maximum distance is at least NEAR_M."""
ROUNDS, TOLERANCE = 200, 1e-6
WEAK_PRECISION = 1e-3
"""Precision (inverse variance) of the prior of the coefficients that all label groups share, in `fit_detection`. It
keeps slopes finite if all objects were detected, or none."""
FLOOR_VARIANCE = 1e-4
"""Minimum variance of the prior of the offsets of label groups, in `fit_detection`."""


@dataclass(frozen=True, eq=False)
class SensorSample:
    """One panorama: the annotated objects (`truth`), their visibility, and the detections."""

    truth: Detections
    visibility: ObjectVisibility
    detections: Detections


@dataclass(frozen=True, eq=False)
class Observations:
    """N annotated objects of several panoramas, matched with detections. Unknown values are NaN.

    Attributes:
        panoramas: Number of panoramas.
        visibility: Visibility of the objects.
        detected_labels: Label that the detector reported for each object; None if the object was not detected.
        bearing_rad: (M, 2) errors of the bearing of the M detected objects, to the left and up.
        range_log: (M,) errors of the logarithm of the range.
        size_log: (M,) errors of the logarithm of the size.
        height_m: (M,) errors of the height.
        false_labels: Labels of the K false positives.
        false_range_m: (K,) ranges of the false positives.
        false_elevation_rad: (K,) elevations of the false positives.
        false_size_m: (K,) sizes of the false positives.
    """

    panoramas: int
    visibility: ObjectVisibility
    detected_labels: tuple[str | None, ...]
    bearing_rad: np.ndarray
    range_log: np.ndarray
    size_log: np.ndarray
    height_m: np.ndarray
    false_labels: tuple[str, ...]
    false_range_m: np.ndarray
    false_elevation_rad: np.ndarray
    false_size_m: np.ndarray

    @property
    def is_detected(self) -> np.ndarray:
        """(N,) bool: whether each object was detected."""
        return np.array([label is not None for label in self.detected_labels], bool)

    @property
    def right(self) -> np.ndarray:
        """(N,) bool: whether each object was detected with the correct label of the shared vocabulary."""
        return np.array(
            [
                detected is not None and common_label(detected) == common_label(label)
                for detected, label in zip(self.detected_labels, self.visibility.labels, strict=True)
            ],
            bool,
        )


def match_objects(detections: Detections, truth: Detections) -> np.ndarray:
    """Return the index of the detection of each annotated object, (T,) int; -1 if it was not detected.

    The assignment is one to one, with a maximal number of matches and then a minimal total distance. Detections of the
    same label in the shared vocabulary are assigned first. If the range of a detection is unknown, only its distance
    from the object perpendicular to the bearing counts.
    """
    matches = np.full(len(truth), -1)
    if not len(detections) or not len(truth):
        return matches
    distance_m = _distances(detections, truth)
    max_side_m = np.nan_to_num(truth.size_m.max(1))
    group, common = (np.array([common_label(label) for label in side.labels]) for side in (detections, truth))
    same = group[:, None] == common
    for eligible, share in ((same, REACH_SHARE), (~same, OTHER_REACH_SHARE)):
        near = eligible & (distance_m <= np.maximum(NEAR_M, share * max_side_m))
        near &= (matches < 0) & ~np.isin(np.arange(len(detections)), matches)[:, None]
        for detection, obj in zip(*_assign(near, distance_m), strict=True):
            matches[obj] = detection
    return matches


def _assign(near: np.ndarray, distance_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a one-to-one assignment of near pairs: a maximal number, then a minimal total distance."""
    from scipy.optimize import linear_sum_assignment

    max_cost = 1 + np.where(near, distance_m, 0).sum()
    rows, columns = linear_sum_assignment(np.where(near, distance_m - max_cost, 0))
    valid = near[rows, columns]
    return rows[valid], columns[valid]


def _distances(detections: Detections, truth: Detections) -> np.ndarray:
    """Return the distances (F, T) of centroids in metres. If the range of a detection is unknown, its distances are
    perpendicular to the bearing."""
    apart = np.linalg.norm(detections.centroid_m[:, None] - truth.centroid_m, axis=2)
    across = np.arccos(np.clip(detections.bearing @ truth.bearing.T, -1, 1)) * np.linalg.norm(truth.centroid_m, axis=1)
    return np.nan_to_num(np.where(np.isnan(apart), across, apart), nan=np.inf)


def observe(looks: Iterable[SensorSample]) -> Observations:
    """Match the detections of each panorama with its annotations, and collect the results."""
    looks = list(looks)
    detected_labels: list[str | None] = []
    errors, false = [np.zeros((0, 5))], [np.zeros((0, 3))]
    false_labels: list[str] = []
    for look in looks:
        index = match_objects(look.detections, look.truth)
        detected_labels += [None if i < 0 else look.detections.labels[i] for i in index]
        errors.append(_errors(look.detections.take(index[index >= 0]), look.truth.take(np.flatnonzero(index >= 0))))
        extra = look.detections.take(np.setdiff1d(np.arange(len(look.detections)), index))
        false_labels += extra.labels
        range_m = np.linalg.norm(extra.centroid_m, axis=1)
        false.append(np.column_stack([range_m, _elevation(extra), _size(extra)]))
    visibility = [look.visibility for look in looks]
    labels = tuple(label for one in visibility for label in one.labels)
    columns = ("solid_angle_sr", "range_m", "hidden_share")
    together = ObjectVisibility(
        labels, *(np.concatenate([[], *(getattr(one, name) for one in visibility)]) for name in columns)
    )
    error, extras = np.concatenate(errors), np.concatenate(false)
    return Observations(
        panoramas=len(looks),
        visibility=together,
        detected_labels=tuple(detected_labels),
        bearing_rad=error[:, :2],
        range_log=error[:, 2],
        size_log=error[:, 3],
        height_m=error[:, 4],
        false_labels=tuple(false_labels),
        false_range_m=extras[:, 0],
        false_elevation_rad=extras[:, 1],
        false_size_m=extras[:, 2],
    )


def _errors(detections: Detections, truth: Detections) -> np.ndarray:
    """Return errors (M, 5): bearing to the left and up in radians, logarithms of range and size, height in metres."""
    left = np.stack([-truth.bearing[:, 1], truth.bearing[:, 0], np.zeros(len(truth))], 1)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    up = np.cross(truth.bearing, left)
    ahead = (detections.bearing * truth.bearing).sum(1)
    bearing = [np.arctan2((detections.bearing * axis).sum(1), ahead) for axis in (left, up)]
    ranges = [np.linalg.norm(one.centroid_m, axis=1) for one in (detections, truth)]
    height = detections.centroid_m[:, 2] - truth.centroid_m[:, 2]
    return np.column_stack([*bearing, np.log(ranges[0] / ranges[1]), np.log(_size(detections) / _size(truth)), height])


def _elevation(detections: Detections) -> np.ndarray:
    return np.arctan2(detections.bearing[:, 2], np.hypot(detections.bearing[:, 0], detections.bearing[:, 1]))


def _size(detections: Detections) -> np.ndarray:
    """Return the cube roots (N,) of the volumes of the boxes, in metres."""
    return np.cbrt(detections.size_m.prod(1))


def fit_sensor(observations: Observations, provenance: Mapping[str, object]) -> SensorModel:
    """Fit a sensor model (model of the errors of a detector) to observations. `provenance` has the fields of Provenance
    except for the counts."""
    confusion: dict[str, Counter[str]] = {}
    for label, detected in zip(observations.visibility.labels, observations.detected_labels, strict=True):
        if detected is not None:
            confusion.setdefault(label, Counter())[detected] += 1
    false = (observations.false_range_m, observations.false_elevation_rad, observations.false_size_m)
    range_m, elevation_rad, size_m = (quantiles(values[np.isfinite(values)]) for values in false)
    return SensorModel(
        provenance=Provenance(
            **provenance,
            panoramas=observations.panoramas,
            objects=len(observations.detected_labels),
            detected=int(observations.is_detected.sum()),
        ),
        detection=fit_detection(observations.visibility, observations.is_detected),
        confusion={label: dict(sorted(confusion[label].items())) for label in sorted(confusion)},
        false_objects=FalseObjects(
            per_panorama=_rounded(len(observations.false_labels) / max(observations.panoramas, 1)),
            labels=dict(sorted(Counter(observations.false_labels).items())),
            range_m=range_m,
            elevation_rad=elevation_rad,
            size_m=size_m,
        ),
        errors=Errors(
            bearing_rad=robust_deviation(observations.bearing_rad.ravel()),
            range_share=robust_deviation(observations.range_log),
            size_log=robust_deviation(observations.size_log),
            height_m=robust_deviation(observations.height_m),
        ),
    )


def robust_deviation(values: np.ndarray) -> float:
    """Return 1.4826 times the median absolute deviation of the finite values; 0 if there are none."""
    values = values[np.isfinite(values)]
    return _rounded(1.4826 * np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def fit_detection(visibility: ObjectVisibility, is_detected: np.ndarray) -> DetectionModel:
    """Fit the probability of detection by penalized maximum likelihood.

    The model is a logistic regression. Labels are grouped by their general name (`common_label`). Each group has an
    offset with a normal prior. Expectation maximization with Laplace's approximation estimates the variance of the
    prior.

    Args:
        visibility: Visibility of the objects.
        is_detected: (N,) bool: whether each object was detected.
    """
    groups = sorted({common_label(label) for label in visibility.labels})
    group = np.array([groups.index(common_label(label)) for label in visibility.labels], int)
    references = {
        "reference_solid_angle_sr": _median(visibility.solid_angle_sr, 0.01),
        "reference_range_m": _median(visibility.range_m, 3.0),
        "reference_hidden_share": _median(visibility.hidden_share, 0.0),
    }
    flat = DetectionModel(
        intercept=0, per_log_solid_angle=0, per_log_range=0, per_hidden_share=0, offsets={}, offset_deviation=0,
        **references,
    )  # fmt: skip
    terms = flat.terms(len(group), visibility.solid_angle_sr, visibility.range_m, visibility.hidden_share)
    design = np.column_stack([np.ones(len(group)), terms, np.eye(len(groups))[group]])
    weights, variance = np.zeros(design.shape[1]), 1.0
    for _ in range(ROUNDS):
        precision = np.repeat([WEAK_PRECISION, 1 / variance], [4, len(groups)])
        weights, covariance = _maximize(design, is_detected.astype(float), precision, weights)
        spread = float(np.mean(weights[4:] ** 2 + np.diag(covariance)[4:])) if groups else 0.0
        settled, variance = abs(spread - variance) < TOLERANCE * variance, max(spread, FLOOR_VARIANCE)
        if settled:
            break
    intercept, *slopes = map(_rounded, weights[:4])
    names = ("per_log_solid_angle", "per_log_range", "per_hidden_share")
    return DetectionModel(
        intercept=intercept,
        **dict(zip(names, slopes, strict=True)),
        **references,
        offsets=dict(zip(groups, map(_rounded, weights[4:]), strict=True)),
        offset_deviation=_rounded(np.sqrt(variance)),
    )


def _maximize(
    design: np.ndarray, is_detected: np.ndarray, precision: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the maximum a posteriori coefficients under a normal prior of these precisions, and their covariance.

    A Newton step that increases the loss is halved.
    """

    def loss(weights: np.ndarray) -> float:
        logit = design @ weights
        return float(np.logaddexp(0, logit).sum() - is_detected @ logit + precision @ weights**2 / 2)

    coefficients, min_loss = start, loss(start)
    for _ in range(ROUNDS):
        chance = 1 / (1 + np.exp(-(design @ coefficients)))
        curvature = (design * (chance * (1 - chance))[:, None]).T @ design + np.diag(precision)
        step = np.linalg.solve(curvature, design.T @ (is_detected - chance) - precision * coefficients)
        while (new_loss := loss(coefficients + step)) > min_loss and np.abs(step).max() > TOLERANCE:
            step = step / 2
        coefficients, min_loss = coefficients + step, new_loss
        if np.abs(step).max() <= TOLERANCE:
            break
    return coefficients, np.linalg.inv(curvature)


def _median(values: np.ndarray, default: float) -> float:
    finite = values[np.isfinite(values)]
    return _rounded(np.median(finite)) if len(finite) else default


def _rounded(value: float) -> float:
    """Round to five significant digits, so that files do not depend on the rounding of a machine."""
    return float(f"{value:.5g}")
