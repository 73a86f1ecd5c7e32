"""Detections of a panorama against its annotations."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import common_label

NEAR_M = 0.3
"""A detection is right where an annotated object of its label has its centroid this near."""


def in_common_words(detections: Detections) -> Detections:
    """The detections with labels of the vocabulary that detectors share."""
    return replace(detections, labels=tuple(map(common_label, detections.labels)))


def joined_labels(detections: Detections) -> dict[str, str]:
    """The common name of each label that is another word for it."""
    return {label: name for label in detections.labels if (name := common_label(label)) != label}


def count_right(found: Detections, truth: Detections) -> Counter[str]:
    """How many detections of each label are right: one to one with annotated objects of the label whose centroid lies
    within NEAR_M, as many as can be.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    right = Counter[str]()
    for label in set(found.labels) & set(truth.labels):
        own, annotated = ([i for i, name in enumerate(side.labels) if name == label] for side in (found, truth))
        # An unknown centroid is near nothing.
        near = cdist(found.centroid_m[own], truth.centroid_m[annotated]) <= NEAR_M
        right[label] = int(near[linear_sum_assignment(near, maximize=True)].sum())
    return right
