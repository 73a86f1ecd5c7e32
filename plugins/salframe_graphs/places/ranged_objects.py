"""Query objects with range: their likelihood, and their residuals for the fit of a pose."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from salframe.panoramas.geometry import as_complex
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


class RangedObjects(ObservedObjects):
    """Compares n query objects with range with the M objects of an index.

    The error of a horizontal position is normally distributed along the ray of the query object and across it. The
    comparison of heights and sizes does not depend on the pose.

    Attributes:
        position: (n,) complex128, positions x + iy in the query frame, metres.
        ray: (n,) complex128, unit vectors to the objects.
        range_m: (n,) horizontal distances.
        along_m2: (n, M) variance, along the ray, of the difference between the positions of a query object and a map
            object.
        across_m2: (M,) variance of this difference across the ray.
    """

    def __init__(
        self, query: QueryObjects, index: PlaceIndex, rates: Rates, likelihood: Likelihood, camera_height_m: float
    ) -> None:
        """Compare query objects and map objects as far as the comparison does not depend on a pose.

        Args:
            query: The n query objects with range.
            index: The places with the M map objects.
            rates: Error rates of the detector.
            likelihood: Constants of the likelihood.
            camera_height_m: Height of the query's camera above the floor; NaN: unknown, assumed equal to the height of
                the map's cameras.
        """
        self._index, self._rates, self._likelihood = index, rates, likelihood
        self.position = as_complex(query.centroid_m)
        self.range_m = np.abs(self.position)
        self.ray = self.position / np.maximum(self.range_m, 1e-9)
        self.same_label = query.label[:, None] == index.label
        self.log_ratio = self._log_ratio(query, index.height_and_size_terms(camera_height_m))
        self.across_m2 = index.variance_m2 + rates.position_error_m**2
        self.along_m2 = self.across_m2 + ((rates.range_error_share * self.range_m) ** 2)[:, None]

    def _log_ratio(self, query: QueryObjects, map_terms: np.ndarray) -> np.ndarray:
        """Return the log ratio of label, height and size, including the detector's score of the query object.

        The score s of a query object is the probability that the object exists. Such an object contributes
        1 + s * ratio to the likelihood. The normal densities of height, log length and log box height are quadratic
        forms of the map object's values, so one matrix product evaluates all of them. The size terms are left out for
        map objects without a known box.
        """
        rates, likelihood = self._rates, self._likelihood
        log_size = np.log(query.size_m)
        height_and_size = np.array([query.centroid_m[:, 2], log_size[:, 0], log_size[:, 2]]).T
        variance = np.empty_like(height_and_size)
        variance[:, 0] = 2 * (rates.height_error_m**2 + (rates.range_error_share * height_and_size[:, 0]) ** 2)
        variance[:, 1:] = 2 * rates.length_error_log**2, 2 * rates.box_height_error_log**2
        span = np.array([likelihood.height_span_m, likelihood.size_span_log, likelihood.size_span_log])
        constants = np.log(span) - 0.5 * (height_and_size**2 / variance + np.log(2 * np.pi * variance))
        constant = constants[:, 0] + np.log(np.maximum(query.scores, MIN_SCORE))
        of_size = constants[:, 1:].sum(1)
        factors = [height_and_size / variance, -0.5 / variance, constant[:, None], of_size[:, None]]
        log_ratio_sum = np.concatenate(factors, 1) @ map_terms
        log_ratio_sum += label_ratio(query.label, self.same_label, self._index, rates)
        return np.maximum(log_ratio_sum, -MAX_LOG_RATIO).astype(np.float32)

    @cached_property
    def peak(self) -> np.ndarray:
        """(n, M) float32: log odds that a query object is a map object, if both have the same position.

        The logit of the probability that the map object is detected is not included.
        """
        at_peak = np.log(self._likelihood.area_m2 / (2 * np.pi)) - 0.5 * np.log(self.along_m2 * self.across_m2)
        return (self.log_ratio + at_peak - np.log(self._rates.clutter)).astype(np.float32)

    @cached_property
    def _exponents(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, M) and (M,) float32: factors of the squared deviation along the query object's ray and across it."""
        return (-0.5 / self.along_m2).astype(np.float32), (-0.5 / self.across_m2).astype(np.float32)

    @cached_property
    def _rays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vectors along and across the rays, (n, 2) each, and ranges (n, 1); float32."""
        x, y = self.ray.real, self.ray.imag
        return np.array([x, y], np.float32).T, np.array([-y, x], np.float32).T, self.range_m.astype(np.float32)[:, None]

    def log_odds(self, relative: RelativeObjects) -> np.ndarray:
        rotated = np.array([relative.offset.real, relative.offset.imag], np.float32)
        ray, normal, range_m = self._rays
        along_m = ray @ rotated
        along_m -= range_m * relative.scale.astype(np.float32)  # the query object lies on its own ray
        across_m = normal @ rotated
        along, across = self._exponents
        log_odds = along_m
        log_odds *= along_m
        log_odds *= along.take(relative.objects, 1)
        across_m *= across_m
        across_m *= across[relative.objects]
        log_odds += across_m
        log_odds += self.peak.take(relative.objects, 1)
        return log_odds  # type: ignore[no-any-return]

    def pair_log_odds(self, i: np.ndarray, relative: RelativeObjects) -> np.ndarray:
        j, (along, across) = relative.objects, self._exponents
        offset = relative.offset * self.ray[i].conj()
        along_m, across_m = offset.real - relative.scale * self.range_m[i], offset.imag
        return along_m * along_m * along[i, j] + across_m * across_m * across[j] + self.peak[i, j]  # type: ignore[no-any-return]

    def pair_points(self, i: np.ndarray, j: np.ndarray, camera_height_offset_m: float) -> PairPoints:
        rates = self._rates
        variance_m2 = rates.position_error_m**2 + (rates.range_error_share * self.range_m[i]) ** 2
        return PairPoints(
            self.position[i], self.ray[i], variance_m2, variance_m2, self.log_ratio[i, j], np.ones(len(i), bool)
        )

    def residuals(self, i: np.ndarray, relative: RelativeObjects) -> Residuals:
        """Return the residuals along and across the rays.

        Errors are assumed to be Cauchy distributed: the visible part of an object changes with the viewpoint, and for a
        few objects its centroid moves far.
        """
        offset = relative.offset * self.ray[i].conj()
        deviation = np.array([offset.real - relative.scale * self.range_m[i], offset.imag])
        slope = np.zeros((5, 2, len(i)))
        horizontal = pose_slopes(relative) * self.ray[i].conj()
        slope[:3, 0], slope[:3, 1] = horizontal.real, horizontal.imag
        slope[4, 0] = -self.range_m[i]
        inverse = 1 / np.array([self.along_m2[i, relative.objects], self.across_m2[relative.objects]])
        squared = (deviation * deviation * inverse).sum(0)
        return Residuals(deviation, slope, inverse / (1 + squared))
