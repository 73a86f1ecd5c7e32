"""Triangulation of object positions from the bearings at which several viewpoints see them."""

from __future__ import annotations

import numpy as np

MAX_RANGE_M = 6.0
"""Maximum distance of an object from a viewpoint in metres. The dataset REVERIE annotates objects within 3 m of a
viewpoint; the centre of a large object may be farther away."""
ITERATIONS = 20
"""Number of reweighting iterations."""
ANGLE_FLOOR_RAD = np.radians(1.0)
"""Accuracy of bearings in radians. A ray with a smaller residual gets the weight of a ray with this residual."""
RANGE_FLOOR_M = 0.3
"""Minimum range in metres used in weights, so that a viewpoint next to or inside an object does not dominate the
others."""


def triangulate(origin_m: np.ndarray, direction: np.ndarray, target: np.ndarray, targets: int) -> np.ndarray:
    """Return the position of each target: the point nearest to all rays towards the target; NaN if it is implausible.

    Args:
        origin_m: Ray origins (N, 3) in metres.
        direction: Unit ray directions (N, 3).
        target: Target of each ray (N,), int in [0, targets).
        targets: Number of targets.

    Returns:
        Positions (targets, 3) in metres. The position is NaN if the target has fewer than two rays, or if the position
        lies behind the origin of a ray or farther than MAX_RANGE_M from it.
    """
    position = meeting_points(origin_m, direction, target, targets)
    offset = position[target] - origin_m
    with np.errstate(invalid="ignore"):
        unsound = (np.einsum("ni,ni->n", offset, direction) <= 0) | (np.linalg.norm(offset, axis=1) > MAX_RANGE_M)
    position[target[unsound]] = np.nan
    return position


def meeting_points(origin_m: np.ndarray, direction: np.ndarray, target: np.ndarray, targets: int) -> np.ndarray:
    """Return the position of each target: the point nearest to all rays towards the target.

    The position minimizes the sum of the angles between the rays and the directions to the position (by iteratively
    reweighted least squares). One wrong bearing among several thus has little influence. Arguments are those of
    `triangulate`.

    Returns:
        Positions (targets, 3) in metres; NaN for a target with fewer than two rays.
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
        # The squared distance from a ray is squared range times squared angle; these weights reduce it to the angle.
        weights = 1 / (np.maximum(angle, ANGLE_FLOOR_RAD) * np.maximum(range_m, RANGE_FLOOR_M) ** 2)
    return position


def position_covariance(origin_m: np.ndarray, position_m: np.ndarray, error_rad: np.ndarray) -> np.ndarray:
    """Return the covariance, (3, 3) in m^2, of a position that was triangulated from at least two rays.

    A ray with an angular error s at range r contributes the information (I - d d^T) / (s r)^2, where d is its
    direction (first-order propagation of the errors of bearings).

    Args:
        origin_m: Ray origins (N, 3) in metres.
        position_m: The position (3,).
        error_rad: Standard deviations (N,) of each component of the bearings, in radians.
    """
    offset = position_m - origin_m
    range_m = np.maximum(np.linalg.norm(offset, axis=1), RANGE_FLOOR_M)
    direction = offset / range_m[:, None]
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    return np.linalg.inv((across / (error_rad * range_m)[:, None, None] ** 2).sum(0))  # type: ignore[no-any-return]
