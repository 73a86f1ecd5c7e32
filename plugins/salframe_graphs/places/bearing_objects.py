"""Query objects without range: the likelihood of their bearings and solid angles, and their residuals for the fit of a
pose."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from salframe_graphs.places.observations import (
    MAX_LOG_RATIO,
    MIN_SCORE,
    ObservedObjects,
    PairPoints,
    Residuals,
    label_ratio,
    pose_slopes,
)
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.poses import RelativeObjects
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.rates import Likelihood, Rates

MIN_DISTANCE_M = 0.15
"""Lower bound of the distance between camera and map object, because an object is not a point."""
MIN_COSINE = 0.3
"""Minimum cosine of the angle between the bearings of a query object and a map object that may be the same object."""
FREEDOM = 3.0
"""Degrees of freedom of Student's t distribution of the angles."""
MIN_SIZE_RATIO = -6.0
"""Lower bound of the log ratio of the solid angle, because a partly hidden object may appear arbitrarily small."""
RANGES_M = np.geomspace(0.3, 12.0, 16)
"""Ranges (m) at which a query object is placed, to compare its elevation and solid angle with those of a map object."""
RANGE_ERROR_SHARE = 0.05
"""Standard deviation of an estimated range, relative to the range. It is combined with the spread of the ranges that
agree with elevation and solid angle."""
ACROSS_ERROR_M = 0.07
"""Standard deviation (m), across the bearing, of the estimated position of a query object."""
RAISED_ERROR_SHARE = 2 / 3
"""Standard deviation of the camera height in `pair_points`, relative to `camera_height_error_m`. It is below 1 because
hypotheses are made for several heights."""


