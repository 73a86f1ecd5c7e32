"""From the boxes of an object in the 36 views of a viewpoint to one bearing and its angular size.

Directions are in the world frame, z up. The views are those of the Matterport3D Simulator: 640 x 480 pixels, vertical
field of view 60 deg, view i looks at heading 30 deg (i mod 12), clockwise from world +y, and elevation 30 deg (i div 12
- 1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

VIEWS = 36
VIEW_WIDTH_PX, VIEW_HEIGHT_PX = 640, 480
FOCAL_PX = VIEW_HEIGHT_PX / 2 / np.tan(np.pi / 6)
SAMPLES = 8
"""Sampled rays along a side of a box, ends included: more change neither the bearings nor what is triangulated from
them."""
SLACK_PX = 2.0
"""Boxes are whole pixels in views that are 30 deg apart: a border may be off by this much."""


class Bearing(NamedTuple):
    """Where an object is seen: azimuth_rad (counter-clockwise from +x) and elevation_rad of its middle, and the angles
    it spans across."""

    azimuth_rad: float
    elevation_rad: float
    width_rad: float
    height_rad: float


def _view_axes() -> np.ndarray:
    """(36, 3, 3) rows right, down and forward of each view, in the world frame."""
    view = np.arange(VIEWS)
    heading, elevation = np.radians(30 * (view % 12)), np.radians(30 * (view // 12 - 1))
    zero = np.zeros(VIEWS)
    right = np.stack([np.cos(heading), -np.sin(heading), zero], 1)
    forward = np.stack([np.cos(elevation) * np.sin(heading), np.cos(elevation) * np.cos(heading), np.sin(elevation)], 1)
    return np.stack([right, np.cross(forward, right), forward], 1)


_AXES = _view_axes()


def direction(azimuth_rad, elevation_rad) -> np.ndarray:
    """(..., 3) unit vectors towards bearings."""
    return np.stack(
        [
            np.cos(elevation_rad) * np.cos(azimuth_rad),
            np.cos(elevation_rad) * np.sin(azimuth_rad),
            np.sin(elevation_rad),
        ],
        -1,
    )


def project(rays: np.ndarray, view: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixel columns, rows (K, N) of world directions (N, 3) in views (K,), and which of them fall inside the view."""
    right, down, forward = np.moveaxis(_AXES[view] @ rays.T, 1, 0)
    ahead = forward > 1e-6
    depth = np.where(ahead, forward, 1.0)
    column, row = VIEW_WIDTH_PX / 2 + FOCAL_PX * right / depth, VIEW_HEIGHT_PX / 2 + FOCAL_PX * down / depth
    return column, row, ahead & (column >= 0) & (column <= VIEW_WIDTH_PX) & (row >= 0) & (row <= VIEW_HEIGHT_PX)


def bearing(view: np.ndarray, box_px: np.ndarray) -> Bearing:
    """Join an object's boxes: it lies in the directions that no view denies.

    view (K,) indices of the views that see it, box_px (K, 4) x, y, width, height in them. A direction inside a view and
    outside the object's box there is denied, so a box that a view's border cuts is completed by the neighbouring views,
    and a box loosened by perspective is tightened by them. The bearing is the mean direction by solid angle.
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
    denied = (in_view & (beyond > SLACK_PX)).sum(0)
    kept = denied == denied.min()
    # Boxes overlap: a direction sampled from several of them counts once.
    sampled = (in_view & (beyond <= SLACK_PX)).sum(0)
    weights = solid_angle[kept] / np.maximum(sampled[kept], 1)
    rays = rays[kept]

    mean = weights @ rays
    azimuth, elevation = np.arctan2(mean[1], mean[0]), np.arctan2(mean[2], np.hypot(mean[0], mean[1]))
    forward = direction(azimuth, elevation)
    to_left = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    across = np.arctan2(rays @ to_left, rays @ forward)
    along = np.arctan2(rays @ np.cross(forward, to_left), rays @ forward)
    return Bearing(float(azimuth), float(elevation), float(np.ptp(across)), float(np.ptp(along)))
