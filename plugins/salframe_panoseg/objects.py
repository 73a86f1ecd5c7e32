"""Grouping of pixels to objects by class and by vote. A vote is the object centre that the network predicts for a
pixel."""

from __future__ import annotations

import numpy as np

from salframe.graphs.pixels import connected_parts

MIN_POINTS = 12
"""Minimum number of pixels of an object on the network's panorama."""
LINK_M = 0.2
"""Maximum distance in metres between the votes of neighbouring pixels that belong to the same part of an object."""
SAME_M = 0.7
"""Maximum distance in metres between the mean votes of two parts of one object, which an occluder separates. If the
larger part is longer than this distance, the maximum is its length, because the error of votes grows with the size of
the object."""


def group_pixels(class_id: np.ndarray, points_m: np.ndarray, centre_m: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Group the pixels of a panorama to objects.

    Neighbouring pixels belong to the same part if their classes are equal and their votes differ by less than LINK_M.
    Pixels of the first and the last column are neighbours too. Parts with the same class are one object if their mean
    votes are close (SAME_M).

    Args:
        class_id: Class (H, W) int of each pixel, 0 for structure.
        points_m: Points (H, W, 3) of the pixels in metres.
        centre_m: Object centre (H, W, 3) in metres that each pixel votes for.
        valid: Mask (H, W) bool of the pixels to group.

    Returns:
        Object number (H, W) int32 of each pixel, 0 for none.
    """
    usable = valid & (class_id > 0)
    classes, votes = class_id.ravel(), centre_m.reshape(-1, 3)

    def same_object(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return (classes[first] == classes[second]) & (np.linalg.norm(votes[first] - votes[second], axis=1) < LINK_M)

    part_of = connected_parts(usable, same_object)
    count = np.bincount(part_of)
    pixels = np.flatnonzero(usable)
    owner = _join_parts(classes[pixels], points_m.reshape(-1, 3)[pixels], votes[pixels], part_of, count)
    objects = np.zeros(class_id.shape, np.int32)
    objects.flat[pixels] = owner[part_of]
    return objects


def _join_parts(
    class_id: np.ndarray, points_m: np.ndarray, vote_m: np.ndarray, part_of: np.ndarray, count: np.ndarray
) -> np.ndarray:
    """Return the object number (P,) int32 of each part; 0 for a small part that belongs to no object."""
    mean_m = np.stack([np.bincount(part_of, vote_m[:, axis]) for axis in range(3)], 1) / count[:, None]
    members = np.split(np.argsort(part_of, kind="stable"), np.cumsum(count)[:-1])
    object_of = np.zeros(len(count), np.int32)
    leaders: dict[int, list[tuple[int, float]]] = {}
    number = 0
    for part in np.argsort(-count, kind="stable"):
        same = leaders.setdefault(int(class_id[members[part][0]]), [])
        nearness = [float(np.linalg.norm(mean_m[leader] - mean_m[part])) / reach for leader, reach in same]
        if nearness and min(nearness) < 1:
            object_of[part] = object_of[same[int(np.argmin(nearness))][0]]
        elif count[part] >= MIN_POINTS:
            number += 1
            object_of[part] = number
            same.append((part, max(SAME_M, _length_m(points_m[members[part]]))))
    return object_of


def _length_m(points_m: np.ndarray) -> float:
    """Return the length of points (n, 3): the length of a thin uniform bar with the same total variance."""
    return float(np.sqrt(12 * points_m.var(0).sum()))
