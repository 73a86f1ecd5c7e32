"""The localizer `sovs`: salient objects with volume, distance and direction, without a graph."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import unknown_labels, with_object_labels, written_labels
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches
from salframe.localization.localizer import Description
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.panorama import Panorama
from salframe_objects.salient import SalientObjects


class SalientVolumesLocalizer(SalientObjects):
    """Matches salient objects one-to-one by label, saliency, direction and range. It gives a place and no pose.

    The method follows the description of SOVS by Meena et al. (2024), who use this abbreviation for their method. They
    give no formula. The formulas below are ours. An object a of the query and an object b of the reference frame with
    the same label contribute

        s_ab(t) = min(w_a, w_b) * max(cos phi_ab(t), 0) * min(r_a, r_b) / max(r_a, r_b)

    - w = S^p: weight of an object, from its saliency S and p = `saliency_power`
    - r: range of an object
    - t: rotation of the query about the vertical
    - phi_ab(t): angle between the direction of b and the rotated direction of a

    The score is M / (W - M). M is the maximum of the sum of s_ab(t) over all one-to-one matchings and all rotations t.
    W is the sum of w over all objects of both panoramas. Only rotations that align two objects with the same label are
    tested. Objects with unknown range are ignored.
    """

    name = "sovs"
    version = "4"

    def describe_objects(self, detections: Detections, panorama: Panorama) -> Description:
        objects = with_object_labels(detections.take(np.flatnonzero(np.isfinite(detections.centroid_m).all(1))))
        labels = np.array(objects.labels, dtype=np.str_)
        weight = self.weigh_objects(objects)
        return {"labels": labels, "weight": weight, "centroid_m": objects.centroid_m, **written_labels(detections)}

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self._frames, self._places = list(frames), list(descriptions)
        self._labels = {str(label) for description in descriptions for label in description["labels"]}

    def match(self, description: Description) -> Localization:
        if not len(description["labels"]):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        score = np.array([compare_places(description, place) for place in self._places])
        places = rank_places(self._frames, np.where(score > 0, score, -np.inf))
        return Localization(places, None, LocalizationStatus.NO_POSE if places else LocalizationStatus.NO_MATCH)

    def unknown_labels(self, description: Description) -> tuple[str, ...]:
        return unknown_labels(description, self._labels)

    def correspond(self, query: Description, reference: Description) -> NodeMatches:
        """Return the one-to-one matching behind the score, without pairs that contribute 0."""
        return NodeMatches(query["centroid_m"], reference["centroid_m"], align_places(query, reference)[1])

    def count_objects(self, description: Description) -> int:
        return len(description["labels"])


def compare_places(query: Description, place: Description) -> float:
    """Return the score of two descriptions, from 0 to 1."""
    shared, _ = align_places(query, place)
    return shared / (query["weight"].sum() + place["weight"].sum() - shared) if shared else 0.0


def align_places(query: Description, place: Description) -> tuple[float, np.ndarray]:
    """Return the shared weight M of two descriptions (see `sovs`), and the pairs (P, 2) int64 of matched objects."""
    from scipy.optimize import linear_sum_assignment

    same = query["labels"][:, None] == place["labels"][None]
    if not same.any():
        return 0.0, np.zeros((0, 2), np.int64)
    azimuth_q, lean_q, up_q, range_q = _directions(query["centroid_m"])
    azimuth_p, lean_p, up_p, range_p = _directions(place["centroid_m"])
    turn_rad = (azimuth_p[None] - azimuth_q[:, None])[same]
    # Cosine of the angle between two directions, from their horizontal and vertical components.
    apart_rad = azimuth_q[:, None] + turn_rad[:, None, None] - azimuth_p
    cosine = lean_q[:, None] * lean_p * np.cos(apart_rad) + up_q[:, None] * up_p
    ratio = np.minimum(range_q[:, None], range_p) / np.maximum(range_q[:, None], range_p)
    shared = same * np.minimum(query["weight"][:, None], place["weight"]) * ratio * np.maximum(cosine, 0)
    # Upper bound of any matching. Rotations are tried from the largest bound on, until no better one is possible.
    bound = np.minimum(shared.max(2).sum(1), shared.max(1).sum(1))
    best, pairs = 0.0, np.zeros((0, 2), np.int64)
    for turn in np.argsort(-bound, kind="stable"):
        if bound[turn] <= best:
            break
        chosen = np.stack(linear_sum_assignment(shared[turn], maximize=True), 1)
        value = shared[turn][chosen[:, 0], chosen[:, 1]]
        if value.sum() > best:
            best, pairs = float(value.sum()), chosen[value > 0]
    return best, pairs


def _directions(centroid_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return azimuth, horizontal and vertical part of the unit vectors to the centroids, and range in m, each (N,)."""
    flat_m, range_m = np.hypot(centroid_m[:, 0], centroid_m[:, 1]), np.linalg.norm(centroid_m, axis=1)
    return np.arctan2(centroid_m[:, 1], centroid_m[:, 0]), flat_m / range_m, centroid_m[:, 2] / range_m, range_m
