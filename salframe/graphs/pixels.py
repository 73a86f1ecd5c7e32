"""Connected components of labelled pixels, and removal of stray points, for detectors that segment panoramas."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

MAX_DISTANCE_RATIO = 4.0
"""Maximum distance of a point from the median position of the points of its object, in multiples of the median
distance. Points farther away are strays."""

_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def connected_parts(usable: np.ndarray, alike: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the number of the connected component of each usable pixel of a panorama.

    Each pixel has eight neighbours. The first and the last pixel column of the panorama are neighbours.

    Args:
        usable: (H, W) bool, pixels that can be part of a component.
        alike: Called with two arrays (n,), the flat indices of n pairs of usable neighbours. Returns (n,) bool, whether
            the two pixels of a pair belong to the same component.

    Returns:
        (P,) int, number of the component (from 0) of each of the P usable pixels, in the order of
        np.flatnonzero(usable).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    height, width = usable.shape
    index = np.arange(height * width).reshape(height, width)
    links = []
    for rows, columns in _NEIGHBOURS:
        first, second = index[: height - rows].ravel(), np.roll(index, -columns, 1)[rows:].ravel()
        both = usable.flat[first] & usable.flat[second]
        first, second = first[both], second[both]
        joined = alike(first, second)
        links.append(np.stack([first[joined], second[joined]]))
    pixels = np.flatnonzero(usable)
    first, second = np.searchsorted(pixels, np.concatenate(links, 1))
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(len(pixels),) * 2)
    return connected_components(graph, directed=False)[1]


def without_strays(points_m: np.ndarray) -> np.ndarray:
    """Return the points (n, 3) of an object without stray points. If a mask is too large, some of its points lie on the
    wall behind the object."""
    distance = np.linalg.norm(points_m - np.median(points_m, axis=0), axis=1)
    return points_m[distance <= MAX_DISTANCE_RATIO * max(float(np.median(distance)), 0.05)]
