"""From classes and votes on pixels to objects: pixels that mean the same thing of the same class."""

from __future__ import annotations

import numpy as np

from salframe.graphs.pixels import connected_parts

MIN_POINTS = 12
"""An object on fewer pixels of the network's panorama is not reported."""
LINK_M = 0.2
"""Neighbouring pixels vote for the same object where their votes differ by less."""
SAME_M = 0.7
"""Parts of a class, cut by what stands before them, are one object where the centres that they vote for are nearer than
this, or than the larger part is long: votes are as far off as an object is large."""


def group_pixels(class_id: np.ndarray, points_m: np.ndarray, centre_m: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Number the objects of a panorama's pixels: (H, W) int32, 0 for none.

    class_id (H, W) int, 0 for structure; points_m (H, W, 3) float, where a pixel's surface is; centre_m (H, W, 3)
    float, the object's centre that it votes for; seen (H, W) bool. Neighbours, the seam's among them, are one part
    where their class is the same and their votes differ by less than LINK_M; parts of a class are one object where
    their mean votes are close.
    """
    usable = seen & (class_id > 0)
    classes, votes = class_id.ravel(), centre_m.reshape(-1, 3)

    def alike(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return (classes[first] == classes[second]) & (np.linalg.norm(votes[first] - votes[second], axis=1) < LINK_M)

    part_of = connected_parts(usable, alike)
    count = np.bincount(part_of)
    pixels = np.flatnonzero(usable)
    owner = _join_parts(classes[pixels], points_m.reshape(-1, 3)[pixels], votes[pixels], part_of, count)
    objects = np.zeros(class_id.shape, np.int32)
    objects.flat[pixels] = owner[part_of]
    return objects


def _join_parts(
    class_id: np.ndarray, points_m: np.ndarray, vote_m: np.ndarray, part_of: np.ndarray, count: np.ndarray
) -> np.ndarray:
    """(P,) int32: the object number of each part, 0 for parts too small to join and too small to stand alone."""
    mean_m = np.stack([np.bincount(part_of, vote_m[:, axis]) for axis in range(3)], 1) / count[:, None]
    own = np.split(np.argsort(part_of, kind="stable"), np.cumsum(count)[:-1])
    object_of = np.zeros(len(count), np.int32)
    leaders: dict[int, list[tuple[int, float]]] = {}
    number = 0
    for part in np.argsort(-count, kind="stable"):
        same = leaders.setdefault(int(class_id[own[part][0]]), [])
        nearness = [float(np.linalg.norm(mean_m[leader] - mean_m[part])) / reach for leader, reach in same]
        if nearness and min(nearness) < 1:
            object_of[part] = object_of[same[int(np.argmin(nearness))][0]]
        elif count[part] >= MIN_POINTS:
            number += 1
            object_of[part] = number
            same.append((part, max(SAME_M, _length_m(points_m[own[part]]))))
    return object_of


def _length_m(points_m: np.ndarray) -> float:
    """The length of a bar whose points (n, 3) lie as far from their mean, whichever way it is turned."""
    return float(np.sqrt(12 * points_m.var(0).sum()))
