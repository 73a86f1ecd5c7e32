"""Perspective views of an equirectangular panorama: cut views, convert between pixels and bearings, compare views."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from salframe.panoramas.geometry import rays_to_pixels


@dataclass(frozen=True)
class ViewRig:
    """A ring of pinhole views with equal spacing in azimuth. The first looks along +x, the others follow
    counter-clockwise.

    Pixel centres are at +0.5, as in salframe.panoramas.geometry; the principal point is at the centre of the image.

    Attributes:
        count: Number V of views.
        width_px: Width of a view.
        height_px: Height of a view.
        hfov_rad: Horizontal field of view.
        elevation_rad: Elevation of the optical axes.
    """

    count: int
    width_px: int
    height_px: int
    hfov_rad: float
    elevation_rad: float = 0.0

    @property
    def focal_px(self) -> float:
        """Focal length of each view in pixels."""
        return self.width_px / 2 / np.tan(self.hfov_rad / 2)

    @cached_property
    def rotations(self) -> np.ndarray:
        """Rotations from camera axes (x right, y down, z forward) to the panorama frame, (V, 3, 3) float64."""
        azimuth = 2 * np.pi * np.arange(self.count) / self.count
        c, s, zero = np.cos(azimuth), np.sin(azimuth), np.zeros(self.count)
        level, up = np.cos(self.elevation_rad), np.sin(self.elevation_rad)
        right, down, forward = (s, -c, zero), (c * up, s * up, zero - level), (c * level, s * level, zero + up)
        return np.array([right, down, forward]).transpose(2, 1, 0)

    def bearings(self, view: int, pixels: np.ndarray) -> np.ndarray:
        """Return unit vectors through pixels of one view, in the panorama frame.

        Args:
            view: Index of the view.
            pixels: (K, 2) pixels, x then y.

        Returns:
            (K, 3) float64.
        """
        rays = np.ones((len(pixels), 3))
        rays[:, :2] = (np.asarray(pixels, np.float64) - (self.width_px / 2, self.height_px / 2)) / self.focal_px
        return (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ self.rotations[view].T

    def project(self, bearings: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray]:
        """Project bearings to one view.

        Args:
            bearings: (K, 3) directions in the panorama frame.
            view: Index of the view.

        Returns:
            (K, 2) float64 pixels, x then y, and (K,) bool, whether the view shows each bearing. The pixels of bearings
            outside the view are undefined.
        """
        local = bearings @ self.rotations[view]
        ahead = local[:, 2] > 1e-6
        pixels = local[:, :2] / np.where(ahead, local[:, 2], 1)[:, None] * self.focal_px
        pixels += self.width_px / 2, self.height_px / 2
        return pixels, ahead & ((pixels >= 0) & (pixels < (self.width_px, self.height_px))).all(1)

    def cut(self, image: np.ndarray) -> np.ndarray:
        """Return the views of an equirectangular uint8 image (H, 2H, C), bilinear: (V, height, width, C) uint8."""
        import cv2

        # Average an image of more than twice the resolution of the views first, to avoid aliasing.
        if image.shape[0] * self.hfov_rad / np.pi > 2 * self.width_px:
            height = round(self.width_px * np.pi / self.hfov_rad)
            image = cv2.resize(image, (2 * height, height), interpolation=cv2.INTER_AREA)
        columns, rows = _sampling(self, image.shape[0])
        return np.stack(
            [
                cv2.remap(image, columns[view], rows[view], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
                for view in range(self.count)
            ]
        )


@lru_cache(maxsize=4)
def _sampling(rig: ViewRig, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns and rows in a panorama of all pixels of the views, (V, height_px, width_px) float32 each.

    Pixel centres are at 0, the convention of OpenCV.
    """
    y, x = np.mgrid[: rig.height_px, : rig.width_px] + 0.5
    pixels = np.stack([x.ravel(), y.ravel()], 1)
    rays = np.stack([rig.bearings(view, pixels) for view in range(rig.count)])
    columns, rows = rays_to_pixels(rays.reshape(rig.count, rig.height_px, rig.width_px, 3), height)
    return (columns - 0.5).astype(np.float32), np.clip(rows - 0.5, 0, height - 1).astype(np.float32)


def turned_similarity(query: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the similarity of a query to each reference frame, for each rotation of the camera by whole views.

    The similarity is the mean cosine between view i of the query and view i + turn of the reference frame. Both
    panoramas must be upright, so that all views share one rotation.

    Args:
        query: (V, G) features of the views, of unit length; zeros for a view that shows nothing.
        reference: (F, V, G) features of F reference frames.

    Returns:
        (F, V) similarities at rotations by 0 to V - 1 views.
    """
    count = len(query)
    cosines = np.einsum("ig,fjg->fij", query, reference)
    view = np.arange(count)
    return np.stack([cosines[:, view, (view + turn) % count].mean(1) for turn in range(count)], 1)
