"""Metrics of detectors on labelled photographs: pixels, objects, and scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.graphs.detections import Detections
from salframe.graphs.pixels import connected_parts
from salframe.panoramas.geometry import rays_to_pixels
from training.segments.thirteen import CLASSES, STRUCTURE, class_of

ROWS = 256
"""Height of the panorama on which objects are compared."""
MIN_PIXELS = 13
"""Minimum number of pixels of a labelled region that counts as an object: 2e-3 sr, the threshold of the detector."""
OVERLAP = 0.5
"""Minimum intersection over union of a detected object and the labelled region that it matches."""


@dataclass(frozen=True)
class ObjectCounts:
    """Number of detected objects, and number of labelled regions of the photographs, summed over views.

    A labelled region is a connected area of pixels with the same class.

    Attributes:
        detected: Detected objects in labelled areas.
        named: Detected objects whose class is the class of the majority of their labelled pixels.
        true_positives: Detected objects that match a region (OVERLAP).
        regions: Labelled regions.
        covered: Labelled regions whose pixels are mostly covered by detected objects of the same class.
    """

    detected: int
    named: int
    true_positives: int
    regions: int
    covered: int

    def __add__(self, other: ObjectCounts) -> ObjectCounts:
        return ObjectCounts(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))


@dataclass(frozen=True, eq=False)
class Objects:
    """Detected objects on the labels of a view.

    Attributes:
        score: (N,) scores.
        named: (N,) bool, whether the class is the class of the majority of the labelled pixels.
        label: (N,) class ids.
        masks: (N, P) bool, the pixels of each object among the P labelled pixels.
    """

    score: np.ndarray
    named: np.ndarray
    label: np.ndarray
    masks: np.ndarray


def confusion(truth: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """Return the (14, 14) int number of pixels by labelled class (rows, without class 0) and by detected class."""
    counts = np.zeros((len(CLASSES), len(CLASSES)), int)
    np.add.at(counts, (truth.ravel(), answer.ravel()), 1)
    counts[0] = 0
    return counts


def accuracy(counts: np.ndarray) -> float:
    """Return the share of the labelled pixels with the correct class."""
    return float(np.trace(counts) / counts.sum())


def mean_iou(counts: np.ndarray) -> float:
    """Return the mean intersection over union of the labelled classes."""
    right = np.diag(counts)[1:]
    union = counts.sum(0)[1:] + counts.sum(1)[1:] - right
    labelled = counts.sum(1)[1:] > 0
    return float((right[labelled] / union[labelled]).mean())


def one_structure(counts: np.ndarray) -> np.ndarray:
    """Return the counts with wall, floor and ceiling merged, for detectors that do not distinguish them."""
    merged = counts.copy()
    first, *others = (CLASSES.index(name) for name in STRUCTURE)
    for other in others:
        merged[first] += merged[other]
        merged[other] = 0
    for other in others:
        merged[:, first] += merged[:, other]
        merged[:, other] = 0
    return merged


def lay_objects(detections: Detections, labels: np.ndarray) -> Objects:
    """Project the points of each detection to the image of the labels of the same panorama.

    `labels` is this image, (ROWS, 2 ROWS); 0 means unlabelled.

    Detections with a structure class, or with at most half of their pixels labelled, are ignored.
    """
    labelled = np.flatnonzero(labels)
    classes, masks, rows = [], [], []
    for i, points in enumerate(detections.points_m or ()):
        column, row = rays_to_pixels(points, ROWS)
        inside = np.zeros(labels.shape, bool)
        inside[np.minimum(row.astype(int), ROWS - 1), column.astype(int) % (2 * ROWS)] = True
        name = class_of(detections.labels[i])
        if name not in STRUCTURE and 2 * inside.flat[labelled].sum() > inside.sum():
            classes.append(CLASSES.index(name))
            masks.append(inside.flat[labelled])
            rows.append(i)
    label, mask = np.array(classes, int), np.array(masks, bool).reshape(len(rows), len(labelled))
    right = mask & (labels.flat[labelled] == label[:, None])
    return Objects(detections.scores[rows], 2 * right.sum(1) > mask.sum(1), label, mask)


def regions_of(labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the objects in an image of class ids (ROWS, 2 ROWS): connected pixels of one class that is not structure.

    Returns:
        For M objects: the class ids (M,), and masks (M, P) bool over the P labelled pixels of the image.
    """
    labelled = np.flatnonzero(labels)
    classes = labels.ravel()
    part = connected_parts(labels > 0, lambda first, second: classes[first] == classes[second])
    first = np.unique(part, return_index=True)[1]
    label = classes[labelled][first].astype(int)
    masks = part == np.arange(len(first))[:, None]
    selected = (masks.sum(1) >= MIN_PIXELS) & ~np.isin(label, [CLASSES.index(name) for name in STRUCTURE])
    return label[selected], masks[selected]


def count(objects: Objects, regions: tuple[np.ndarray, np.ndarray], min_score: float) -> ObjectCounts:
    """Count the detected objects with at least this score, the correct ones among them, and the labelled regions that
    they match or cover."""
    from scipy.optimize import linear_sum_assignment

    chosen = objects.score >= min_score
    masks, label = objects.masks[chosen].astype(np.float32), objects.label[chosen]
    region_label, region_masks = regions
    common = masks @ region_masks.T.astype(np.float32)
    union = masks.sum(1)[:, None] + region_masks.sum(1) - common
    same = label[:, None] == region_label
    matched = same & (common > OVERLAP * union)
    covered = sum(
        2 * (masks[label == class_id] > 0).any(0)[part].sum() > part.sum()
        for class_id, part in zip(region_label, region_masks, strict=True)
    )
    return ObjectCounts(
        int(chosen.sum()),
        int(objects.named[chosen].sum()),
        int(matched[linear_sum_assignment(matched, maximize=True)].sum()),
        len(region_label),
        int(covered),
    )
