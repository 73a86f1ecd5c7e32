"""The position of a query among lines in space, from how the query sees them: a local search, then least squares.

Everything is in the principal frame of the lines, and the query's arcs are turned into it: what is left to find is a
shift and a small turn.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.panoramas.geometry import wrap_angle
from salframe_lines.arcs import Arcs, Lines3d, seen_from

SEARCH = ((0.16, 0.10), (0.06, 0.05))
"""Step (metres) and tolerance (radians) of each round of the search, over two steps to every side."""
SEARCH_LINES = 50
"""Arcs and lines an axis, the longest, that the search looks at."""
REFINE_RAD = (0.05, 0.04, 0.03, 0.02, 0.015, 0.01, 0.01)
"""Tolerance of each step of the refinement."""
AGREE_RAD = 0.01
"""An arc agrees with a line in the end where they are less than this apart."""
LONG_RAD = 0.5
"""An arc counts by its length up to this: a line from wall to wall says no more than that it is there."""
MAX_STEP_M = 0.4


def agreement(
    arcs: Sequence[Arcs], lines: Sequence[Lines3d], positions_m: np.ndarray, tolerance_rad: float
) -> np.ndarray:
    """(T,) share of the length of the query's arcs that agrees with lines as seen from positions (T, 3).

    Each arc takes the line along its axis that covers and fits it best: the common length times 1 - (angle apart /
    tolerance)^2.
    """
    agreeing, total = np.zeros(len(positions_m)), 0.0
    for axis in range(3):
        seen = arcs[axis]
        total += np.minimum(np.diff(seen.along_rad), LONG_RAD).sum()
        apart_rad, common_rad = _compare(seen, seen_from(lines[axis], axis, positions_m))
        fit = np.minimum(common_rad, LONG_RAD) * (1 - (apart_rad / tolerance_rad) ** 2)
        fit[(common_rad < 0) | (np.abs(apart_rad) > tolerance_rad)] = 0
        agreeing += fit.max(axis=-1, initial=0).sum(axis=-1)
    return agreeing / max(total, 1e-9)


def _compare(seen: Arcs, expected: Arcs) -> tuple[np.ndarray, np.ndarray]:
    """(..., N, M) float32 each: the angle by which expected arcs (..., M) lie off seen ones (N,), signed, and the
    length they have in common."""
    low_rad, high_rad = (seen.along_rad[:, i, None].astype(np.float32) for i in (0, 1))
    expected_rad = expected.along_rad.astype(np.float32)[..., None, :, :]
    common_rad = np.minimum(high_rad, expected_rad[..., 1]) - np.maximum(low_rad, expected_rad[..., 0])
    off_rad = expected.around_rad.astype(np.float32)[..., None, :] - wrap_angle(seen.around_rad[:, None]).astype(
        np.float32
    )
    off_rad -= np.float32(2 * np.pi) * np.round(off_rad * np.float32(0.5 / np.pi))
    return off_rad * np.sin((low_rad + high_rad) / 2), common_rad


def search(arcs: Sequence[Arcs], lines: Sequence[Lines3d], position_m: np.ndarray) -> np.ndarray:
    """The position (3,) of most agreement around one that is right to some 0.3 m: ever finer grids at its height."""
    arcs = [Arcs(*(part[:SEARCH_LINES] for part in along)) for along in arcs]
    lines = [Lines3d(*(part[:SEARCH_LINES] for part in along)) for along in lines]
    for step_m, tolerance_rad in SEARCH:
        steps = np.arange(-2, 3) * step_m
        grid_m = position_m + np.stack(np.meshgrid(steps, steps, 0.0), axis=-1).reshape(-1, 3)
        position_m = grid_m[agreement(arcs, lines, grid_m, tolerance_rad).argmax()]
    return position_m


def refine(arcs: Sequence[Arcs], lines: Sequence[Lines3d], position_m: np.ndarray) -> tuple[np.ndarray, float]:
    """Position (3,) and turn (radians) of the query for which its arcs lie on the lines nearest to them.

    Least squares on the angle between the middle of each arc and the plane through its line, arcs by their length, with
    Tukey's weights and nearest lines taken anew at each step, under a tolerance that shrinks (FGPL refines on the
    sphere likewise, by intersections of lines).
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


def _residuals(seen, lines, axis, position_m, turn_rad, tolerance_rad):
    """Of the arcs that have a line within the tolerance: residual (K,), weight (K,), and the residual's derivatives (K,
    4) by position and turn."""
    middle_rad = seen.along_rad.mean(axis=1)
    radius = np.sin(middle_rad)
    height = (radius * np.sin(seen.around_rad), radius * np.cos(seen.around_rad), np.cos(middle_rad))[axis]
    turning = ((axis == 2) - height * np.cos(middle_rad)) / radius  # how fast a turn moves the middle around the axis
    apart_rad, common_rad = _compare(seen, seen_from(lines, axis, position_m))
    apart_rad = np.where(common_rad > 0, apart_rad - (turn_rad * turning)[:, None], np.inf)
    if not apart_rad.size:
        return np.zeros(0), np.zeros(0), np.zeros((0, 4))
    nearest = np.abs(apart_rad).argmin(axis=1)
    residual_rad = np.take_along_axis(apart_rad, nearest[:, None], axis=1)[:, 0]
    kept = np.abs(residual_rad) < tolerance_rad
    residual_rad, radius = residual_rad[kept], radius[kept]
    first_m, second_m = (lines.across_m[nearest[kept]] - np.roll(position_m, -axis)[1:]).T
    squared_m2 = first_m**2 + second_m**2
    jacobian = np.zeros((len(residual_rad), 4))
    jacobian[:, (axis + 1) % 3] = second_m / squared_m2 * radius
    jacobian[:, (axis + 2) % 3] = -first_m / squared_m2 * radius
    jacobian[:, 3] = -turning[kept]
    weight = np.minimum(np.diff(seen.along_rad[kept])[:, 0], LONG_RAD) * (1 - (residual_rad / tolerance_rad) ** 2) ** 2
    return residual_rad, weight, jacobian
