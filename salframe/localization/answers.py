"""What localizers answer: ranked places and a pose, and what they match between two panoramas."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import InvalidAnswer
from salframe.panoramas.geometry import is_rigid, pose_yaw

RIGID_TOLERANCE = 1e-3
"""By so much the numbers of a pose may be off a rigid motion."""


@dataclass(frozen=True)
class RankedPlace:
    """One answer of a localizer: the map frame, its place, and a score (larger is better)."""

    frame: str
    place: str
    score: float


class LocalizationStatus(StrEnum):
    """Whether a localizer answered, or why not. `NO_POSE` keeps its places: the place counts, the pose does not."""

    OK = "ok"
    NO_POSE = "no-pose"
    NO_OBJECTS = "no-objects"
    NO_FEATURES = "no-features"
    NO_MATCH = "no-match"
    LOW_SCORE = "low-score"

    @property
    def names_a_place(self) -> bool:
        """Whether the places of such an answer count; every other status is a failure."""
        return self in (LocalizationStatus.OK, LocalizationStatus.NO_POSE)


@dataclass(frozen=True)
class Localization:
    """A localizer's answer: `places` best first, one entry a place; T_world_query (4, 4), a rigid motion, or None;
    covariance as in PoseEstimate, in the map frame's axes; heading_rad, the azimuth of the query's x axis in the world:
    the pose's, or what is known of a query without one.

    Raises InvalidAnswer on a status that is none of LocalizationStatus, on a pose that is no rigid motion, on a heading
    that is not finite, where a status that names a place comes without one, and where OK comes without a pose or
    NO_POSE with one.
    """

    places: tuple[RankedPlace, ...]
    T_world_query: np.ndarray | None
    status: LocalizationStatus
    covariance: np.ndarray | None = None
    heading_rad: float | None = None

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "status", LocalizationStatus(self.status))
        except ValueError:
            known = ", ".join(LocalizationStatus)
            raise InvalidAnswer(f"a localization has the status {self.status!r}, expected one of {known}") from None
        if self.T_world_query is not None and not is_rigid(self.T_world_query, RIGID_TOLERANCE):
            told = " ".join(str(np.asarray(self.T_world_query).tolist()).split())[:200]
            raise InvalidAnswer(f"a localization has the pose {told}, expected a rigid motion (4, 4) or None")
        if self.status.names_a_place and not self.places:
            raise InvalidAnswer(f"a localization has the status {self.status} and no place, expected a place")
        if self.status.names_a_place and (self.T_world_query is not None) != (self.status is LocalizationStatus.OK):
            there = "no pose" if self.T_world_query is None else "a pose"
            raise InvalidAnswer(
                f"a localization has the status {self.status} and {there}, expected a pose with ok alone"
            )
        if self.T_world_query is not None:
            object.__setattr__(self, "heading_rad", pose_yaw(np.asarray(self.T_world_query)))
        if self.heading_rad is not None and not np.isfinite(self.heading_rad):
            raise InvalidAnswer(f"a localization has the heading {self.heading_rad}, expected radians or None")


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Points that two panoramas show alike: query, reference (M, 3) float64 unit bearings, each in its own panorama
    frame, a row a match."""

    query: np.ndarray
    reference: np.ndarray

    def __post_init__(self) -> None:
        count = len(check_array(self, "query", np.float64, None, 3, error=InvalidAnswer))
        check_array(self, "reference", np.float64, count, 3, error=InvalidAnswer)


@dataclass(frozen=True, eq=False)
class NodeMatches:
    """Objects that two panoramas show alike: pairs (M, 2) int64 of positions in query_m (N, 3) and reference_m (K, 3),
    each used at most once. These are float64, the centroids of all objects, each in its own panorama frame.
    """

    query_m: np.ndarray
    reference_m: np.ndarray
    pairs: np.ndarray

    def __post_init__(self) -> None:
        counts = [
            len(check_array(self, name, np.float64, None, 3, error=InvalidAnswer))
            for name in ("query_m", "reference_m")
        ]
        pairs = check_array(self, "pairs", np.int64, None, 2, error=InvalidAnswer)
        one_to_one = all(len(np.unique(side)) == len(side) for side in pairs.T)
        if len(pairs) and not (pairs.min() >= 0 and (pairs < counts).all() and one_to_one):
            raise InvalidAnswer(
                f"NodeMatches.pairs must use each of {counts[0]} query and {counts[1]} reference nodes at most once"
            )