class BearingObjects(ObservedObjects):
    """Compares n query objects without range with the M objects of an index.

    For a pose of the camera, each map object has an expected bearing, and an expected solid angle that follows from its
    size and its distance. The likelihood compares both with the query object. The angle between the two bearings has a
    horizontal and a vertical component, which have a two-dimensional Student t distribution. The logarithm of the solid
    angle has a normal distribution, with a lower bound (MIN_SIZE_RATIO).
    """

    def __init__(
        self, query: QueryObjects, index: PlaceIndex, rates: Rates, likelihood: Likelihood, map_height_m: np.ndarray
    ) -> None:
        """Compare the labels of query objects and map objects, and store the quantities that all poses share.

        Args:
            query: The n query objects without range.
            index: The places with the M map objects.
            rates: Error rates of the detector.
            likelihood: Constants of the likelihood.
            map_height_m: (M,) expected heights of the map objects above the query's camera.
        """
        self._index, self._map_height_m = index, map_height_m
        self._camera_error_m = likelihood.camera_height_error_m
        self._errors = likelihood.bearings
        self._minus_log_clutter = -float(np.log(rates.clutter))
        x, y, z = self._bearing = query.bearing.T
        level = np.maximum(np.hypot(x, y), 1e-9)
        self._elevation_rad = np.arctan2(z, level)
        zero = np.zeros(len(query))
        self._axes = np.array([[-y / level, x / level, zero], [-z * x / level, -z * y / level, level], [x, y, z]])
        """(3, 3, n) unit vectors of each query object: horizontal tangent, vertical tangent, and bearing."""
        self._origin_m = query.origin_m.T
        self._is_central = not self._origin_m.any()
        with np.errstate(divide="ignore"):
            self._log_solid_angle = np.log(query.solid_angle_sr)
        self.same_label = query.label[:, None] == index.label
        ratio = label_ratio(query.label, self.same_label, index, rates)
        self.log_ratio = (ratio + np.log(np.maximum(query.scores, MIN_SCORE))[:, None]).astype(np.float32)

    @cached_property
    def _map_size(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(M,) each: variance of the position, mean side in metres, and log of the mean projected area in m^2."""
        length, width, height = sides = np.exp(self._index.log_size).T
        # By Cauchy's formula the mean projected area of a convex body is a quarter of its surface.
        log_area = np.log((length * width + width * height + height * length) / 2)
        return self._index.variance_m2, sides.mean(0), log_area

    def _components(self, i: np.ndarray | None, relative: RelativeObjects) -> tuple[np.ndarray, np.ndarray]:
        """Return the components and the lengths of the vectors from the cameras of the query's views to map objects.

        Args:
            i: (T,) the query object of each map object; None: all n query objects with each map object.
            relative: The T map objects.

        Returns:
            (3, n, T) or (3, T) components along the axes of the query objects, and lengths (n or 1, T) or (T,).
        """
        dtype: Any = np.float32 if i is None else np.float64
        vector: np.ndarray = np.array([relative.offset.real, relative.offset.imag, relative.height_m], dtype)
        if i is not None:
            vector = vector - self._origin_m[:, i]
            components = np.einsum("akt,kt->at", self._axes[:, :, i], vector)
            return components, np.sqrt((vector * vector).sum(0))
        axes: np.ndarray = self._axes.transpose(0, 2, 1).astype(dtype)
        components = axes @ vector
        squared = (vector * vector).sum(0)[None]
        if not self._is_central:
            origin: np.ndarray = self._origin_m.astype(dtype)
            components -= np.einsum("ank,kn->an", axes, origin)[..., None]
            squared = squared - 2 * origin.T @ vector + (origin * origin).sum(0)[:, None]
        return components, np.sqrt(np.maximum(squared, 0))

    def _variances(self, objects: np.ndarray, height_m: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
        """Return the variances (2, ...) of the horizontal and the vertical angle, rad^2."""
        errors = self._errors
        variance_m2, side_m, _ = (values[objects].astype(distance_m.dtype) for values in self._map_size)
        inverse = 1 / (distance_m * distance_m)
        upright = height_m.astype(distance_m.dtype)
        horizontal = errors.horizontal_error_m**2 + variance_m2 + (errors.side_error_share * side_m) ** 2
        vertical = errors.vertical_error_m**2 + (errors.side_error_share * side_m * upright) ** 2 * inverse
        return errors.bearing_error_rad**2 + np.array([horizontal * inverse, vertical * inverse])

    def _log_odds(self, i: np.ndarray | None, relative: RelativeObjects) -> np.ndarray:
        errors, objects = self._errors, relative.objects
        components, distance_m = self._components(i, relative)
        distance_m = np.maximum(distance_m, MIN_DISTANCE_M)
        variance = self._variances(objects, relative.height_m, distance_m)
        angle = components[:2] / distance_m
        squared = angle[0] * angle[0] / variance[0] + angle[1] * angle[1] / variance[1]
        log_odds = np.log1p(squared / FREEDOM)
        log_odds *= -(FREEDOM + 2) / 2
        log_odds += np.log(errors.clutter_solid_angle_sr / (2 * np.pi)) + self._minus_log_clutter
        log_odds -= 0.5 * np.log(variance[0] * variance[1])
        log_odds += self.log_ratio.take(objects, 1) if i is None else self.log_ratio[i, objects]
        log_odds += self._size_ratio(i, objects, distance_m)
        log_odds[components[2] < MIN_COSINE * distance_m] = -MAX_LOG_RATIO
        return log_odds  # type: ignore[no-any-return]

    def _size_ratio(self, i: np.ndarray | None, objects: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
        """Return the log ratio of the query objects' solid angles, for map objects at these distances from the camera.
        It is 0 where a solid angle is unknown."""
        errors = self._errors
        observed = self._log_solid_angle.astype(distance_m.dtype)
        observed = observed[:, None] if i is None else observed[i]
        expected = self._map_size[2][objects].astype(distance_m.dtype) - 2 * np.log(distance_m) + errors.size_bias_log
        deviation = (observed - expected) / errors.size_error_log
        at_peak = np.log(errors.size_span_log / (np.sqrt(2 * np.pi) * errors.size_error_log))
        ratio = np.maximum(at_peak - 0.5 * deviation * deviation, MIN_SIZE_RATIO)
        return np.where(np.isfinite(ratio), ratio, 0)

    def log_odds(self, relative: RelativeObjects) -> np.ndarray:
        return self._log_odds(None, relative)

    def pair_log_odds(self, i: np.ndarray, relative: RelativeObjects) -> np.ndarray:
        return self._log_odds(i, relative)

    def pair_points(self, i: np.ndarray, j: np.ndarray, camera_height_offset_m: float) -> PairPoints:
        """Return estimated positions of query objects i (P,), each paired with a map object j (P,).

        The unknown range of a query object is estimated: RANGES_M are weighted by the likelihood of the elevation and
        the solid angle at each range. The estimate is their weighted mean, and its variance is their weighted variance
        plus the variance of RANGE_ERROR_SHARE.

        Args:
            i: Indices of the query objects.
            j: Indices of the map objects.
            camera_height_offset_m: Height of the query's camera relative to its expected height, in metres.
        """
        errors = self._errors
        _, side_m, log_area = (values[j, None] for values in self._map_size)
        sine, cosine = np.sin(self._elevation_rad[i]), np.cos(self._elevation_rad[i])
        height_m = self._map_height_m[j] - camera_height_offset_m - self._origin_m[2, i]
        lift_m2 = (
            (errors.bearing_error_rad * RANGES_M) ** 2
            + errors.vertical_error_m**2
            + (errors.side_error_share * side_m * sine[:, None]) ** 2
            + (RAISED_ERROR_SHARE * self._camera_error_m) ** 2
        )
        log_weight = -0.5 * (height_m[:, None] - RANGES_M * sine[:, None]) ** 2 / lift_m2 - 0.5 * np.log(lift_m2)
        expected = log_area - 2 * np.log(RANGES_M) + errors.size_bias_log
        deviation = (self._log_solid_angle[i, None] - expected) / errors.size_error_log
        log_weight -= 0.5 * np.where(np.isfinite(deviation), deviation * deviation, 0)
        max_log_weight = log_weight.max(1)
        weight = np.exp(log_weight - max_log_weight[:, None])
        total = weight.sum(1)
        mean_m = weight @ RANGES_M / total
        variance_m2 = weight @ RANGES_M**2 / total - mean_m**2 + (RANGE_ERROR_SHARE * mean_m) ** 2
        x, y, _ = self._bearing[:, i]
        position = self._origin_m[0, i] + mean_m * x + 1j * (self._origin_m[1, i] + mean_m * y)
        ray = (x + 1j * y) / np.maximum(cosine, 1e-9)
        across_m2 = np.full(len(i), ACROSS_ERROR_M**2)
        value = self.log_ratio[i, j] + max_log_weight + np.log(total / len(RANGES_M))
        return PairPoints(position, ray, variance_m2 * cosine**2 + across_m2, across_m2, value, np.zeros(len(i), bool))

    def residuals(self, i: np.ndarray, relative: RelativeObjects) -> Residuals:
        """Return the horizontal and vertical angles between the bearings of the query object and the map object of each
        pair."""
        components, distance_m = self._components(i, relative)
        distance_m = np.maximum(distance_m, MIN_DISTANCE_M)
        variance = self._variances(relative.objects, relative.height_m, distance_m)
        deviation = components[:2] / distance_m
        squared = (deviation * deviation / variance).sum(0)
        moved = np.zeros((5, 3, len(i)))
        horizontal = pose_slopes(relative)
        moved[:3, 0], moved[:3, 1], moved[3, 2] = horizontal.real, horizontal.imag, -1
        along_axes = np.einsum("akt,pkt->pat", self._axes[:, :, i], moved)
        lengthened = np.einsum("at,pat->pt", components, along_axes) / distance_m
        slope = (along_axes[:, :2] - deviation * lengthened[:, None]) / distance_m
        return Residuals(deviation, slope, (FREEDOM + 2) / ((FREEDOM + squared) * variance))
