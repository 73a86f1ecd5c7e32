"""One object from what a network draws around it: the best of overlapping boxes in a view, then what several views
show of it."""

from __future__ import annotations

import numpy as np

from salframe_detectors.detection_decoder import Found

AGREEMENT = 0.2
"""Two views show the same object above this intersection over union. Low, because the box that a tilted view draws is
another one on the sphere. Boxes around the objects of three rendered buildings, cut at the views' borders: of 1,995
objects 7 came out twice (24 at 0.45), one pair was mixed."""
INSIDE = 0.3
"""What a view's border left of an object belongs to one that covers more than this share of it. Of those 1,995 objects
70 came out twice without."""
MIN_SHARED = 0.1
"""Two detections agree on no less than this share of the smaller: slivers at the border of two views prove nothing."""
CANDIDATES, MAX_FOUND = 1000, 100
"""Boxes of a view before and after suppression, as many as Detectron2 takes unless told otherwise: a network that
answers more costs no more time."""


def suppress(found: Found, overlap: float) -> Found:
    """Of boxes of one class whose intersection over union exceeds `overlap`, the one with the best score alone; of
    CANDIDATES boxes at most, and MAX_FOUND of these, those that score best."""
    import cv2

    if not len(found.score):
        return found
    found = found.take(_best(found.score, CANDIDATES))
    corner, size = found.box_px[:, :2], found.box_px[:, 2:] - found.box_px[:, :2]
    kept = cv2.dnn.NMSBoxesBatched(
        np.hstack([corner, size]).tolist(), found.score.tolist(), found.label.tolist(), 0.0, overlap
    )
    found = found.take(np.array(kept, int).ravel())
    return found.take(_best(found.score, MAX_FOUND))


def _best(score: np.ndarray, count: int) -> np.ndarray:
    """The positions of the `count` best scores, in their order; of equal ones the first."""
    return np.sort(np.argsort(-score, kind="stable")[:count])


def group(
    footprint: np.ndarray, view: np.ndarray, cut: np.ndarray, seen: np.ndarray, solid_angle_sr: np.ndarray
) -> list[np.ndarray]:
    """Which detections of one class are the same object: arrays of positions, one an object.

    footprint (D, P) bool: the pixels of the sphere that each covers; view (D,) the view that it was found in; cut (D,)
    bool: it reaches that view's border; seen (V, P) bool: the pixels that each view shows; solid_angle_sr (P,). Two
    views show the same object where, in the part of the sphere that both show, the intersection of the detections over
    their union exceeds AGREEMENT: so what one view cuts off is made up by the other. A view shows an object once; the
    pairs that agree most are joined first. What the borders of views leave of an object, too little to agree with the
    others, then joins the larger detection that covers most of it, if it covers more than INSIDE.
    """
    used = footprint.any(0)
    covered, area = footprint[:, used].astype(np.float32), solid_angle_sr[used]
    weighted = (covered * area).astype(np.float32)
    shown = weighted @ seen[view][:, used].T.astype(np.float32)
    common, size = weighted @ covered.T, weighted.sum(1)
    union = shown + shown.T - common
    agreement = common / np.maximum(union, 1e-12)
    agreement[common < MIN_SHARED * np.minimum(size[:, None], size)] = 0
    a, b = np.triu_indices(len(view), 1)
    joinable = agreement[a, b] > AGREEMENT
    a, b = a[joinable], b[joinable]
    group_of = np.arange(len(view))
    for i in np.argsort(-agreement[a, b], kind="stable"):
        mine, other = np.flatnonzero(group_of == group_of[a[i]]), np.flatnonzero(group_of == group_of[b[i]])
        if not np.isin(view[mine], view[other]).any():
            group_of[other] = group_of[a[i]]
    share = common / np.maximum(size[:, None], 1e-12)
    for i in np.argsort(size, kind="stable"):
        own = group_of == group_of[i]
        beside = np.isin(group_of, group_of[np.isin(view, view[own])])
        covers = np.where(~beside & (size > size[i]), share[i], 0)
        if cut[own].all() and covers.max() > INSIDE:
            group_of[own] = group_of[covers.argmax()]
    return [np.flatnonzero(group_of == name) for name in np.unique(group_of)]


def outline(footprint: np.ndarray, view: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(P,) bool: the pixels of an object found in several views: those that more than half of the views which show them
    count to it.

    footprint (D, P), view (D,) and seen (V, P) as in `group`, of one object's detections.
    """
    return 2 * footprint.sum(0) > seen[view].sum(0)
