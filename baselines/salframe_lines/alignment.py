"""Position of a query relative to 3D lines: a local search, then least squares.

All quantities are in the principal frame of the lines. The query's arcs are rotated into this frame, so the unknowns
are a translation and a small rotation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.panoramas.geometry import wrap_angle
from salframe_lines.arcs import Arcs, Lines3d, project_lines

SEARCH = ((0.16, 0.10), (0.06, 0.05))
"""Grid spacing (metres) and angular tolerance (radians) of each round of the search. The grid of a round extends two
steps to each side."""
SEARCH_LINES = 50
"""Maximum number of arcs and of lines per axis that the search uses. The longest are used."""
REFINE_RAD = (0.05, 0.04, 0.03, 0.02, 0.015, 0.01, 0.01)
"""Tolerance of each step of the refinement, in radians."""
AGREE_RAD = 0.01
"""Maximum angle between an arc and a line that agree after the refinement, in radians."""
LONG_RAD = 0.5
"""Maximum weight of an arc. Up to this value, the weight is the length of the arc in radians. Longer arcs are not more
informative."""
MAX_STEP_M = 0.4
"""Maximum translation along each axis in one step of the refinement."""


def agreement(
    arcs: Sequence[Arcs], lines: Sequence[Lines3d], positions_m: np.ndarray, tolerance_rad: float
) -> np.ndarray:
    """Compute how much of the total length of the query's arcs agrees with the lines, for several positions.

    Each arc is compared with the best projected line along the same axis. The agreeing length is the common length
    times 1 - (angle between arc and line / tolerance)^2.

    Args:
        arcs: Arcs of the query along each axis.
        lines: Lines of the map along each axis.
        positions_m: (T, 3) assumed positions of the query, in metres.
        tolerance_rad: Maximum angle between an arc and a line that agree.

    Returns:
        (T,) fractions of the total length, from 0 to 1.
    """
    agreeing, total = np.zeros(len(positions_m)), 0.0
    for axis in range(3):
        observed = arcs[axis]
        total += np.minimum(np.diff(observed.along_rad), LONG_RAD).sum()
        apart_rad, common_rad = _compare(observed, project_lines(lines[axis], axis, positions_m))
        fit = np.minimum(common_rad, LONG_RAD) * (1 - (apart_rad / tolerance_rad) ** 2)
        fit[(common_rad < 0) | (np.abs(apart_rad) > tolerance_rad)] = 0
        agreeing += fit.max(axis=-1, initial=0).sum(axis=-1)
    return agreeing / max(total, 1e-9)


def _compare(observed: Arcs, expected: Arcs) -> tuple[np.ndarray, np.ndarray]:
    """Return the signed angle between expected arcs (..., M) and observed arcs (N,), and their common length.

    Angle and common length are (..., N, M) float32, in radians.
    """
    low_rad, high_rad = (observed.along_rad[:, i, None].astype(np.float32) for i in (0, 1))
    expected_rad = expected.along_rad.astype(np.float32)[..., None, :, :]
    common_rad = np.minimum(high_rad, expected_rad[..., 1]) - np.maximum(low_rad, expected_rad[..., 0])
    off_rad = expected.around_rad.astype(np.float32)[..., None, :] - wrap_angle(observed.around_rad[:, None]).astype(
        np.float32
    )
    off_rad -= np.float32(2 * np.pi) * np.round(off_rad * np.float32(0.5 / np.pi))
    return off_rad * np.sin((low_rad + high_rad) / 2), common_rad


def search(arcs: Sequence[Arcs], lines: Sequence[Lines3d], position_m: np.ndarray) -> np.ndarray:
    """Return the position (3,) with the largest agreement near an initial position.

    The true position must be at most about 0.3 m from `position_m`. The search uses increasingly fine grids at the
    height of the initial position.
    """
    arcs = [Arcs(*(part[:SEARCH_LINES] for part in along)) for along in arcs]
    lines = [Lines3d(*(part[:SEARCH_LINES] for part in along)) for along in lines]
    for step_m, tolerance_rad in SEARCH:
        steps = np.arange(-2, 3) * step_m
        grid_m = position_m + np.stack(np.meshgrid(steps, steps, 0.0), axis=-1).reshape(-1, 3)
        position_m = grid_m[agreement(arcs, lines, grid_m, tolerance_rad).argmax()]
    return position_m


def refine(arcs: Sequence[Arcs], lines: Sequence[Lines3d], position_m: np.ndarray) -> tuple[np.ndarray, float]:
    """Refine the position and heading of the query by aligning its arcs with the nearest lines.

    The method is least squares on the angle between the middle of each arc and the plane through its line. Arcs are
    weighted by their length and by Tukey's weights. Each step selects the nearest lines again and reduces the
    tolerance. (FGPL also refines on the sphere, with intersections of lines.)

    Returns:
        Position (3,) in metres, and the rotation about the vertical in radians.
    """
    position_m, turn_rad = position_m.astype(np.float64), 0.0
    for tolerance_rad in REFINE_RAD:
        normal, gradient = np.diag([1e-4, 1e-4, 1e-4, 1e-2]), np.zeros(4)
        for axis in range(3):
            residual_rad, weight, jacobian = _residuals(
                arcs[axis], lines[axis], axis, position_m, turn_rad, tolerance_rad
            )
            normal += jacobian.T @ (jacobian * weight[:, None])
            gradient += jacobian.T @ (residual_rad * weight)
        step = np.linalg.solve(normal, -gradient)
        position_m += np.clip(step[:3], -MAX_STEP_M, MAX_STEP_M)
        turn_rad += step[3]
    return position_m, turn_rad


def _residuals(observed, lines, axis, position_m, turn_rad, tolerance_rad):
    """Return the residuals of the K arcs that have a line within the tolerance.

    Returns:
        Residuals (K,), weights (K,), and derivatives (K, 4) of the residuals with respect to position and rotation.
    """
    middle_rad = observed.along_rad.mean(axis=1)
    radius = np.sin(middle_rad)
    height = (radius * np.sin(observed.around_rad), radius * np.cos(observed.around_rad), np.cos(middle_rad))[axis]
    turn_rate = (
        (axis == 2) - height * np.cos(middle_rad)
    ) / radius  # derivative of the middle's angle around the axis by the rotation
    apart_rad, common_rad = _compare(observed, project_lines(lines, axis, position_m))
    apart_rad = np.where(common_rad > 0, apart_rad - (turn_rad * turn_rate)[:, None], np.inf)
    if not apart_rad.size:
        return np.zeros(0), np.zeros(0), np.zeros((0, 4))
    nearest = np.abs(apart_rad).argmin(axis=1)
    residual_rad = np.take_along_axis(apart_rad, nearest[:, None], axis=1)[:, 0]
    inliers = np.abs(residual_rad) < tolerance_rad
    residual_rad, radius = residual_rad[inliers], radius[inliers]
    first_m, second_m = (lines.across_m[nearest[inliers]] - np.roll(position_m, -axis)[1:]).T
    squared_m2 = first_m**2 + second_m**2
    jacobian = np.zeros((len(residual_rad), 4))
    jacobian[:, (axis + 1) % 3] = second_m / squared_m2 * radius
    jacobian[:, (axis + 2) % 3] = -first_m / squared_m2 * radius
    jacobian[:, 3] = -turn_rate[inliers]
    weight = (
        np.minimum(np.diff(observed.along_rad[inliers])[:, 0], LONG_RAD)
        * (1 - (residual_rad / tolerance_rad) ** 2) ** 2
    )
    return residual_rad, weight, jacobian
