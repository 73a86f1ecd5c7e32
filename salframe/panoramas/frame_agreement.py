"""Check whether the range images of reference frames agree under their poses, with the points of pairs of frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from salframe.panoramas.geometry import equirectangular_rays, invert_pose, rays_to_pixels, row_elevation

NUM_ROWS = 90
"""Rows of the reduced range image: 2 deg per pixel."""
MAX_ELEVATION_DEG = 25.0
"""Maximum elevation of the compared points. Points beyond it are on floor and ceiling, which agree under every
horizontal motion."""
COLUMN_STEP, ROW_STEP = 2, 3
"""Steps between the compared points, in pixels of the reduced image."""


@dataclass(frozen=True)
class Tolerance:
    """Maximum difference of ranges that agree.

    Attributes:
        relative: Part of the tolerance that is proportional to the range of the point.
        offset: Part of the tolerance that is proportional to the median range of the frame.
    """

    relative: float = 0.05
    offset: float = 0.04


class RangeView:
    """A reduced range image, for comparisons with others.

    Attributes:
        points: (N, 3) float64 points near the horizon, in the panorama frame and the unit of the ranges.
        median: Median range of these points; NaN without points.
    """

    def __init__(self, range_m: np.ndarray) -> None:
        """Downsample a range image (H, 2H); values that are not finite or not positive are unknown."""
        full = len(range_m)
        height = min(full, NUM_ROWS)
        rows, columns = (((np.arange(n) + 0.5) * full / height).astype(int) for n in (height, 2 * height))
        reduced = range_m[np.ix_(rows, columns)].astype(np.float64)
        is_known = np.isfinite(reduced) & (reduced > 0)
        # Minimum and maximum of 3 x 3 pixels, so that the edge of an object is no contradiction.
        self._min = minimum_filter(np.where(is_known, reduced, np.inf), 3, mode=("nearest", "wrap"))
        self._max = maximum_filter(np.where(is_known, reduced, -np.inf), 3, mode=("nearest", "wrap"))
        near_horizon = np.abs(row_elevation(height)) <= np.radians(MAX_ELEVATION_DEG)
        selected = np.zeros((height, 2 * height), bool)
        selected[np.flatnonzero(near_horizon)[::ROW_STEP], ::COLUMN_STEP] = True
        selected &= is_known
        rays = equirectangular_rays(full)[np.ix_(rows, columns)][selected]
        self.points = rays.astype(np.float64) * reduced[selected][:, None]
        self.median = float(np.median(reduced[selected])) if selected.any() else np.nan

    def compare(self, points: np.ndarray, tolerance: Tolerance) -> tuple[float, float]:
        """Compare points with the surfaces that this frame sees.

        Args:
            points: (N, 3) points of another frame, in the coordinates of this frame.
            tolerance: Maximum difference of ranges.

        Returns:
            The share of points on a surface that this frame sees, and the share of points in front of such a surface,
            where this frame sees free space. Other points are hidden behind a surface, or the range is unknown there.
        """
        if not len(points):
            return 0.0, 0.0
        distance = np.linalg.norm(points, axis=1)
        columns, rows = rays_to_pixels(points, len(self._min))
        at = np.minimum(rows.astype(int), len(self._min) - 1), columns.astype(int) % (2 * len(self._min))
        nearest, farthest, offset = self._min[at], self._max[at], tolerance.offset * self.median
        is_known = np.isfinite(nearest) & np.isfinite(farthest)
        in_free_space = is_known & (distance < nearest * (1 - tolerance.relative) - offset)
        hidden = is_known & (distance > farthest * (1 + tolerance.relative) + offset)
        return float((is_known & ~in_free_space & ~hidden).mean()), float(in_free_space.mean())


@dataclass(frozen=True)
class Agreement:
    """Comparison of pairs of frames.

    Attributes:
        on_surface: Mean share of the points of one frame that lie on a surface that the other frame sees.
        in_free_space: Mean share of the points of one frame that lie where the other frame sees free space.
    """

    on_surface: float
    in_free_space: float

    @property
    def evidence(self) -> float:
        """Share of the points that either agree with the poses or contradict them."""
        return self.on_surface + self.in_free_space

    @property
    def net(self) -> float:
        """Share of the points that agree, minus the share that contradicts."""
        return self.on_surface - self.in_free_space

    @property
    def ratio(self) -> float:
        """Share that agrees, among the points that agree or contradict, from 0 to 1; 0 without such points."""
        return self.on_surface / self.evidence if self.evidence > 0 else 0.0


DEFAULT_TOLERANCE = Tolerance()


def pair_agreements(
    views: Sequence[RangeView],
    poses: Sequence[np.ndarray],
    pairs: Iterable[tuple[int, int]],
    tolerance: Tolerance = DEFAULT_TOLERANCE,
) -> list[Agreement]:
    """Compare the range images of pairs of frames, in both directions.

    Args:
        views: The frames.
        poses: (4, 4) pose of each frame, in the unit of the ranges.
        pairs: Indices of the two frames of each pair.
        tolerance: Maximum difference of ranges.

    Returns:
        The comparison of each pair.
    """
    compared = []
    for first, second in pairs:
        motion = invert_pose(poses[second]) @ poses[first]
        directions = ((first, second, motion), (second, first, invert_pose(motion)))
        shares = [
            views[target].compare(views[source].points @ T[:3, :3].T + T[:3, 3], tolerance)
            for source, target, T in directions
        ]
        compared.append(mean_agreement(Agreement(*share) for share in shares))
    return compared


def mean_agreement(agreements: Iterable[Agreement]) -> Agreement:
    """Return the mean of comparisons. Both shares are 0 if there are none."""
    shares = [(one.on_surface, one.in_free_space) for one in agreements]
    on_surface, in_free_space = np.mean(shares, axis=0) if shares else (0.0, 0.0)
    return Agreement(float(on_surface), float(in_free_space))


def nearest_pairs(places: Sequence[str], positions: np.ndarray) -> list[tuple[int, int]]:
    """Return the indices of pairs of frames that probably see the same surfaces.

    Each frame is paired with the nearest frame of its place. If its place has no other frame, it is paired with the
    nearest frame of all.

    Args:
        places: Place of each of N frames.
        positions: (N, 3) positions.
    """
    pairs = set()
    names = np.array(places)
    for index, position in enumerate(positions):
        distance = np.linalg.norm(positions - position, axis=1)
        distance[index] = np.inf
        same = names == names[index]
        same[index] = False
        if same.any():
            distance[~same] = np.inf
        partner = int(distance.argmin())
        if np.isfinite(distance[partner]):
            pairs.add((min(index, partner), max(index, partner)))
    return sorted(pairs)
