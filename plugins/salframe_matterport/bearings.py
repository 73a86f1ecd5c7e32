"""Conversion of an object's boxes in the 36 views of a viewpoint to one bearing and angular size.

Directions are in the world frame, z up. The views are those of the Matterport3D Simulator: 640 x 480 pixels, vertical
field of view 60 deg. View i looks at heading 30 deg (i mod 12), clockwise from world +y, and elevation 30 deg (i div 12
- 1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

VIEWS = 36
VIEW_WIDTH_PX, VIEW_HEIGHT_PX = 640, 480
FOCAL_PX = VIEW_HEIGHT_PX / 2 / np.tan(np.pi / 6)
SAMPLES = 8
"""Number of rays sampled along each side of a box, ends included. More rays change neither bearings nor triangulated
positions."""
SLACK_PX = 2.0
"""Tolerance of a box border in pixels. Boxes have integer coordinates in views that are 30 deg apart."""


class Bearing(NamedTuple):
    """Direction and angular size of an object.

    Attributes:
        azimuth_rad: Azimuth of the object's centre, counter-clockwise from +x.
        elevation_rad: Elevation of the object's centre.
        width_rad: Horizontal angle that the object subtends.
        height_rad: Vertical angle that the object subtends.
    """

    azimuth_rad: float
    elevation_rad: float
    width_rad: float
    height_rad: float


def _view_axes() -> np.ndarray:
    """Return the right, down and forward axes of each view as rows (36, 3, 3), in the world frame."""
    view = np.arange(VIEWS)
    heading, elevation = np.radians(30 * (view % 12)), np.radians(30 * (view // 12 - 1))
    zero = np.zeros(VIEWS)
    right = np.stack([np.cos(heading), -np.sin(heading), zero], 1)
    forward = np.stack([np.cos(elevation) * np.sin(heading), np.cos(elevation) * np.cos(heading), np.sin(elevation)], 1)
    return np.stack([right, np.cross(forward, right), forward], 1)


_AXES = _view_axes()


def direction(azimuth_rad, elevation_rad) -> np.ndarray:
    """Return the unit vectors (..., 3) with these azimuths and elevations."""
    return np.stack(
        [
            np.cos(elevation_rad) * np.cos(azimuth_rad),
            np.cos(elevation_rad) * np.sin(azimuth_rad),
            np.sin(elevation_rad),
        ],
        -1,
    )


def project(rays: np.ndarray, view: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Project world directions (N, 3) into views (K,).

    Returns:
        Columns (K, N) and rows (K, N) in pixels, and whether each direction is in the view, (K, N) bool.
    """
    right, down, forward = np.moveaxis(_AXES[view] @ rays.T, 1, 0)
    ahead = forward > 1e-6
    depth = np.where(ahead, forward, 1.0)
    column, row = VIEW_WIDTH_PX / 2 + FOCAL_PX * right / depth, VIEW_HEIGHT_PX / 2 + FOCAL_PX * down / depth
    return column, row, ahead & (column >= 0) & (column <= VIEW_WIDTH_PX) & (row >= 0) & (row <= VIEW_HEIGHT_PX)


def bearing(view: np.ndarray, box_px: np.ndarray) -> Bearing:
    """Combine the boxes of an object in several views to one bearing.

    A direction is excluded if it is inside a view but outside the object's box in that view. The neighbouring views
    therefore complete a box that is cut by the border of a view, and tighten a box that is enlarged by perspective. The
    bearing is the mean of the remaining directions, weighted by solid angle.

    Args:
        view: Indices (K,) of the views that show the object.
        box_px: Boxes (K, 4) in these views: x, y, width, height in pixels.
    """
    left, top, width, height = np.maximum(np.asarray(box_px, float), [0, 0, 1, 1]).T
    steps = np.linspace(0, 1, SAMPLES)
    grid_x, grid_y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    x = (left[:, None] + width[:, None] * grid_x) - VIEW_WIDTH_PX / 2
    y = (top[:, None] + height[:, None] * grid_y) - VIEW_HEIGHT_PX / 2
    local = np.stack([x, y, np.full_like(x, FOCAL_PX)], -1)
    length = np.linalg.norm(local, axis=-1, keepdims=True)
    rays = (local / length @ _AXES[view]).reshape(-1, 3)
    solid_angle = ((width * height)[:, None] / length[..., 0] ** 3).ravel()

    column, row, in_view = project(rays, view)
    beyond_x = np.maximum(left[:, None] - column, column - (left + width)[:, None])
    beyond_y = np.maximum(top[:, None] - row, row - (top + height)[:, None])
    beyond = np.maximum(beyond_x, beyond_y)
    excluded = (in_view & (beyond > SLACK_PX)).sum(0)
    consistent = excluded == excluded.min()
    # Boxes overlap: a direction sampled from several of them counts only once.
    sampled = (in_view & (beyond <= SLACK_PX)).sum(0)
    weights = solid_angle[consistent] / np.maximum(sampled[consistent], 1)
    rays = rays[consistent]

    mean = weights @ rays
    azimuth, elevation = np.arctan2(mean[1], mean[0]), np.arctan2(mean[2], np.hypot(mean[0], mean[1]))
    forward = direction(azimuth, elevation)
    to_left = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    across = np.arctan2(rays @ to_left, rays @ forward)
    along = np.arctan2(rays @ np.cross(forward, to_left), rays @ forward)
    return Bearing(float(azimuth), float(elevation), float(np.ptp(across)), float(np.ptp(along)))
