"""Estimate the up direction of a tilted panorama: from the surfaces in its range, or from the lines in its colour."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays

MAX_TILT_DEG = 40.0
"""Maximum tilt that is estimated. Beyond 45 deg a wall could be taken for the floor."""
NUM_ROWS = 64
"""Number of rows of the reduced range image: about 3 deg per pixel."""
TOLERANCES_DEG = (45.0, 20.0, 10.0, 6.0)
"""Maximum angle between a surface and the horizontal or the vertical, in the order of the fits."""
MIN_SURFACE_SHARE, MIN_LEVEL_SHARE = 0.45, 0.05
"""Minimum solid angle of the horizontal and vertical surfaces, and of the horizontal ones alone, relative to all
surfaces. They are 0.75 and 0.3 in rendered rooms, and 0.65 and 0.2 with noise of 3 % in each pixel. With smooth errors
of 5 %, the first is 0.2, and the tilt has an error of 3 deg."""
MIN_LINES = 20
"""Minimum number of line segments. Fewer fit some direction by chance; rooms have a hundred or more."""
MAX_LINES = 400
"""Maximum number of line segments, the longest first."""
COARSE_DEG, FINE_DEG = 4.0, 1.5
"""Maximum angle between a line and an axis of the room, in the search and in the choice of the best direction."""
FIT_TOLERANCES_DEG = (2.0, 1.0, 1.0)
"""Maximum angle between a line and the vertical, in the order of the fits."""
LEVEL_LINE_DEG = 5.0
"""Minimum angle between the horizon and the plane through the camera and a horizontal line. The azimuth of other lines
is unknown."""
NUM_RIVALS, SEPARATE_DEG = 3, 7.0
"""Number of directions to refine, and the minimum angle between them."""
MIN_LINES_SHARE, MIN_LINES_RATIO, MIN_SPREAD = 0.3, 1.05, 0.03
"""Three minima for an up direction. The share of the lines, by length, along the three axes of the room. The ratio of
this share to the share of the next best direction. The share of vertical lines that are on walls at a right angle to
the other vertical lines, because the lines of one wall do not suffice."""


def up_from_range(range_m: np.ndarray) -> np.ndarray | None:
    """Return the up direction by the floor, the ceiling and the walls, in the panorama frame.

    Horizontal and vertical surfaces are the majority indoors. The up direction is fitted so that their normals are
    parallel or perpendicular to it. The fit is repeated with smaller tolerances. The camera is assumed to be upright,
    because a camera that hangs upside down shows the same surfaces.

    Args:
        range_m: (H, 2H) range along the ray in metres, NaN where unknown.

    Returns:
        (3,) float64 unit vector at most MAX_TILT_DEG from +z; None if the surfaces do not determine it.
    """
    normal, weight = _surface_normals(_reduced(range_m))
    if not len(normal):
        return None
    up = np.array([0.0, 0.0, 1.0])
    for tolerance in np.radians(TOLERANCES_DEG):
        for _ in range(2):
            cosine = np.abs(normal @ up)
            is_level, is_upright = cosine > np.cos(tolerance), cosine < np.sin(tolerance)
            signed = weight * (is_upright.astype(np.float64) - is_level)
            up = np.linalg.eigh(normal.T * signed @ normal)[1][:, 0]
    up = up if up[2] > 0 else -up
    level_share, upright_share = (weight[rows].sum() / weight.sum() for rows in (is_level, is_upright))
    is_determined = level_share >= MIN_LEVEL_SHARE and level_share + upright_share >= MIN_SURFACE_SHARE
    return up if is_determined and up[2] >= np.cos(np.radians(MAX_TILT_DEG)) else None


def _reduced(range_m: np.ndarray) -> np.ndarray:
    """Return a range image of at most NUM_ROWS rows, float32: the mean of the known ranges of each block."""
    import cv2

    if len(range_m) <= NUM_ROWS:
        return range_m
    is_known = np.isfinite(range_m)
    known_m = np.where(is_known, range_m, np.float32(0))
    total_m, share = (
        cv2.resize(image, (2 * NUM_ROWS, NUM_ROWS), interpolation=cv2.INTER_AREA)
        for image in (known_m, is_known.astype(np.float32))
    )
    return np.where(share > 0.5, total_m / np.maximum(share, 0.5), np.float32(np.nan))


def _surface_normals(range_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the normals (N, 3) of the surfaces at the pixels of a panorama, and their solid angles (N,)."""
    rays = equirectangular_rays(len(range_m))
    points = rays * range_m[..., None]
    along = np.roll(points, -1, 1) - np.roll(points, 1, 1)  # the first and the last column are neighbours
    across = points[2:] - points[:-2]
    normal = np.cross(along[1:-1], across).reshape(-1, 3).astype(np.float64)
    length = np.linalg.norm(normal, axis=1)
    is_known = length > 0  # leaves out NaN too
    weight = np.hypot(rays[1:-1, :, 0], rays[1:-1, :, 1]).ravel()[is_known]
    return normal[is_known] / length[is_known, None], weight


