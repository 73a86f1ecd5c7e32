"""Compare the detections of a panorama with its annotations."""

from __future__ import annotations

from collections import Counter

import numpy as np

from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import common_label

NEAR_M = 0.3
"""Maximum distance between the centroids of a correct detection and an annotated object of its label."""


def joined_labels(detections: Detections) -> dict[str, str]:
    """Return the labels that are synonyms in the shared vocabulary, each with its common name."""
    return {label: name for label in detections.labels if (name := common_label(label)) != label}


def is_right(detections: Detections, truth: Detections) -> np.ndarray:
    """Return the mask (N,) bool of the correct detections.

    Detections are matched one to one with annotated objects of the same label whose centroid lies within NEAR_M, so
    that the number of matches is maximal. Labels are compared as they are, without synonyms.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    right = np.zeros(len(detections), bool)
    for label in set(detections.labels) & set(truth.labels):
        detected, annotated = (np.flatnonzero([name == label for name in side.labels]) for side in (detections, truth))
        # An unknown centroid (NaN) matches no object.
        near = cdist(detections.centroid_m[detected], truth.centroid_m[annotated]) <= NEAR_M
        rows, columns = linear_sum_assignment(near, maximize=True)
        right[detected[rows]] = near[rows, columns]
    return right


def count_right(detections: Detections, truth: Detections) -> Counter[str]:
    """Return the number of correct detections (`is_right`) of each label."""
    return Counter(np.array(detections.labels, dtype=np.str_)[is_right(detections, truth)].tolist())
