"""What detectors are measured by on labelled photographs: pixels, objects, and what a score is worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.graphs.detections import Detections
from salframe.graphs.pixels import connected_parts
from salframe.panoramas.geometry import rays_to_pixels
from training.segments.thirteen import CLASSES, STRUCTURE, class_of

ROWS = 256
"""Objects are compared on a panorama of so many rows."""
MIN_PIXELS = 13
"""A part of the labels that covers fewer pixels of it is no object: 2e-3 sr, as for the detector."""
OVERLAP = 0.5
"""An object is found where it and a part of the labels share so much of their union."""


@dataclass(frozen=True)
class Counts:
    """Objects of a detector and of the labels, summed over views. detected: objects it gives in labelled parts; named:
    those most of whose labelled pixels are of their class; found: those that match a part (OVERLAP); parts: of the
    labels; covered: parts most of whose pixels some detected object of their class covers."""

    detected: int
    named: int
    found: int
    parts: int
    covered: int

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))


@dataclass(frozen=True, eq=False)
class Objects:
    """Detected objects on a view's labels: score (N,), named (N,) bool, the class of each, and its pixels (N, P) bool
    among the P labelled pixels."""

    score: np.ndarray
    named: np.ndarray
    label: np.ndarray
    masks: np.ndarray


def confusion(truth: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """(14, 14) int: pixels by labelled class (rows, those of class 0 left out) and by the detector's."""
    counts = np.zeros((len(CLASSES), len(CLASSES)), int)
    np.add.at(counts, (truth.ravel(), answer.ravel()), 1)
    counts[0] = 0
    return counts


def accuracy(counts: np.ndarray) -> float:
    """The share of the labelled pixels whose class is right."""
    return float(np.trace(counts) / counts.sum())


def mean_iou(counts: np.ndarray) -> float:
    """The mean over the labelled classes of intersection over union."""
    right = np.diag(counts)[1:]
    union = counts.sum(0)[1:] + counts.sum(1)[1:] - right
    there = counts.sum(1)[1:] > 0
    return float((right[there] / union[there]).mean())


def one_structure(counts: np.ndarray) -> np.ndarray:
    """The counts with wall, floor and ceiling as one class: for detectors that do not tell them apart."""
    merged = counts.copy()
    first, *others = (CLASSES.index(name) for name in STRUCTURE)
    for other in others:
        merged[first] += merged[other]
        merged[other] = 0
    for other in others:
        merged[:, first] += merged[:, other]
        merged[:, other] = 0
    return merged


def lay_objects(found: Detections, labels: np.ndarray) -> Objects:
    """Detections by their points on the labels (ROWS, 2 ROWS) of a panorama, 0 where there are none.

    Left out are those whose class the labels count to the structure, and those with no more than half of their pixels
    labelled.
    """
    labelled = np.flatnonzero(labels)
    classes, masks, kept = [], [], []
    for i, points in enumerate(found.points_m or ()):
        column, row = rays_to_pixels(points, ROWS)
        inside = np.zeros(labels.shape, bool)
        inside[np.minimum(row.astype(int), ROWS - 1), column.astype(int) % (2 * ROWS)] = True
        name = class_of(found.labels[i])
        if name not in STRUCTURE and 2 * inside.flat[labelled].sum() > inside.sum():
            classes.append(CLASSES.index(name))
            masks.append(inside.flat[labelled])
            kept.append(i)
    label, mask = np.array(classes, int), np.array(masks, bool).reshape(len(kept), len(labelled))
    right = mask & (labels.flat[labelled] == label[:, None])
    return Objects(found.scores[kept], 2 * right.sum(1) > mask.sum(1), label, mask)


def parts_of(labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The objects of the labels (ROWS, 2 ROWS): connected parts of one class, no structure. Their classes (M,) and
    pixels (M, P) bool among the labelled ones."""
    labelled = np.flatnonzero(labels)
    classes = labels.ravel()
    part = connected_parts(labels > 0, lambda first, second: classes[first] == classes[second])
    first = np.unique(part, return_index=True)[1]
    label = classes[labelled][first].astype(int)
    masks = part == np.arange(len(first))[:, None]
    kept = (masks.sum(1) >= MIN_PIXELS) & ~np.isin(label, [CLASSES.index(name) for name in STRUCTURE])
    return label[kept], masks[kept]


def count(objects: Objects, parts: tuple[np.ndarray, np.ndarray], min_score: float) -> Counts:
    """How many objects of at least this score are right, and how many parts of the labels are found."""
    from scipy.optimize import linear_sum_assignment

    chosen = objects.score >= min_score
    masks, label = objects.masks[chosen].astype(np.float32), objects.label[chosen]
    part_label, part_masks = parts
    common = masks @ part_masks.T.astype(np.float32)
    union = masks.sum(1)[:, None] + part_masks.sum(1) - common
    same = label[:, None] == part_label
    matched = same & (common > OVERLAP * union)
    covered = sum(
        2 * (masks[label == own] > 0).any(0)[part].sum() > part.sum()
        for own, part in zip(part_label, part_masks, strict=True)
    )
    return Counts(
        int(chosen.sum()),
        int(objects.named[chosen].sum()),
        int(matched[linear_sum_assignment(matched, maximize=True)].sum()),
        len(part_label),
        int(covered),
    )
