"""From classes and votes on pixels to objects: pixels that mean the same thing of the same class."""

from __future__ import annotations

import numpy as np

LEAST_POINTS = 12
"""An object on fewer pixels of the network's panorama is not reported."""
LINK_M = 0.2
"""Neighbouring pixels vote for the same object where their votes differ by less."""
SAME_M = 0.7
"""Parts of a class, cut by what stands before them, are one object where the centres that they vote for are nearer than
this, or than the larger part is long: votes are as far off as an object is large."""
STRAY = 4.0
"""A point this many times farther from an object's median than half of its points are is a stray."""


def group_pixels(class_id: np.ndarray, points_m: np.ndarray, centre_m: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Number the objects of a panorama's pixels: (H, W) int32, 0 for none.

    class_id (H, W) int, 0 for structure; points_m (H, W, 3) float, where a pixel's surface is; centre_m (H, W, 3)
    float, the object's centre that it votes for; seen (H, W) bool. Neighbours, the seam's among them, are one part
    where their class is the same and their votes differ by less than LINK_M; parts of a class are one object where
    their mean votes are close.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    height, width = class_id.shape
    usable = seen & (class_id > 0)
    index = np.arange(height * width).reshape(height, width)
    links = []
    for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here, there = index[: height - rows], np.roll(index, -columns, 1)[rows:]
        first, second = here.ravel(), there.ravel()
        joined = usable.flat[first] & usable.flat[second] & (class_id.flat[first] == class_id.flat[second])
        first, second = first[joined], second[joined]
        votes = centre_m.reshape(-1, 3)
        near = np.linalg.norm(votes[first] - votes[second], axis=1) < LINK_M
        links.append(np.stack([first[near], second[near]]))
    first, second = np.concatenate(links, 1)
    graph = coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(height * width,) * 2)
    part = connected_components(graph, directed=False)[1].reshape(height, width)
    pixels = np.flatnonzero(usable)
    _, part_of, count = np.unique(part.flat[pixels], return_inverse=True, return_counts=True)
    owner = _join_parts(
        class_id.flat[pixels], points_m.reshape(-1, 3)[pixels], centre_m.reshape(-1, 3)[pixels], part_of, count
    )
    objects = np.zeros(height * width, np.int32)
    objects[pixels] = owner[part_of]
    return objects.reshape(height, width)


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
        elif count[part] >= LEAST_POINTS:
            number += 1
            object_of[part] = number
            same.append((part, max(SAME_M, _length_m(points_m[own[part]]))))
    return object_of


def _length_m(points_m: np.ndarray) -> float:
    """The length of a bar whose points (n, 3) lie as far from their mean, whichever way it is turned."""
    return float(np.sqrt(12 * points_m.var(0).sum()))


def without_strays(points_m: np.ndarray) -> np.ndarray:
    """The points (n, 3) of an object that lie with the others: mask borders spill onto the wall behind."""
    distance = np.linalg.norm(points_m - np.median(points_m, axis=0), axis=1)
    return points_m[distance <= STRAY * max(float(np.median(distance)), 0.05)]
