"""Perspective views of an equirectangular panorama, the way back from their pixels to bearings, and how two sets of
them compare."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from salframe.panoramas.geometry import rays_to_pixels


@dataclass(frozen=True)
class ViewRig:
    """A ring of `count` pinhole views, equally spaced in azimuth and all looking up by elevation_rad; the first looks
    along +x, the others follow counter-clockwise.

    Pixel centres lie at +0.5 and the principal point in the image's centre, as in salframe.panoramas.geometry.
    """

    count: int
    width_px: int
    height_px: int
    hfov_rad: float
    elevation_rad: float = 0.0

    @property
    def focal_px(self) -> float:
        """Focal length of every view."""
        return self.width_px / 2 / np.tan(self.hfov_rad / 2)

    @cached_property
    def rotations(self) -> np.ndarray:
        """(V, 3, 3) float64 from camera axes (x right, y down, z forward) to the panorama frame."""
        azimuth = 2 * np.pi * np.arange(self.count) / self.count
        c, s, zero = np.cos(azimuth), np.sin(azimuth), np.zeros(self.count)
        level, up = np.cos(self.elevation_rad), np.sin(self.elevation_rad)
        right, down, forward = (s, -c, zero), (c * up, s * up, zero - level), (c * level, s * level, zero + up)
        return np.array([right, down, forward]).transpose(2, 1, 0)

    def bearings(self, view: int, pixels: np.ndarray) -> np.ndarray:
        """(K, 3) float64 unit vectors in the panorama frame through the pixels (K, 2), x then y, of one view."""
        rays = np.ones((len(pixels), 3))
        rays[:, :2] = (np.asarray(pixels, np.float64) - (self.width_px / 2, self.height_px / 2)) / self.focal_px
        return (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ self.rotations[view].T

    def project(self, bearings: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray]:
        """Where bearings (K, 3) in the panorama frame fall on one view: pixels (K, 2) float64, x then y, and (K,) bool
        whether the view shows them; the pixels of those that it does not show mean nothing."""
        local = bearings @ self.rotations[view]
        ahead = local[:, 2] > 1e-6
        pixels = local[:, :2] / np.where(ahead, local[:, 2], 1)[:, None] * self.focal_px
        pixels += self.width_px / 2, self.height_px / 2
        return pixels, ahead & ((pixels >= 0) & (pixels < (self.width_px, self.height_px))).all(1)

    def cut(self, image: np.ndarray) -> np.ndarray:
        """(V, height, width, C) views of an equirectangular uint8 image (H, 2H, C), bilinear."""
        import cv2

        if (
            image.shape[0] * self.hfov_rad / np.pi > 2 * self.width_px
        ):  # far finer than the views: average first, or they alias
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
    """(V, height_px, width_px) float32 columns and rows in a panorama of this height, in OpenCV's convention (centres
    at 0)."""
    y, x = np.mgrid[: rig.height_px, : rig.width_px] + 0.5
    pixels = np.stack([x.ravel(), y.ravel()], 1)
    rays = np.stack([rig.bearings(view, pixels) for view in range(rig.count)])
    columns, rows = rays_to_pixels(rays.reshape(rig.count, rig.height_px, rig.width_px, 3), height)
    return (columns - 0.5).astype(np.float32), np.clip(rows - 0.5, 0, height - 1).astype(np.float32)


def turned_similarity(query: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(F, V) float: how alike a query's views (V, G) are to those of each reference frame (F, V, G) when turned by 0 to V - 1
    views.

    G values a view, of unit length, or zeros where it shows nothing. The mean cosine over query view i and map view i +
    turn: both panoramas are upright, so one turn serves all views.
    """
    count = len(query)
    cosines = np.einsum("ig,fjg->fij", query, reference)
    view = np.arange(count)
    return np.stack([cosines[:, view, (view + turn) % count].mean(1) for turn in range(count)], 1)
