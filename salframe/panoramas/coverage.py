"""Overlapping perspective views that cover the sphere, and the positions of panorama pixels in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels

RINGS = ((8, 0.0), (4, np.pi / 3), (4, -np.pi / 3))
"""Number of views and elevation_rad of each ring: horizontal, up and down. The views of a ring are equally spaced; the
first looks along +x, the others follow counter-clockwise. The rings repeat every quarter turn."""
MIN_FOV_DEG = 75
"""Minimum field of view. With a smaller one, some directions are in no view."""
GRID_ROWS = 256
"""Approximate number of rows of the subsampled panorama on which boxes are marked: 0.7 deg per pixel, finer than the
accuracy of boxes."""


@dataclass(frozen=True)
class Rig:
    """Pinhole views of width_px x height_px. fov_rad is the field of view across the shorter side.

    Pixel centres are at +0.5, as in salframe.panoramas.geometry. The principal point is the centre of the image. The
    views with one elevation form a ring. To sample a view, the panorama is rolled by whole columns, until the view is
    at the same position as the other views of its ring. If the input panorama is rolled by the number of columns
    between two views, the result therefore has the same views in another order, with bit-identical pixels.
    """

    width_px: int
    height_px: int
    fov_rad: float

    @property
    def focal_px(self) -> float:
        """Focal length of every view in pixels."""
        return min(self.width_px, self.height_px) / 2 / np.tan(self.fov_rad / 2)

    def cut(self, image: np.ndarray) -> np.ndarray:
        """Sample the views (V, height_px, width_px, 3) uint8 of a panorama (H, 2H, 3) uint8, bilinearly."""
        import cv2

        # Average first if the panorama is much finer than the views, to avoid aliasing. A height divisible by four
        # keeps quarter turns whole numbers of columns.
        rows = 4 * round(self.focal_px * np.pi / 4)
        if image.shape[0] > 2 * rows:
            image = cv2.resize(image, (2 * rows, rows), interpolation=cv2.INTER_AREA)
        height, width = image.shape[:2]
        twice, views = np.hstack([image, image]), []
        for (columns, sampled_rows), (count, _) in zip(_sampling(self, height), RINGS, strict=True):
            for position in range(count):
                source = twice[:, width - _shift(position, count, width) :][:, :width]
                views.append(cv2.remap(source, columns, sampled_rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))
        return np.stack(views)

    def cuts(self, box_px: np.ndarray) -> np.ndarray:
        """Return which boxes (n, 4) come within a pixel of the border of their view, (n,) bool.

        The border may cut the objects in these boxes. A box is left, top, right and bottom in pixels.
        """
        last_px = self.width_px - 1, self.height_px - 1
        return np.any(np.hstack([box_px[:, :2] < 1, box_px[:, 2:] > last_px]), axis=1)

    def grid(self, height: int) -> Grid:
        """Return the grid of a panorama of this height."""
        return _grid(self, height)


@dataclass(frozen=True, eq=False)
class Grid:
    """Every `step`-th pixel of a panorama, P = rows * columns pixels, and their positions in the views.

    Attributes:
        step: Distance of neighbouring grid pixels in panorama pixels.
        shape: Rows and columns of the grid.
        rays: Unit vectors (P, 3) float32 in the panorama frame.
        solid_angle_sr: Solid angles (P,) float64.
        visible: Whether each view shows each pixel (V, P).
        pixel: For each ring, the indices of the grid pixels that its first view shows.
        x_px, y_px: For each ring, the float32 positions of these grid pixels in its first view, in pixels of the view.
    """

    step: int
    shape: tuple[int, int]
    rays: np.ndarray
    solid_angle_sr: np.ndarray
    visible: np.ndarray
    pixel: tuple[np.ndarray, ...]
    x_px: tuple[np.ndarray, ...]
    y_px: tuple[np.ndarray, ...]

    def thin(self, image: np.ndarray) -> np.ndarray:
        """Subsample a panorama's image (H, 2H, ...) at the grid's pixels: (P, ...)."""
        return np.reshape(image[:: self.step, :: self.step], (self.shape[0] * self.shape[1], *image.shape[2:]))

    def footprint(self, view: int, box_px: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """Return the mask (P,) of the grid's pixels inside a box of a view.

        Args:
            view: Index of the view.
            box_px: Left, top, right and bottom in the view.
            mask: Mask (height, width) of the object in the view; None: use the whole box.
        """
        ring, position = ring_of(view)
        x, y = self.x_px[ring], self.y_px[ring]
        inside = (x >= box_px[0]) & (x <= box_px[2]) & (y >= box_px[1]) & (y <= box_px[3])
        if mask is not None:
            inside[inside] = mask[y[inside].astype(int), x[inside].astype(int)]
        marked = np.zeros(self.shape[0] * self.shape[1], bool)
        marked[self.pixel[ring][inside]] = True
        return _turn(marked, self.shape, position, RINGS[ring][0])


def ring_of(view: int) -> tuple[int, int]:
    """Return two indices of a view: of its ring (the views with the same elevation), and of the view in this ring."""
    for ring, end in enumerate(accumulate(count for count, _ in RINGS)):
        if view < end:
            return ring, view - end + RINGS[ring][0]
    raise IndexError(view)


def _shift(position: int, count: int, width: int) -> int:
    """Return a number of columns. If the panorama is rolled to the right by this number, the first of `count` views
    shows what the view at `position` showed."""
    return round(position * width / count)


def _turn(marked: np.ndarray, shape: tuple[int, int], position: int, count: int) -> np.ndarray:
    """Return the mask (P,) of the view at `position`, given the mask of the first of `count` views."""
    return np.roll(marked.reshape(shape), -_shift(position, count, shape[1]), axis=1).ravel()


def _axes(elevation_rad: float) -> np.ndarray:
    """Return the right, down and forward axes of a view at azimuth 0 as rows (3, 3), in the panorama frame."""
    c, s = np.cos(elevation_rad), np.sin(elevation_rad)
    return np.array([[0, -1, 0], [s, 0, -c], [c, 0, s]])


@lru_cache(maxsize=4)
def _sampling(rig: Rig, height: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the sampling positions of the first view of each ring: columns and rows (height_px, width_px) float32, in
    OpenCV's pixel coordinates."""
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
    pixels, xs, ys, visible = [], [], [], []
    for count, elevation_rad in RINGS:
        right, down, forward = _axes(elevation_rad).astype(np.float32) @ rays.T
        ahead = np.maximum(forward, np.float32(1e-6))
        x, y = rig.width_px / 2 + rig.focal_px * right / ahead, rig.height_px / 2 + rig.focal_px * down / ahead
        shown = (forward > 0) & (x >= 0) & (x < rig.width_px) & (y >= 0) & (y < rig.height_px)
        pixels.append(np.flatnonzero(shown))
        xs.append(x[shown].astype(np.float32))
        ys.append(y[shown].astype(np.float32))
        visible += [_turn(shown, shape, position, count) for position in range(count)]
    return Grid(step, shape, rays, solid_angle_sr, np.stack(visible), tuple(pixels), tuple(xs), tuple(ys))
