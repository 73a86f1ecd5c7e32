"""From labelled pixels to parts: what detectors that segment panoramas share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

STRAY = 4.0
"""A point this many times farther from an object's median than half of its points are is a stray."""

_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def connected_parts(usable: np.ndarray, alike: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """(P,) int: the part, from 0, of each of the P usable pixels of a panorama (H, W) bool, in the order of
    np.flatnonzero(usable).

    Neighbours, diagonal ones and those across the seam among them, are of one part where `alike`, called with the flat
    indices (n,) of n pairs of usable neighbours, says so.
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
    """The points (n, 3) of an object that lie with the others: mask borders spill onto the wall behind."""
    distance = np.linalg.norm(points_m - np.median(points_m, axis=0), axis=1)
    return points_m[distance <= STRAY * max(float(np.median(distance)), 0.05)]
