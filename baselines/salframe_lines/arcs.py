"""Segments along the three principal directions of a room, as arcs on the sphere and as 3D lines.

The principal frame of a panorama is its frame rotated about the vertical until x and y are parallel to the walls. A
segment along axis k lies on a half circle through both poles of k in this frame. Its coordinates are the angle of the
half circle around k, from axis k + 1 towards k + 2 (cyclic), and the angles of its ends along the half circle, measured
from the pole of k, in (0, pi). The coordinates of a 3D line are its position across k and its ends along k.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from salframe.panoramas.geometry import rays_to_pixels, wrap_angle

OFF_AXIS_RAD = np.deg2rad(2.5)
"""Maximum angle between the great circle of a segment and the pole of the axis that the segment belongs to."""
POLE_RAD = np.deg2rad(4)
"""Minimum angle between a segment and the pole of its axis. Closer to the pole, the angle of a segment around the axis
is inaccurate."""
SAME_LINE_RAD, SAME_LINE_GAP_RAD = np.deg2rad(0.35), np.deg2rad(1.5)
"""Maximum angular distances between segments that belong to one line, across the line and along the line."""
MIN_LENGTH_RAD = np.deg2rad(3)
"""Minimum length of an arc."""
SURFACE_STEP = 0.1
"""Minimum relative difference between the ranges on both sides of a line. From this difference on, the line is the edge
of the nearer surface."""
RANGE_SAMPLES = 24
"""Number of points along an arc at which the range is sampled."""
SURFACE_SHARE, SURFACE_TOLERANCE = 0.5, 0.05
"""Minimum share of the samples that must agree on the distance of a line, and the relative tolerance."""


class Arcs(NamedTuple):
    """Arcs along one axis.

    Attributes:
        around_rad: (..., N) angle around the axis.
        along_rad: (..., N, 2) angles of the ends along the arc, the lower end first.
    """

    around_rad: np.ndarray
    along_rad: np.ndarray


class Lines3d(NamedTuple):
    """3D lines along one axis k of the principal frame.

    The principal frame is the frame of the panorama, rotated about the vertical until x and y are parallel to the
    walls.

    Attributes:
        across_m: (N, 2) position on the axes k + 1 and k + 2.
        along_m: (N, 2) ends on axis k, the lower end first.
    """

    across_m: np.ndarray
    along_m: np.ndarray


def principal_yaw(ends: np.ndarray) -> float:
    """Estimate the yaw of the walls in [0, pi / 2), the rotation from the principal frame to the frame of the segments.

    The panorama is upright, so the vertical direction is known. The direction of a horizontal segment is the horizontal
    line in the plane through the segment and the camera. A histogram over azimuth modulo 90 degrees sums the lengths of
    the segments. The yaw is the peak of the histogram, refined by the mean of the directions around the peak. (LDL
    finds principal directions by votes on the sphere instead.)

    Args:
        ends: (N, 2, 3) unit vectors to the ends of segments in the panorama frame.
    """
    normal = np.cross(ends[:, 0], ends[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    level = np.hypot(normal[:, 0], normal[:, 1])  # 0: the segment lies on the horizon, and its direction is unknown
    votes = np.where(
        np.abs(normal[:, 2]) > np.sin(np.deg2rad(5)), level * _lengths(ends), 0
    )  # other segments may be vertical
    if not votes.any():
        return 0.0
    azimuth_rad = np.arctan2(normal[:, 0], -normal[:, 1])
    bins = np.bincount((azimuth_rad % (np.pi / 2) * 360 / np.pi).astype(int) % 180, votes, 180)  # half-degree bins
    smooth = np.exp(-((np.arange(-4, 5) / 1.5) ** 2) / 2)
    peak_rad = (np.convolve(np.pad(bins, 4, mode="wrap"), smooth, "valid").argmax() + 0.5) * np.pi / 360
    for within_rad in np.deg2rad((1.5, 0.75, 0.5)):
        off_rad = wrap_angle(4 * (azimuth_rad - peak_rad)) / 4
        weight = np.where(np.abs(off_rad) < within_rad, votes, 0)
        peak_rad += (weight * off_rad).sum() / max(weight.sum(), 1e-9)
    return float(peak_rad % (np.pi / 2))


def _lengths(ends):
    return np.arccos(np.clip((ends[:, 0] * ends[:, 1]).sum(1), -1, 1))


def arcs_along_axes(ends: np.ndarray, yaw_rad: float, limit: int) -> tuple[Arcs, Arcs, Arcs]:
    """Return the arcs of the segments along the three axes of the principal frame. Segments of one line are joined.

    Segments that are parallel to no axis, or to two axes within the tolerance, are ignored.

    Args:
        ends: (N, 2, 3) unit vectors to the ends of segments in the panorama frame.
        yaw_rad: Yaw of the principal frame.
        limit: Maximum number of arcs per axis. The longest are returned.
    """
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    ends = ends @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    normal = np.cross(ends[:, 0], ends[:, 1])
    off = np.abs(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    belongs = off < np.sin(OFF_AXIS_RAD)
    belongs &= belongs.sum(1, keepdims=True) == 1
    x, y, z = (_join_segments(np.roll(ends[belongs[:, k]], -k, axis=2), limit) for k in range(3))
    return x, y, z


def _join_segments(ends: np.ndarray, limit: int) -> Arcs:
    """Join segments (N, 2, 3) along one axis that belong to one line, and return the `limit` longest arcs.

    The axis is the first coordinate of the segments' ends.
    """
    from scipy.sparse.csgraph import connected_components

    middle = ends.sum(1)
    around_rad = np.arctan2(middle[:, 2], middle[:, 1])
    along_rad = np.sort(np.arccos(np.clip(ends[..., 0], -1, 1)), axis=1)
    clear = (along_rad[:, 0] > POLE_RAD) & (along_rad[:, 1] < np.pi - POLE_RAD)
    around_rad, along_rad = around_rad[clear], along_rad[clear]
    if not clear.any():
        return Arcs(around_rad, along_rad)
    radius = np.sin(along_rad.mean(1))
    apart = np.abs(wrap_angle(around_rad[:, None] - around_rad)) * np.minimum(radius[:, None], radius)
    gap = np.maximum(along_rad[:, None, 0], along_rad[:, 0]) - np.minimum(along_rad[:, None, 1], along_rad[:, 1])
    count, line = connected_components((apart < SAME_LINE_RAD) & (gap < SAME_LINE_GAP_RAD), directed=False)
    weight = (along_rad[:, 1] - along_rad[:, 0]) * radius**2
    mean_rad = np.arctan2(
        np.bincount(line, weight * np.sin(around_rad), count), np.bincount(line, weight * np.cos(around_rad), count)
    )
    span_rad = np.stack([np.full(count, np.inf), np.full(count, -np.inf)], axis=1)
    np.minimum.at(span_rad[:, 0], line, along_rad[:, 0])
    np.maximum.at(span_rad[:, 1], line, along_rad[:, 1])
    length_rad = span_rad[:, 1] - span_rad[:, 0]
    order = np.argsort(-length_rad, kind="stable")[:limit]
    order = order[length_rad[order] >= MIN_LENGTH_RAD]
    return Arcs(mean_rad[order], span_rad[order])


def rotate_by_quarter_turn(arcs: tuple[Arcs, Arcs, Arcs]) -> tuple[Arcs, Arcs, Arcs]:
    """Return the arcs rotated by 90 degrees about the vertical, from x to y and from y to -x."""
    x, y, z = arcs
    return (
        Arcs(np.pi / 2 - y.around_rad, np.pi - y.along_rad[:, ::-1]),
        Arcs(x.around_rad - np.pi / 2, x.along_rad),
        Arcs(z.around_rad + np.pi / 2, z.along_rad),
    )


def line_distances(arcs: Arcs, axis: int, yaw_rad: float, range_m: np.ndarray) -> np.ndarray:
    """Return the distances (N,) in metres of the camera from the 3D lines of arcs along an axis; NaN if unknown.

    The range is sampled along the arc. If the range on one side of the arc is much smaller, that range is used, because
    an edge in front of another surface belongs to the nearer surface. The distance of the line is the range times the
    sine of the angle from the axis. It is constant along the line, so the median over all samples is returned.

    Args:
        arcs: Arcs along the axis.
        axis: Index of the axis.
        yaw_rad: Yaw of the principal frame.
        range_m: (H, 2H) range image in metres.
    """
    height = range_m.shape[0]
    shares = (np.arange(RANGE_SAMPLES) + 0.5) / RANGE_SAMPLES
    along_rad = arcs.along_rad[:, :1] + np.diff(arcs.along_rad) * shares
    beside_rad = 1.5 * np.pi / height / np.sin(along_rad)
    ranges_m = []
    for side in (-1, 0, 1):
        around_rad = arcs.around_rad[:, None] + side * beside_rad
        local = np.stack(
            [np.cos(along_rad), np.sin(along_rad) * np.cos(around_rad), np.sin(along_rad) * np.sin(around_rad)], axis=-1
        )
        x, y, z = np.moveaxis(np.roll(local, axis, axis=-1), -1, 0)
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        columns, rows = rays_to_pixels(np.stack([c * x - s * y, s * x + c * y, z], axis=-1), height)
        ranges_m.append(range_m[np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)])
    nearest_m = np.nan_to_num(np.fmin.reduce(ranges_m), nan=np.inf)
    on_line_m = np.where(nearest_m > (1 - SURFACE_STEP) * ranges_m[1], ranges_m[1], nearest_m)
    across_m = on_line_m * np.sin(along_rad)
    median_m = np.median(across_m, axis=1)
    with np.errstate(invalid="ignore"):
        agree = np.abs(across_m - median_m[:, None]) < SURFACE_TOLERANCE * median_m[:, None]
    return np.where(agree.mean(1) >= SURFACE_SHARE, median_m, np.nan)


def lift_arcs(arcs: Arcs, distance_m: np.ndarray) -> Lines3d:
    """Compute the 3D lines of N arcs in the principal frame from their distances (N,) to the camera.

    Arcs with an unknown distance (NaN) are left out.
    """
    valid = np.isfinite(distance_m)
    distance_m, around_rad, along_rad = distance_m[valid], arcs.around_rad[valid], arcs.along_rad[valid]
    across_m = distance_m[:, None] * np.stack([np.cos(around_rad), np.sin(around_rad)], axis=1)
    return Lines3d(across_m, (distance_m[:, None] / np.tan(along_rad))[:, ::-1])


def project_lines(lines: Lines3d, axis: int, position_m: np.ndarray) -> Arcs:
    """Project N lines that are parallel to an axis into panoramas at given positions, all in the principal frame.

    Args:
        lines: Lines parallel to the axis.
        axis: Index of the axis.
        position_m: (..., 3) positions of the panoramas in metres.

    Returns:
        The arcs (..., N) of the lines in each panorama.
    """
    position_m = np.roll(position_m, -axis, axis=-1)[..., None, :]
    first_m, second_m = (lines.across_m[:, i] - position_m[..., i + 1] for i in (0, 1))
    along_m = lines.along_m[:, ::-1] - position_m[..., :1]
    return Arcs(np.arctan2(second_m, first_m), np.arctan2(np.hypot(first_m, second_m)[..., None], along_m))
