"""Segments along the three principal directions of a room, as arcs on the sphere and as lines in space.

The principal frame of a panorama is its frame turned about the vertical until x and y run along the walls. A segment
along axis k, seen in that frame, lies on a half circle through both poles of k, and has two coordinates: the half
circle's angle around k, from axis k + 1 towards k + 2 (cyclic), and the angles of its ends along it, measured from k's
pole, in (0, pi). A line in space has its place across k and its ends along k.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from salframe.panoramas.geometry import rays_to_pixels, wrap_angle

OFF_AXIS_RAD = np.deg2rad(2.5)
"""A segment belongs to the axis whose pole its great circle passes this close to."""
POLE_RAD = np.deg2rad(4)
"""Segments that come this close to the pole of their axis are too short in truth to tell their angle around it."""
SAME_LINE_RAD, SAME_LINE_GAP_RAD = np.deg2rad(0.35), np.deg2rad(1.5)
"""Pieces of one line: no further apart than this across it, and along it."""
MIN_LENGTH_RAD = np.deg2rad(3)
SURFACE_STEP = 0.1
"""A surface beside a line is another one, and the line its end, where it is nearer by this share."""
RANGE_SAMPLES = 24
SURFACE_SHARE, SURFACE_TOLERANCE = 0.5, 0.05
"""A segment is lifted where this share of its ranges agree on a line's distance within this part of it."""


class Arcs(NamedTuple):
    """Arcs along one axis: around_rad (..., N), along_rad (..., N, 2), the lower end first."""

    around_rad: np.ndarray
    along_rad: np.ndarray


class Lines3d(NamedTuple):
    """Lines along one axis k, in a principal frame: across_m (N, 2), on axes k + 1 and k + 2; along_m (N, 2), the lower
    end first."""

    across_m: np.ndarray
    along_m: np.ndarray


def principal_yaw(ends: np.ndarray) -> float:
    """The yaw_rad in [0, pi / 2) of the walls: what turns the principal frame into the frame of segments (N, 2, 3).

    The panorama is upright, so that the vertical direction is known, and each segment that is horizontal in truth tells
    where it points to: the horizontal line in the plane through it and the eye. The peak of a histogram over azimuth
    modulo 90 degrees, each segment by its length (LDL: principal directions by votes on the sphere), then the mean of
    what lies around it.
    """
    normal = np.cross(ends[:, 0], ends[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    level = np.hypot(normal[:, 0], normal[:, 1])  # 0: the segment lies on the horizon and points anywhere
    votes = np.where(
        np.abs(normal[:, 2]) > np.sin(np.deg2rad(5)), level * _lengths(ends), 0
    )  # the others may be vertical
    if not votes.any():
        return 0.0
    azimuth_rad = np.arctan2(normal[:, 0], -normal[:, 1])
    bins = np.bincount((azimuth_rad % (np.pi / 2) * 360 / np.pi).astype(int) % 180, votes, 180)  # of half a degree
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
    """The segments (N, 2, 3) along the three axes of the principal frame; pieces of one line joined, the `limit`
    longest an axis, longest first.

    Segments along no axis, or along two as far as one can see, are left out.
    """
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    ends = ends @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    normal = np.cross(ends[:, 0], ends[:, 1])
    off = np.abs(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    belongs = off < np.sin(OFF_AXIS_RAD)
    belongs &= belongs.sum(1, keepdims=True) == 1
    x, y, z = (_joined(np.roll(ends[belongs[:, k]], -k, axis=2), limit) for k in range(3))
    return x, y, z


def _joined(ends: np.ndarray, limit: int) -> Arcs:
    """Arcs from ends (N, 2, 3) whose first coordinate runs along their axis."""
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
    reach_rad = np.stack([np.full(count, np.inf), np.full(count, -np.inf)], axis=1)
    np.minimum.at(reach_rad[:, 0], line, along_rad[:, 0])
    np.maximum.at(reach_rad[:, 1], line, along_rad[:, 1])
    length_rad = reach_rad[:, 1] - reach_rad[:, 0]
    order = np.argsort(-length_rad, kind="stable")[:limit]
    order = order[length_rad[order] >= MIN_LENGTH_RAD]
    return Arcs(mean_rad[order], reach_rad[order])


def quarter_turned(arcs: tuple[Arcs, Arcs, Arcs]) -> tuple[Arcs, Arcs, Arcs]:
    """The arcs turned by 90 degrees about the vertical: those along x come to lie along y, those along y along -x."""
    x, y, z = arcs
    return (
        Arcs(np.pi / 2 - y.around_rad, np.pi - y.along_rad[:, ::-1]),
        Arcs(x.around_rad - np.pi / 2, x.along_rad),
        Arcs(z.around_rad + np.pi / 2, z.along_rad),
    )


def line_distances(arcs: Arcs, axis: int, yaw_rad: float, range_m: np.ndarray) -> np.ndarray:
    """(N,) distance_m of the eye from the lines behind arcs along `axis`, by a range image (H, 2H); NaN where it is not
    known.

    At points along the arc the range is taken, or that of the arc's one side or the other where it is much nearer: a
    line at which one surface ends before another belongs to the nearer one. A range times the sine of its angle from
    the axis is the line's distance, the same all along the line; the median is taken.
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


def lifted(arcs: Arcs, distance_m: np.ndarray) -> Lines3d:
    """The lines in space behind arcs, in the principal frame, by their distances (N,) from the eye; those of unknown
    distance are left out."""
    known = np.isfinite(distance_m)
    distance_m, around_rad, along_rad = distance_m[known], arcs.around_rad[known], arcs.along_rad[known]
    across_m = distance_m[:, None] * np.stack([np.cos(around_rad), np.sin(around_rad)], axis=1)
    return Lines3d(across_m, (distance_m[:, None] / np.tan(along_rad))[:, ::-1])


def seen_from(lines: Lines3d, axis: int, position_m: np.ndarray) -> Arcs:
    """The arcs (..., N) that lines along `axis` are seen as from positions (..., 3), all in the principal frame."""
    position_m = np.roll(position_m, -axis, axis=-1)[..., None, :]
    first_m, second_m = (lines.across_m[:, i] - position_m[..., i + 1] for i in (0, 1))
    along_m = lines.along_m[:, ::-1] - position_m[..., :1]
    return Arcs(np.arctan2(second_m, first_m), np.arctan2(np.hypot(first_m, second_m)[..., None], along_m))
