"""Answers of localizers: ranked places with a pose, and matches between two panoramas."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from itertools import repeat
from typing import NamedTuple

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import InvalidAnswer
from salframe.localization.next_view import NextView
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.geometry import is_rigid, moved_covariance, pose_yaw, translation

RIGID_TOLERANCE = 1e-3
"""Tolerance of the check that a pose is a rigid motion."""
SUM_TOLERANCE = 1e-6
"""Maximum deviation of the sum of all probabilities from 1."""
MAX_OUT_OF_MAP_PROBABILITY = 0.5
"""Maximum out-of-map probability of an accepted answer: the query is more probably in the map than outside."""


class RankedPlace(NamedTuple):
    """A candidate place of an answer. A named tuple: `_replace` returns a changed copy.

    Attributes:
        frame: Id of the best reference frame of the place.
        place: Name of the place.
        score: Score; larger is better.
        probability: Probability that the query is in this place; None from a localizer without probabilities.
    """

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
    """Return ranked places from one sequence per attribute. This is faster than a constructor call for each place."""
    return tuple(map(_new_place, zip(frames, places, scores, probabilities, strict=False)))


class LocalizationStatus(StrEnum):
    """Status of a localization.

    `OK`: the answer has places and a pose. `NO_POSE`: the answer has places, but no pose. `OUT_OF_MAP`: the answer has
    places, but the query is probably in none of them. The other values are reasons why there is no place. `NO_OBJECTS`
    and `NO_FEATURES`: the query shows none. `NO_MATCH`: nothing in the map matches the query. `LOW_SCORE`: the best
    score is below the minimum of the method.
    """

    OK = "ok"
    NO_POSE = "no-pose"
    NO_OBJECTS = "no-objects"
    NO_FEATURES = "no-features"
    NO_MATCH = "no-match"
    LOW_SCORE = "low-score"
    OUT_OF_MAP = "out-of-map"

    @property
    def names_a_place(self) -> bool:
        """Whether an answer with this status names a place; every other status is a failure."""
        return self in (LocalizationStatus.OK, LocalizationStatus.NO_POSE)

    @property
    def is_rejection(self) -> bool:
        """Whether an answer with this status states that the query is out-of-map: the query was rejected, or nothing in
        the map is similar to it.

        Such an answer is correct for an out-of-map query. If a query has no objects or features, its status does not
        state whether it is in the map.
        """
        return self in (LocalizationStatus.OUT_OF_MAP, LocalizationStatus.NO_MATCH, LocalizationStatus.LOW_SCORE)


@dataclass(frozen=True)
class Localization:
    """The answer of a localizer.

    Attributes:
        places: Candidate places, best first, one entry for each place.
        T_world_query: (4, 4) pose of the query, a rigid motion; None if it is unknown.
        status: Result of the localization.
        covariance: Covariance of the pose as in PoseEstimate, in the axes of the world; None if it is unknown.
        heading_rad: Azimuth of the x axis of the query in the world. If there is a pose, it is set to the heading of
            the pose. None if it is unknown.
        out_of_map_probability: Probability that the query is in none of the places. This probability and the
            probabilities of the places sum to 1. None from a localizer without probabilities.
        max_accepted_probability: Maximum out-of-map probability of an accepted answer.
        notes: Remarks for the user, such as labels of the query that the map does not know.
        next_view: Suggested turn of the camera on the spot, to the middle of the largest azimuth sector that the query
            does not show, and the views to take during this turn. None if the query shows all directions, if views were
            fused, or if the method does not compute which directions a query shows. `LocalizationMap` sets it.
        evidence: Values of the evidence for the first place, by the name of the column. The posterior uses them. A
            column is missing if the query or the map lacks its data, such as range. Empty from a method without
            evidence.
        floors: Floors of the map, for the plan that notebooks show.

    Raises:
        InvalidAnswer: In any of these cases: the status is not a LocalizationStatus; the status is OK or NO_POSE and
            there is no place; the status is OK and there is no pose; the status is NO_POSE or OUT_OF_MAP and there is a
            pose; the pose is not a rigid motion; the heading is not finite; a score is NaN; some probabilities are
            missing, are outside [0, 1], or do not sum to 1.
    """

    places: tuple[RankedPlace, ...]
    T_world_query: np.ndarray | None
    status: LocalizationStatus
    covariance: np.ndarray | None = None
    heading_rad: float | None = None
    out_of_map_probability: float | None = None
    notes: tuple[str, ...] = ()
    max_accepted_probability: float = MAX_OUT_OF_MAP_PROBABILITY
    next_view: NextView | None = field(default=None, compare=False, repr=False)
    evidence: Mapping[str, float] = field(default_factory=dict, compare=False, repr=False)
    floors: tuple[FloorMasks, ...] = field(default=(), repr=False, compare=False)

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "status", LocalizationStatus(self.status))
        except ValueError:
            statuses = ", ".join(LocalizationStatus)
            raise InvalidAnswer(f"a localization has the status {self.status!r}, expected one of {statuses}") from None
        if self.T_world_query is not None and not is_rigid(self.T_world_query, RIGID_TOLERANCE):
            received = " ".join(str(np.asarray(self.T_world_query).tolist()).split())[:200]
            raise InvalidAnswer(f"T_world_query of an answer is {received}, expected a rigid motion (4, 4) or None")
        if self.status.names_a_place and not self.places:
            raise InvalidAnswer(f"a localization has the status {self.status} and no place, expected a place")
        if self.status.names_a_place and (self.T_world_query is not None) != (self.status is LocalizationStatus.OK):
            received, expected = ("no pose", "a pose") if self.T_world_query is None else ("a pose", "no pose")
            raise InvalidAnswer(f"a localization has the status {self.status} and {received}, expected {expected}")
        if self.status is LocalizationStatus.OUT_OF_MAP and self.T_world_query is not None:
            raise InvalidAnswer(f"a localization has the status {self.status} and a pose, expected no pose")
        undefined = [place.place for place in self.places if place.score != place.score]
        if undefined:
            raise InvalidAnswer(f"a localization has the score NaN for the place {undefined[0]!r}, expected a number")
        self._check_probabilities()
        if self.T_world_query is not None:
            object.__setattr__(self, "heading_rad", pose_yaw(np.asarray(self.T_world_query)))
        if self.heading_rad is not None and not np.isfinite(self.heading_rad):
            raise InvalidAnswer(f"a localization has the heading {self.heading_rad}, expected finite radians or None")

    @property
    def accepted(self) -> bool | None:
        """Whether a program should use the first place and, if there is one, the pose.

        True if the status names a place, and the out-of-map probability is at most `max_accepted_probability`. None if
        the answer has a place, but the localizer computes no probabilities.
        """
        if not self.status.names_a_place:
            return False
        if self.out_of_map_probability is None:
            return None
        return self.out_of_map_probability <= self.max_accepted_probability

    @property
    def summary(self) -> str:
        """The status and, if the place is not accepted, the reason, in one line."""
        if self.accepted is not False or not self.status.names_a_place:
            return str(self.status)
        probability = self.out_of_map_probability or 0.0
        certainty = "is probably" if probability > MAX_OUT_OF_MAP_PROBABILITY else "may be"
        return (
            f"not accepted, because the query {certainty} out-of-map (probability {probability:.1%}, "
            f"accepted up to {100 * self.max_accepted_probability:.3g}%)"
        )

    def _repr_html_(self) -> str:
        """Return the answer for notebooks: status, places with probabilities, pose, and a plan of the pose's floor."""
        from salframe.localization.answer_html import localization_html

        return localization_html(
            self.summary,
            self.places,
            self.out_of_map_probability,
            self.T_world_query,
            self.covariance,
            self.notes,
            self.floors,
        )

    def moved(self, position_m: np.ndarray) -> Localization:
        """Return the answer with the pose of another frame on the same body, such as the base of a robot.

        The axes of the other frame are parallel to the axes of the query.

        Args:
            position_m: (3,) position of the query in the other frame, in metres, such as the position of the camera on
                the robot.
        """
        if self.T_world_query is None or not np.any(position_m):
            return self
        T_world_query = np.asarray(self.T_world_query)
        covariance = self.covariance
        if covariance is not None:
            covariance = moved_covariance(covariance, -T_world_query[:3, :3] @ position_m)
        return replace(self, T_world_query=T_world_query @ translation(-position_m), covariance=covariance)

    def _check_probabilities(self) -> None:
        """Raise InvalidAnswer if only some probabilities are None, if one is outside [0, 1], or if their sum is not
        1."""
        entries = [*[place.probability for place in self.places], self.out_of_map_probability]
        probabilities = [probability for probability in entries if probability is not None]
        if not probabilities:
            return
        if len(probabilities) < len(entries):
            raise InvalidAnswer(
                f"a localization has {len(probabilities)} of {len(entries)} probabilities, expected all or none: "
                f"`out_of_map_probability`, and one probability for each of the {len(self.places)} places"
            )
        outside = [probability for probability in probabilities if not 0 <= probability <= 1]
        if outside:
            raise InvalidAnswer(f"a localization has the probability {outside[0]}, expected a value in [0, 1]")
        if abs(sum(probabilities) - 1) > SUM_TOLERANCE:
            raise InvalidAnswer(f"a localization has probabilities that sum to {sum(probabilities):.9g}, expected 1")


@dataclass(frozen=True, eq=False)
class PointMatches:
    """M matched points of two panoramas.

    Attributes:
        query: (M, 3) float64 unit bearings in the frame of the query.
        reference: (M, 3) float64 unit bearings in the frame of the reference panorama.
    """

    query: np.ndarray
    reference: np.ndarray

    def __post_init__(self) -> None:
        count = len(check_array(self, "query", np.float64, None, 3, error=InvalidAnswer))
        check_array(self, "reference", np.float64, count, 3, error=InvalidAnswer)


@dataclass(frozen=True, eq=False)
class NodeMatches:
    """M matched objects of two panoramas.

    Attributes:
        query_m: (N, 3) float64 centroids of all objects in the frame of the query.
        reference_m: (K, 3) float64 centroids of all objects in the frame of the reference panorama.
        pairs: (M, 2) int64, row of `query_m` and row of `reference_m` of each match. Each row is used at most once.
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
                "NodeMatches.pairs has an index that is repeated or out of range, expected each of "
                f"{counts[0]} query and {counts[1]} reference objects at most once"
            )
