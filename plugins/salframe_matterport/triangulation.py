"""Where objects stand, from the bearings under which several viewpoints see them."""

from __future__ import annotations

import numpy as np

MAX_RANGE_M = 6.0
"""REVERIE annotates what lies within 3 m of a viewpoint; the middle of a large object may lie somewhat beyond."""
ITERATIONS = 20
ANGLE_FLOOR_RAD = np.radians(1.0)
"""Bearings are no better than this, so a residual below it earns no more weight."""
RANGE_FLOOR_M = 0.3
"""A viewpoint next to or inside an object does not outweigh all others."""


def triangulate(origin_m: np.ndarray, direction: np.ndarray, target: np.ndarray, targets: int) -> np.ndarray:
    """Positions (targets, 3) in metres that are nearest to all rays of each target, NaN where they do not tell one.

    origin_m, direction (N, 3): rays with unit directions, target (N,) int in [0, targets): what each ray points at.
    Minimises the sum of angles between rays and position (iteratively reweighted least squares), so that a single bad
    bearing among several moves little. A target with one ray only, or whose position lies behind one of its viewpoints
    or farther than MAX_RANGE_M from one, is NaN.
    """
    several = np.bincount(target, minlength=targets) > 1
    used = several[target]
    origin_m, direction, target = origin_m[used], direction[used], target[used]
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    across_origin = np.einsum("nij,nj->ni", across, origin_m)
    weights = np.ones(len(target))
    position = np.full((targets, 3), np.nan)
    for _ in range(ITERATIONS):
        matrix, vector = np.zeros((targets, 3, 3)), np.zeros((targets, 3))
        np.add.at(matrix, target, weights[:, None, None] * across)
        np.add.at(vector, target, weights[:, None] * across_origin)
        position[several] = np.einsum("kij,kj->ki", np.linalg.pinv(matrix[several], hermitian=True), vector[several])
        offset = position[target] - origin_m
        range_m = np.linalg.norm(offset, axis=1)
        along = np.einsum("ni,ni->n", offset, direction)
        angle = np.arccos(np.clip(along / np.maximum(range_m, RANGE_FLOOR_M), -1, 1))
        # The squared distance from a ray is the squared range times the squared angle: these weights leave the angle.
        weights = 1 / (np.maximum(angle, ANGLE_FLOOR_RAD) * np.maximum(range_m, RANGE_FLOOR_M) ** 2)
    unsound = (along <= 0) | (range_m > MAX_RANGE_M)
    position[target[unsound]] = np.nan
    return position
