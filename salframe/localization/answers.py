"""What localizers answer: ranked places and a pose, and what they match between two panoramas."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from itertools import repeat
from typing import NamedTuple

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import InvalidAnswer
from salframe.panoramas.geometry import is_rigid, pose_yaw

RIGID_TOLERANCE = 1e-3
"""By so much the numbers of a pose may be off a rigid motion."""
SUM_TOLERANCE = 1e-6
"""By so much probabilities may miss one together."""


class RankedPlace(NamedTuple):
    """One answer of a localizer: the reference frame, its place, a score (larger is better), and the probability that the
    query is in this place, None from a localizer that has none. A named tuple: `_replace` gives another."""

    frame: str
    place: str
    score: float
    probability: float | None = None


_new_place = partial(tuple.__new__, RankedPlace)


def ranked_places(
    frames: Iterable[str],
    places: Iterable[str],
    scores: Iterable[float],
    probabilities: Iterable[float | None] = repeat(None),
) -> tuple[RankedPlace, ...]:
    """Many at once, from what each is made of: in a quarter of the time of one by one."""
    return tuple(map(_new_place, zip(frames, places, scores, probabilities, strict=False)))


class LocalizationStatus(StrEnum):
    """Whether a localizer answered, or why not. `NO_POSE` keeps its places: the place counts, the pose does not.
    `OUT_OF_MAP` keeps them too, and says that the query is in none of them."""

    OK = "ok"
    NO_POSE = "no-pose"
    NO_OBJECTS = "no-objects"
    NO_FEATURES = "no-features"
    NO_MATCH = "no-match"
    LOW_SCORE = "low-score"
    OUT_OF_MAP = "out-of-map"

    @property
    def names_a_place(self) -> bool:
        """Whether the places of such an answer count; every other status is a failure."""
        return self in (LocalizationStatus.OK, LocalizationStatus.NO_POSE)

    @property
    def denies_the_map(self) -> bool:
        """Whether such an answer says that the map does not show the query's place, so that it is right where that is
        so: it was refused, or nothing was like it. A query that shows nothing says nothing of the map."""
        return self in (LocalizationStatus.OUT_OF_MAP, LocalizationStatus.NO_MATCH, LocalizationStatus.LOW_SCORE)


@dataclass(frozen=True)
class Localization:
    """A localizer's answer: `places` best first, one entry a place; T_world_query (4, 4), a rigid motion, or None;
    covariance as in PoseEstimate, in the world's axes; heading_rad, the azimuth of the query's x axis in the world:
    the pose's, or what is known of a query without one; out_of_map_probability, the probability that the query is in none of the
    places, which those of the places and it make one, None from a localizer that has none.

    Raises InvalidAnswer on a status that is none of LocalizationStatus, on a pose that is no rigid motion, on a heading
    that is not finite, where a status that names a place comes without one, where OK comes without a pose or NO_POSE or
    OUT_OF_MAP with one, and on probabilities of which some are missing, outside [0, 1], or that do not sum to one.
    """

    places: tuple[RankedPlace, ...]
    T_world_query: np.ndarray | None
    status: LocalizationStatus
    covariance: np.ndarray | None = None
    heading_rad: float | None = None
    out_of_map_probability: float | None = None

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
        if self.status is LocalizationStatus.OUT_OF_MAP and self.T_world_query is not None:
            raise InvalidAnswer(f"a localization has the status {self.status} and a pose, expected none")
        self._check_probabilities()
        if self.T_world_query is not None:
            object.__setattr__(self, "heading_rad", pose_yaw(np.asarray(self.T_world_query)))
        if self.heading_rad is not None and not np.isfinite(self.heading_rad):
            raise InvalidAnswer(f"a localization has the heading {self.heading_rad}, expected radians or None")

    def _check_probabilities(self) -> None:
        """All are None, or each is in [0, 1] and together they are one."""
        all_of_them = [*[place.probability for place in self.places], self.out_of_map_probability]
        known = [probability for probability in all_of_them if probability is not None]
        if not known:
            return
        if len(known) < len(all_of_them):
            raise InvalidAnswer(
                f"a localization has {len(known)} of {len(all_of_them)} probabilities, "
                "expected one for each place and one for `out_of_map_probability`, or none at all"
            )
        outside = [probability for probability in known if not 0 <= probability <= 1]
        if outside:
            raise InvalidAnswer(f"a localization has the probability {outside[0]}, expected one in [0, 1]")
        if abs(sum(known) - 1) > SUM_TOLERANCE:
            raise InvalidAnswer(f"a localization has probabilities that sum to {sum(known):.9g}, expected 1")


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