def up_from_lines(ends: np.ndarray) -> np.ndarray | None:
    """Return the up direction by the lines of a room, in the panorama frame.

    Many lines indoors are vertical, or parallel to one of two horizontal axes. The search maximizes the total length of
    the lines along these three axes. The result is then fitted to the vanishing point of the vertical lines. The camera
    is assumed to be upright.

    Args:
        ends: (N, 2, 3) unit vectors to the ends of line segments, as `find_segments` returns them.

    Returns:
        (3,) float64 unit vector at most MAX_TILT_DEG from +z; None if the lines do not determine it.
    """
    normal, length = _lines(ends)
    if len(normal) < MIN_LINES:
        return None
    candidates = _directions(MAX_TILT_DEG, COARSE_DEG)
    support = _axis_support(normal, length, candidates, COARSE_DEG)
    refined: list[tuple[float, np.ndarray, float]] = []
    for _ in range(NUM_RIVALS):
        start = candidates[support.argmax()]
        support[candidates @ start > np.cos(np.radians(SEPARATE_DEG))] = -np.inf
        nearby = _directions(COARSE_DEG, FINE_DEG) @ level_rotation(start)
        start = nearby[_axis_support(normal, length, nearby, FINE_DEG).argmax()]
        up, spread = _fit_vertical(normal, length, start)
        if up[2] >= np.cos(np.radians(MAX_TILT_DEG)):  # a fit to few lines may end at another axis of the room
            refined.append((float(_axis_support(normal, length, up[None], FINE_DEG)[0]), up, spread))
    if not refined:
        return None
    total, up, spread = max(refined, key=lambda item: item[0])
    rivals = [other for other, direction, _ in refined if direction @ up < np.cos(np.radians(SEPARATE_DEG))]
    is_determined = total >= max(MIN_LINES_SHARE * length.sum(), MIN_LINES_RATIO * max(rivals, default=0.0))
    return up if is_determined and spread >= MIN_SPREAD else None


def level_rotation(up: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) float64 that turns a direction (3,) to +z. It is about x for -z."""
    from scipy.spatial.transform import Rotation

    axis = np.array([up[1], -up[0], 0.0])
    sine = np.hypot(up[0], up[1])
    axis = axis / sine if sine > 1e-12 else np.array([1.0, 0.0, 0.0])
    rotation: np.ndarray = Rotation.from_rotvec(axis * np.arctan2(sine, up[2])).as_matrix()
    return rotation


def _lines(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the normals (N, 3) of the planes through the longest lines and the camera, and their lengths (N,)."""
    normal = np.cross(ends[:, 0], ends[:, 1])
    sine = np.linalg.norm(normal, axis=1)
    length = np.arctan2(sine, (ends[:, 0] * ends[:, 1]).sum(1))
    longest = np.argsort(-length, kind="stable")[:MAX_LINES]
    longest = longest[sine[longest] > 0]
    return normal[longest] / sine[longest, None], length[longest]


def _axis_support(normal: np.ndarray, length: np.ndarray, up: np.ndarray, tolerance_deg: float) -> np.ndarray:
    """Return the total length (C,) of the lines along the axes of a room, for each up direction (C, 3).

    The two horizontal axes are at the peak of a histogram of azimuths modulo 90 degrees, with bins of the tolerance.
    """
    first = np.cross([0.0, 1.0, 0.0], up)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    along, across, upward = (normal @ axes.T for axes in (first, np.cross(up, first), up))
    vertical = length @ (np.abs(upward) < np.sin(np.radians(tolerance_deg)))
    is_certain = np.abs(upward) > np.sin(np.radians(LEVEL_LINE_DEG))
    votes = np.where(is_certain, np.hypot(along, across), 0) * length[:, None]
    count = round(90 / tolerance_deg)
    bins = (np.arctan2(along, -across) % (np.pi / 2) * (2 * count / np.pi)).astype(int) % count
    bins += count * np.arange(len(up))
    azimuths = np.bincount(bins.ravel(), votes.ravel(), count * len(up)).reshape(-1, count)
    smooth = azimuths + 0.5 * (np.roll(azimuths, 1, 1) + np.roll(azimuths, -1, 1))
    support: np.ndarray = vertical + smooth.max(1)
    return support


def _fit_vertical(normal: np.ndarray, length: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the vanishing point (3,) of the vertical lines, and the share of vertical lines on walls at a right angle
    to the walls of the other vertical lines."""
    spread = 0.0
    for tolerance_deg in FIT_TOLERANCES_DEG:
        is_vertical = np.abs(normal @ up) < np.sin(np.radians(tolerance_deg))
        if not is_vertical.any():
            return up, 0.0
        weights, axes = np.linalg.eigh(normal[is_vertical].T * length[is_vertical] @ normal[is_vertical])
        up, spread = axes[:, 0] * (1 if axes[2, 0] > 0 else -1), float(weights[1] / weights.sum())
    return up, spread


@lru_cache(maxsize=2)
def _directions(max_deg: float, step_deg: float) -> np.ndarray:
    """Return directions (C, 3) at most max_deg from +z, in rings at equal distances."""
    rings = [np.array([[0.0, 0.0, 1.0]])]
    for tilt in np.radians(np.arange(step_deg, max_deg + step_deg / 2, step_deg)):
        count = int(np.ceil(2 * np.pi * np.sin(tilt) / np.radians(step_deg)))
        azimuth = 2 * np.pi * np.arange(count) / count
        ring = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.full(count, np.cos(tilt))]
        rings.append(np.column_stack(ring))
    directions = np.concatenate(rings)
    directions.flags.writeable = False
    return directions
