"""Overlapping views of a panorama (horizontal, down and up), and projection of rays into them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.panoramas.perspective import ViewRig

TILTED, TILT_RAD = 4, np.pi / 3
"""Number of views that look down, which is also the number of views that look up, and the tilt of these views.
Horizontal views alone may not show the floor. A table top may then be mistaken for the floor: in a rendered kitchen,
all ranges were too large by a factor of two."""
MIN_VIEWS, MIN_FOV_DEG = 6, 75
"""Minimum number of horizontal views and minimum field of view. Below them, some directions are in no view."""


@dataclass(frozen=True)
class DepthRig(ViewRig):
    """Set of `count` views: horizontal views as in ViewRig, and tilted views.

    The constant TILTED is the number of views that look down, and also the number of views that look up.
    """

    @classmethod
    def around(cls, level: int, width_px: int, height_px: int, fov_rad: float) -> DepthRig:
        """Create `level` horizontal views and all tilted views.

        Args:
            level: Number of horizontal views.
            width_px: Width of a view.
            height_px: Height of a view.
            fov_rad: Field of view across the shorter side of a view.
        """
        hfov_rad = 2 * np.arctan(np.tan(fov_rad / 2) * width_px / min(width_px, height_px))
        return cls(level + 2 * TILTED, width_px, height_px, float(hfov_rad))

    @cached_property
    def rotations(self) -> np.ndarray:
        """Rotations (V, 3, 3) float64 from camera axes (x right, y down, z forward) to the panorama frame."""
        rings = ((self.count - 2 * TILTED, 0.0), (TILTED, -TILT_RAD), (TILTED, TILT_RAD))
        azimuth = np.concatenate([2 * np.pi * np.arange(views) / views for views, _ in rings])
        elevation = np.repeat([tilt for _, tilt in rings], [views for views, _ in rings])
        c, s, level, up = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
        right, forward = np.stack([s, -c, np.zeros(self.count)]), np.stack([level * c, level * s, up])
        return np.stack([right, np.cross(forward, right, axis=0), forward]).transpose(2, 1, 0)

    def project_rays(self, view: int, rays: np.ndarray) -> ViewRays:
        """Project unit vectors (..., 3) in the panorama frame into a view."""
        right, down, forward = np.moveaxis(rays @ self.rotations[view].astype(np.float32), -1, 0)
        ahead = np.maximum(forward, np.float32(1e-6))
        x = np.float32(2 * self.focal_px / self.width_px) * right / ahead
        y = np.float32(2 * self.focal_px / self.height_px) * down / ahead
        weight = np.maximum(1 - np.abs(x), 0) * np.maximum(1 - np.abs(y), 0)
        return ViewRays(x, y, np.where(forward > 0, weight, np.float32(0)), ahead)


@dataclass(frozen=True, eq=False)
class ViewRays:
    """Positions of rays (...) in a view, all float32.

    Attributes:
        x: Horizontal image coordinate, from -1 to 1 across the view.
        y: Vertical image coordinate, from -1 to 1 across the view.
        weight: 1 at the centre of the view, 0 at its border and beyond.
        cosine: Cosine of the angle between ray and view axis.
    """

    x: np.ndarray
    y: np.ndarray
    weight: np.ndarray
    cosine: np.ndarray

    def sample(self, image: np.ndarray) -> np.ndarray:
        """Return the values of an image (h, w) of this view at the stored rays, by bilinear interpolation.

        Returns:
            (...) float32, NaN outside the view.
        """
        import cv2

        height, width = image.shape
        columns, rows = (self.x + 1) * (width / 2) - 0.5, (self.y + 1) * (height / 2) - 0.5
        values = cv2.remap(
            image,
            columns.astype(np.float32),
            rows.astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.where(self.weight > 0, values, np.float32(np.nan))
