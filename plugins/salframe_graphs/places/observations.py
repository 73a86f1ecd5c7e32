"""Base class of the objects of a query: their log odds in the likelihood of a place, and their residuals in the fit of
a pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.poses import RelativeObjects
from salframe_graphs.places.rates import Rates

MIN_SCORE = 1e-3
"""Lower bound of a detector's score, which keeps its logarithm finite."""
MAX_LOG_RATIO = 50.0
"""Bound of a log ratio, which keeps exponentials finite."""


@dataclass(frozen=True, eq=False)
class PairPoints:
    """Positions of query objects in P pairs of a query object and a map object, if both are the same object.

    Attributes:
        position: (P,) complex128, x + iy in the query frame, metres.
        ray: (P,) complex128, horizontal directions from the camera, of length 1.
        along_m2: (P,) variance of the position along the ray.
        across_m2: (P,) variance of the position across the ray.
        value: (P,) log ratio of the observations that do not depend on the pose.
        has_scale: (P,) bool, whether the position changes with the scale of the query's ranges.
    """

    position: np.ndarray
    ray: np.ndarray
    along_m2: np.ndarray
    across_m2: np.ndarray
    value: np.ndarray
    has_scale: np.ndarray

    @classmethod
    def concatenate(cls, parts: Sequence[PairPoints]) -> PairPoints:
        """Return the pairs of all parts, one part after the other."""
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def take(self, rows: np.ndarray) -> PairPoints:
        """Return the pairs with the indices `rows`."""
        return PairPoints(*(getattr(self, name)[rows] for name in PairPoints.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Two residuals of each of P pairs of a query and a map object.

    Attributes:
        deviation: (2, P) residuals.
        slope: (5, 2, P) derivatives of the residuals with respect to x, y and yaw of the pose, the height of the
            camera, and the scale of the ranges.
        weight: (2, P) inverse variances, times a factor in (0, 1] that limits the influence of large residuals.
    """

    deviation: np.ndarray
    slope: np.ndarray
    weight: np.ndarray


class ObservedObjects(ABC):
    """n objects of a query, compared with the M objects of an index.

    Attributes:
        same_label: (n, M) bool, whether query object and map object have the same label.
        log_ratio: (n, M) float32, log likelihood ratio of the properties that do not depend on the pose, such as the
            label.
    """

    same_label: np.ndarray
    log_ratio: np.ndarray

    @abstractmethod
    def log_odds(self, relative: RelativeObjects) -> np.ndarray:
        """Return the log odds (n, T) float32 that a query object is a map object and not clutter.

        The odds assume that the T map objects are certain to be detected.
        """

    @abstractmethod
    def pair_log_odds(self, i: np.ndarray, relative: RelativeObjects) -> np.ndarray:
        """Return the log odds (T,) of T pairs, computed as in `log_odds`. Pair t consists of the query object i[t] and
        the map object t."""

    @abstractmethod
    def pair_points(self, i: np.ndarray, j: np.ndarray, camera_height_offset_m: float) -> PairPoints:
        """Return the positions of query objects i (P,) under the assumption that they are the map objects j (P,).

        The camera is `camera_height_offset_m` metres above its expected height.
        """

    @abstractmethod
    def residuals(self, i: np.ndarray, relative: RelativeObjects) -> Residuals:
        """Return the residuals of T pairs of query object i[t] and map object t."""


def label_ratio(label: np.ndarray, same_label: np.ndarray, index: PlaceIndex, rates: Rates) -> np.ndarray:
    """Return the log likelihood ratios (n, M) of the labels of n query objects and M map objects.

    The ratio compares two cases: the query object is this map object, or it is clutter.
    """
    same = np.log(rates.label_agreement / index.frequency[label])[:, None]
    return np.where(same_label, same, np.log(1 - rates.label_agreement))


def pose_slopes(relative: RelativeObjects) -> np.ndarray:
    """Return the derivatives (3, T) complex128 of the offsets with respect to x, y and yaw of the pose."""
    turn = np.exp(-1j * relative.yaw_rad)
    return np.array([-turn, -1j * turn, -1j * relative.offset])
