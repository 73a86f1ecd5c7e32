"""Overlapping perspective views that cover the sphere, and where on the panorama their pixels lie."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels

RINGS = ((8, 0.0), (4, np.pi / 3), (4, -np.pi / 3))
"""Views in each ring and the ring's elevation_rad: around the horizon, up and down. The views of a ring are equally
spaced, the first looks along +x, the others follow counter-clockwise. All repeat every quarter turn."""
MIN_FOV_DEG = 75
"""With a smaller field of view some directions are in no view."""
GRID_ROWS = 256
"""The panorama's pixels are thinned to about this many rows where boxes are laid on it: 0.7 deg a pixel, finer than
boxes are."""


@dataclass(frozen=True)
class Rig:
    """Pinhole views of width_px x height_px; fov_rad is the field of view across the shorter side.

    Pixel centres lie at +0.5 and the principal point in the image's centre, as in salframe.geometry. Every view of a
    ring is the first one, taken of the panorama turned by whole columns: turning the panorama by as much gives the same
    pixels, bit for bit.
    """

    width_px: int
    height_px: int
    fov_rad: float

    @property
    def focal_px(self) -> float:
        """Focal length of every view."""
        return min(self.width_px, self.height_px) / 2 / np.tan(self.fov_rad / 2)

    def cut(self, image: np.ndarray) -> np.ndarray:
        """(V, height_px, width_px, 3) uint8 views of an equirectangular uint8 image (H, 2H, 3), bilinear."""
        import cv2

        # Far finer than the views: average first, or they alias. Of a height divisible by four quarter turns stay whole
        # columns.
        rows = 4 * round(self.focal_px * np.pi / 4)
        if image.shape[0] > 2 * rows:
            image = cv2.resize(image, (2 * rows, rows), interpolation=cv2.INTER_AREA)
        height, width = image.shape[:2]
        twice, views = np.hstack([image, image]), []
        for (columns, sampled_rows), (count, _) in zip(_sampling(self, height), RINGS, strict=True):
            for turned in range(count):
                seen = twice[:, width - _shift(turned, count, width) :][:, :width]
                views.append(cv2.remap(seen, columns, sampled_rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))
        return np.stack(views)

    def cuts(self, box_px: np.ndarray) -> np.ndarray:
        """(n,) bool: boxes (n, 4) within a pixel of their view's border, where the view may cut the object."""
        last_px = self.width_px - 1, self.height_px - 1
        return np.any(np.hstack([box_px[:, :2] < 1, box_px[:, 2:] > last_px]), axis=1)

    def grid(self, height: int) -> Grid:
        """Where the thinned pixels of a panorama of this height lie in the views."""
        return _grid(self, height)


@dataclass(frozen=True, eq=False)
class Grid:
    """Every `step`-th pixel of a panorama, P = rows * columns of them, and where they lie in the views.

    rays (P, 3) float32 unit vectors in the panorama frame; solid_angle_sr (P,) float64; seen (V, P) bool, the pixels
    that a view shows. pixel, x_px, y_px: for each ring, the grid pixels that its first view shows and where, float32.
    """

    step: int
    shape: tuple[int, int]
    rays: np.ndarray
    solid_angle_sr: np.ndarray
    seen: np.ndarray
    pixel: tuple[np.ndarray, ...]
    x_px: tuple[np.ndarray, ...]
    y_px: tuple[np.ndarray, ...]

    def thin(self, image: np.ndarray) -> np.ndarray:
        """(P, ...) values of a panorama's image (H, 2H, ...) at the grid's pixels."""
        return np.reshape(image[:: self.step, :: self.step], (self.shape[0] * self.shape[1], *image.shape[2:]))

    def footprint(self, view: int, box_px: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """(P,) bool: the grid's pixels inside a box (left, top, right, bottom) of a view, and inside its mask (height,
        width) if any."""
        ring, turned = ring_of(view)
        x, y = self.x_px[ring], self.y_px[ring]
        inside = (x >= box_px[0]) & (x <= box_px[2]) & (y >= box_px[1]) & (y <= box_px[3])
        if mask is not None:
            inside[inside] = mask[y[inside].astype(int), x[inside].astype(int)]
        marked = np.zeros(self.shape[0] * self.shape[1], bool)
        marked[self.pixel[ring][inside]] = True
        return _turn(marked, self.shape, turned, RINGS[ring][0])


def ring_of(view: int) -> tuple[int, int]:
    """The ring of a view and its position in it."""
    for ring, end in enumerate(accumulate(count for count, _ in RINGS)):
        if view < end:
            return ring, view - end + RINGS[ring][0]
    raise IndexError(view)


def _shift(turned: int, count: int, width: int) -> int:
    """Columns to roll a panorama to the right by, so that the first of `count` views sees what the view at position
    `turned` saw."""
    return round(turned * width / count)


def _turn(marked: np.ndarray, shape: tuple[int, int], turned: int, count: int) -> np.ndarray:
    """The grid's pixels (P,) that the first of `count` views marks, brought to where the view at position `turned`
    marks them."""
    return np.roll(marked.reshape(shape), -_shift(turned, count, shape[1]), axis=1).ravel()


def _axes(elevation_rad: float) -> np.ndarray:
    """(3, 3) rows right, down and forward, in the panorama frame, of a view that looks along azimuth 0 and this
    elevation."""
    c, s = np.cos(elevation_rad), np.sin(elevation_rad)
    return np.array([[0, -1, 0], [s, 0, -c], [c, 0, s]])


@lru_cache(maxsize=4)
def _sampling(rig: Rig, height: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """For the first view of each ring, the (height_px, width_px) float32 columns and rows it is sampled at, in OpenCV's
    pixels."""
    y, x = np.mgrid[: rig.height_px, : rig.width_px] + 0.5
    local = np.stack(
        [(x - rig.width_px / 2) / rig.focal_px, (y - rig.height_px / 2) / rig.focal_px, np.ones_like(x)], -1
    )
    maps = []
    for _, elevation_rad in RINGS:
        columns, rows = rays_to_pixels(local @ _axes(elevation_rad), height)
        maps.append(((columns - 0.5).astype(np.float32), np.clip(rows - 0.5, 0, height - 1).astype(np.float32)))
    return maps


@lru_cache(maxsize=4)
def _grid(rig: Rig, height: int) -> Grid:
    step = max(1, round(height / GRID_ROWS))
    rays = equirectangular_rays(height)[::step, ::step]
    shape = rays.shape[:2]
    rays = rays.reshape(-1, 3)
    pixel_sr = 2 * np.pi**2 / (shape[0] * shape[1])
    solid_angle_sr = pixel_sr * np.hypot(rays[:, 0], rays[:, 1]).astype(np.float64)
    pixels, xs, ys, seen = [], [], [], []
    for count, elevation_rad in RINGS:
        right, down, forward = _axes(elevation_rad).astype(np.float32) @ rays.T
        ahead = np.maximum(forward, np.float32(1e-6))
        x, y = rig.width_px / 2 + rig.focal_px * right / ahead, rig.height_px / 2 + rig.focal_px * down / ahead
        shown = (forward > 0) & (x >= 0) & (x < rig.width_px) & (y >= 0) & (y < rig.height_px)
        pixels.append(np.flatnonzero(shown))
        xs.append(x[shown].astype(np.float32))
        ys.append(y[shown].astype(np.float32))
        seen += [_turn(shown, shape, turned, count) for turned in range(count)]
    return Grid(step, shape, rays, solid_angle_sr, np.stack(seen), tuple(pixels), tuple(xs), tuple(ys))
