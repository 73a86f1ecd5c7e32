"""Line distance functions (LDL, section 3): the distance of points on the sphere to the nearest line of each principal
direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe_lines.arcs import Arcs, Lines3d, project_lines

CODES_PER_RAD, MAX_CODE = 128, 200
"""A distance is stored as the uint8 code distance * CODES_PER_RAD, at most MAX_CODE (1.56 rad). MAX_CODE is well below
255, so that a negative difference of two codes wraps around to a large value."""
CHUNK = 8
"""Number of positions that are processed at once. The arrays then fit into the cache of the processor."""


def sphere_points(count: int) -> np.ndarray:
    """Return (count, 3) float32 unit vectors that are distributed evenly over the sphere (Fibonacci lattice)."""
    number = np.arange(count) + 0.5
    z = 1 - 2 * number / count
    angle_rad, radius = np.pi * (1 + np.sqrt(5)) * number, np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(angle_rad), radius * np.sin(angle_rad), z], axis=1).astype(np.float32)


def distance_codes(arcs: Sequence[Arcs], points: np.ndarray) -> np.ndarray:
    """Return the distance of each sphere point to the nearest arc along x, then y, then z, as codes (..., 3 Q) uint8.

    Args:
        arcs: Arcs along each axis, in batches (..., N).
        points: (Q, 3) unit vectors.
    """
    codes = []
    for axis, (around_rad, along_rad) in enumerate(arcs):
        cosine = _nearest_cosines(around_rad, along_rad, np.roll(points, -axis, axis=1))
        codes.append(np.minimum(np.arccos(np.clip(cosine, -1, 1)) * CODES_PER_RAD, MAX_CODE).astype(np.uint8))
    return np.concatenate(codes, axis=-1)


def _nearest_cosines(around_rad, along_rad, points):
    """Return the cosine (..., Q) of the angle between each point (Q, 3) and the nearest arc; -1 if there is no arc.

    The first coordinate of a point is along the axis of the arcs. The point is projected to the plane of an arc. If the
    projection lies between the ends of the arc, its length is the cosine of the angle. Otherwise, the angle to the
    nearer end of the arc is used.
    """
    around_rad, along_rad = around_rad.astype(np.float32)[..., None], along_rad.astype(np.float32)
    low_rad, high_rad = along_rad[..., 0, None], along_rad[..., 1, None]
    away = np.cos(around_rad) * points[:, 1] + np.sin(around_rad) * points[:, 2]
    to_low = np.cos(low_rad) * points[:, 0] + np.sin(low_rad) * away
    to_high = np.cos(high_rad) * points[:, 0] + np.sin(high_rad) * away
    opening = np.cos(high_rad - low_rad)
    between = (to_high > opening * to_low) & (to_low > opening * to_high)
    cosines = np.where(between, np.sqrt(points[:, 0] ** 2 + away**2), np.maximum(to_low, to_high))
    return cosines.max(axis=-2, initial=-1)


def distance_codes_from(lines: Sequence[Lines3d], positions_m: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the `distance_codes` (T, 3 Q) at Q points of the sphere. Each row describes all lines, as seen from one of
    the positions (T, 3). `lines` has one entry for each of the three directions."""
    chunks = [positions_m[i : i + CHUNK] for i in range(0, len(positions_m), CHUNK)]
    return np.concatenate(
        [distance_codes([project_lines(lines[k], k, chunk) for k in range(3)], points) for chunk in chunks]
    )


def agreeing_share(codes: np.ndarray, query: np.ndarray, within_rad: float) -> np.ndarray:
    """Return for each position the fraction of distances that agree with the query, (T,).

    This is the inlier cost of LDL and FGPL.

    Args:
        codes: (T, 3 Q) distance codes at the positions.
        query: (3 Q,) distance codes of the query.
        within_rad: Maximum difference of distances that agree.
    """
    within = np.uint8(round(within_rad * CODES_PER_RAD))
    return (
        np.count_nonzero((codes - (query - within)) <= 2 * within, axis=1) / codes.shape[1]
    )  # uint8 wraps around, so one comparison checks both bounds
