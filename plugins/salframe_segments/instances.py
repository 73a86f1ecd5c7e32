"""Objects from classes on pixels: connected parts of one class, cut where the range jumps, joined where they touch."""

from __future__ import annotations

import numpy as np

from salframe.graphs.pixels import connected_parts

JUMP = 0.2
"""Neighbouring pixels whose ranges differ by more than this share of the nearer are of two parts. A table top half a
metre below the camera, 0.7 deg a pixel, reaches that 4 m away."""
SPILL = 0.1
"""What a jump in range cuts off of a patch of one class is the rim that spilt onto what lies behind, not an object,
where it is smaller than this share of the patch's largest part."""
MIN_SR = 2e-3
"""A part that covers less of the sphere is no object: a square of 2.6 deg."""
TOUCH_M = 0.15
"""Parts of a class are one object where points of theirs are nearer."""


def find_instances(
    class_id: np.ndarray, objects: np.ndarray, whole: np.ndarray, points_m: np.ndarray | None, area_sr: np.ndarray
) -> list[np.ndarray]:
    """The objects on a panorama's pixels, as flat pixel indices (n,), ascending, one array an object.

    class_id (H, W) int; objects (C,) bool, the classes whose pixels are objects; whole (C,) bool, those that jumps in
    range do not cut: doors stand open, and a window shows what lies behind it. points_m (H, W, 3) float, where each
    pixel's surface is, NaN where unknown; None: parts are cut by nothing and not joined. area_sr (H, W), a pixel's
    share of the sphere.
    """
    usable, classes = objects[class_id], class_id.ravel()
    pixels = np.flatnonzero(usable)
    if not len(pixels):
        return []
    range_m = np.zeros(class_id.size) if points_m is None else np.linalg.norm(points_m, axis=-1).ravel()

    def same(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return classes[first] == classes[second]

    def level(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        near, far = np.minimum(range_m[first], range_m[second]), np.maximum(range_m[first], range_m[second])
        jumps = far - near > JUMP * near  # not where a range is unknown
        return same(first, second) & (whole[classes[first]] | ~jumps)

    blob_of = connected_parts(usable, same)
    part_of = blob_of if points_m is None else connected_parts(usable, level)
    parts = _split(pixels, part_of)
    size_sr = np.bincount(part_of, area_sr.flat[pixels])
    max_sr = np.zeros(blob_of.max() + 1)
    np.maximum.at(max_sr, blob_of, size_sr[part_of])
    blob_of_part = np.zeros(len(parts), int)
    blob_of_part[part_of] = blob_of
    kept = (size_sr >= MIN_SR) & (size_sr >= SPILL * max_sr[blob_of_part])
    parts = [part for part, keep in zip(parts, kept, strict=True) if keep]
    return parts if points_m is None else _join_touching(parts, classes, points_m.reshape(-1, 3))


def _split(pixels: np.ndarray, part_of: np.ndarray) -> list[np.ndarray]:
    """The pixels of each part."""
    return np.split(pixels[np.argsort(part_of, kind="stable")], np.cumsum(np.bincount(part_of))[:-1])


def _join_touching(parts: list[np.ndarray], classes: np.ndarray, points_m: np.ndarray) -> list[np.ndarray]:
    """Parts of one class that touch, as one."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    trees = []
    for part in parts:
        own = points_m[part]
        trees.append(cKDTree(own[np.isfinite(own).all(1)]))
    touching = np.zeros((len(parts), len(parts)), bool)
    for i, part in enumerate(parts):
        for j in range(i):
            if classes[part[0]] == classes[parts[j][0]] and trees[i].n and trees[j].n:
                small, large = sorted((trees[i], trees[j]), key=lambda tree: tree.n)
                distance, _ = large.query(small.data, distance_upper_bound=TOUCH_M)
                touching[i, j] = np.isfinite(distance).any()
    object_of = connected_components(csr_array(touching), directed=False)[1] if parts else np.zeros(0, int)
    return [
        np.sort(np.concatenate([part for part, own in zip(parts, object_of, strict=True) if own == number]))
        for number in range(object_of.max(initial=-1) + 1)
    ]
