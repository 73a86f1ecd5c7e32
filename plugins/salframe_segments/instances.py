"""Objects from pixel classes. Connected areas of one class are split at range jumps; parts that touch are joined."""

from __future__ import annotations

import numpy as np

from salframe.graphs.pixels import connected_parts

JUMP = 0.2
"""Minimum difference in range between neighbouring pixels of different parts, relative to the smaller range. At 0.7
deg per pixel, a table top half a metre below the camera reaches this difference at a distance of 4 m."""
SPILL = 0.1
"""Minimum size of a part, relative to the largest part in the same connected area of one class. Smaller parts are
wrongly labelled pixels of the surface behind the object."""
MIN_SR = 2e-3
"""Minimum solid angle of a part: a square of 2.6 deg."""
TOUCH_M = 0.15
"""Maximum distance in metres between the nearest points of two parts that are joined to one object."""


def find_instances(
    class_id: np.ndarray, objects: np.ndarray, whole: np.ndarray, points_m: np.ndarray | None, area_sr: np.ndarray
) -> list[np.ndarray]:
    """Find the objects on a panorama's pixels.

    Args:
        class_id: Class (H, W) int of each pixel.
        objects: (C,) bool, whether the pixels of each class are objects.
        whole: (C,) bool, whether objects of each class are never split at range jumps. Examples are open doors, and
            windows that show surfaces behind them.
        points_m: Points (H, W, 3) of the pixels in metres, NaN where unknown; None: parts are neither split nor joined.
        area_sr: Solid angle (H, W) of the pixels.

    Returns:
        Flat pixel indices (n,) of each object, ascending.
    """
    usable, classes = objects[class_id], class_id.ravel()
    pixels = np.flatnonzero(usable)
    if not len(pixels):
        return []
    range_m = np.zeros(class_id.size) if points_m is None else np.linalg.norm(points_m, axis=-1).ravel()

    def same_class(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return classes[first] == classes[second]

    def level(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        near, far = np.minimum(range_m[first], range_m[second]), np.maximum(range_m[first], range_m[second])
        jumps = far - near > JUMP * near  # False where a range is unknown
        return same_class(first, second) & (whole[classes[first]] | ~jumps)

    blob_of = connected_parts(usable, same_class)
    part_of = blob_of if points_m is None else connected_parts(usable, level)
    parts = _split(pixels, part_of)
    size_sr = np.bincount(part_of, area_sr.flat[pixels])
    max_sr = np.zeros(blob_of.max() + 1)
    np.maximum.at(max_sr, blob_of, size_sr[part_of])
    blob_of_part = np.zeros(len(parts), int)
    blob_of_part[part_of] = blob_of
    large_enough = (size_sr >= MIN_SR) & (size_sr >= SPILL * max_sr[blob_of_part])
    parts = [part for part, is_large in zip(parts, large_enough, strict=True) if is_large]
    return parts if points_m is None else _join_touching(parts, classes, points_m.reshape(-1, 3))


def _split(pixels: np.ndarray, part_of: np.ndarray) -> list[np.ndarray]:
    """Return the pixels of each part."""
    return np.split(pixels[np.argsort(part_of, kind="stable")], np.cumsum(np.bincount(part_of))[:-1])


def _join_touching(parts: list[np.ndarray], classes: np.ndarray, points_m: np.ndarray) -> list[np.ndarray]:
    """Join parts of the same class that are at most TOUCH_M apart, and return the pixels of each object."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    trees = []
    for part in parts:
        points = points_m[part]
        trees.append(cKDTree(points[np.isfinite(points).all(1)]))
    touching = np.zeros((len(parts), len(parts)), bool)
    for i, part in enumerate(parts):
        for j in range(i):
            if classes[part[0]] == classes[parts[j][0]] and trees[i].n and trees[j].n:
                small, large = sorted((trees[i], trees[j]), key=lambda tree: tree.n)
                distance, _ = large.query(small.data, distance_upper_bound=TOUCH_M)
                touching[i, j] = np.isfinite(distance).any()
    object_of = connected_components(csr_array(touching), directed=False)[1] if parts else np.zeros(0, int)
    return [
        np.sort(np.concatenate([part for part, owner in zip(parts, object_of, strict=True) if owner == number]))
        for number in range(object_of.max(initial=-1) + 1)
    ]
