"""Perspective views of a panorama for a network, and averaging of their scores on the pixels of the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.perspective import ViewRig

if TYPE_CHECKING:
    from scipy.sparse import csr_array

HEIGHT = 256
"""Height of the panorama on which scores are averaged; the width is twice the height. A pixel has 0.7 deg. This is as
fine as the output of networks with an input of 513 pixels, whose output has a quarter of this resolution."""
TILT_RAD = np.pi / 3
"""Elevation of the views that look up. The views that look down have the elevation -TILT_RAD."""
BORDER = 0.02
"""Weight of a score at the border of a view; the weight at the centre is 1. At the border, a network has little
context."""


@dataclass(frozen=True)
class Views:
    """Views of a panorama, all with the same size and field of view.

    Attributes:
        level: Number of horizontal views.
        tilted: Number of views that look up. The same number of views looks down.
        width_px: Width of a view.
        height_px: Height of a view.
        fov_rad: Field of view across the width.
    """

    level: int
    tilted: int
    width_px: int
    height_px: int
    fov_rad: float

    @property
    def rings(self) -> tuple[ViewRig, ...]:
        """The horizontal views, the views that look up, and the views that look down; empty rings are left out."""
        rings = ((self.level, 0.0), (self.tilted, TILT_RAD), (self.tilted, -TILT_RAD))
        return tuple(ViewRig(n, self.width_px, self.height_px, self.fov_rad, up) for n, up in rings if n)

    @property
    def count(self) -> int:
        """Total number of views V."""
        return self.level + 2 * self.tilted

    def cut(self, image: np.ndarray) -> np.ndarray:
        """Cut the views (V, height_px, width_px, 3) uint8 from a panorama (H, 2H, 3) uint8, ring by ring."""
        return np.concatenate([ring.cut(image) for ring in self.rings])

    def visible_views(self, valid: np.ndarray) -> np.ndarray:
        """Return (V,) bool: whether each of the V views shows at least one valid pixel.

        Args:
            valid: (HEIGHT, 2 HEIGHT) bool, true for the valid pixels of the panorama.
        """
        rays = equirectangular_rays(HEIGHT)[valid]
        return np.array([ring.project(rays, view)[1].any() for ring in self.rings for view in range(ring.count)], bool)


@lru_cache(maxsize=4)
def score_weights(views: Views, rows: int, columns: int) -> csr_array:
    """Return the sparse matrix that averages the score images of the views in each pixel of the panorama.

    Element (p, i) is the weight of pixel i of the score images, one after the other, for pixel p of the panorama. It
    is the product of a bilinear weight and of a weight that falls linearly from the centre of a view to its border. The
    sum of a row is the total weight, 0 if no view shows the pixel.

    Args:
        views: Views of the panorama.
        rows: Number of rows of each view's scores.
        columns: Number of columns of each view's scores.

    Returns:
        (P, V * rows * columns) float32, where P = HEIGHT * 2 HEIGHT.
    """
    from scipy.sparse import csr_array

    rays = equirectangular_rays(HEIGHT).reshape(-1, 3).astype(np.float64)
    weights, score_pixels, pixels = [], [], []
    first = 0
    for ring in views.rings:
        for view in range(ring.count):
            xy_px, inside = ring.project(rays, view)
            pixel = np.flatnonzero(inside)
            x, y = xy_px[inside].T / ((ring.width_px,), (ring.height_px,))
            centrality = 2 * np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
            for score_pixel, share in _bilinear(x * columns - 0.5, y * rows - 0.5, columns, rows):
                pixels.append(pixel)
                score_pixels.append(first + score_pixel)
                weights.append(share * np.maximum(centrality, BORDER))
            first += rows * columns
    data = np.concatenate(weights).astype(np.float32), (np.concatenate(pixels), np.concatenate(score_pixels))
    return csr_array(data, shape=(len(rays), first))


def _bilinear(x: np.ndarray, y: np.ndarray, columns: int, rows: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return indices and bilinear weights of the four pixels of an image (rows, columns) around each position."""
    left, top = np.floor(x), np.floor(y)
    right_share, low_share = x - left, y - top
    corners = []
    for right in (0, 1):
        for low in (0, 1):
            column = np.clip(left + right, 0, columns - 1).astype(int)
            row = np.clip(top + low, 0, rows - 1).astype(int)
            share = np.abs(1 - right - right_share) * np.abs(1 - low - low_share)
            corners.append((row * columns + column, share))
    return corners


def average_scores(views: Views, shown: np.ndarray, probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average the probabilities of several views on the pixels of the panorama.

    Args:
        views: Views of the panorama.
        shown: (V,) bool, whether `probabilities` contains each view.
        probabilities: Probabilities (v, rows, columns, C) float32 of these views.

    Returns:
        Mean probabilities (HEIGHT, 2 HEIGHT, C) float32, and the total weight (HEIGHT, 2 HEIGHT); both are 0 where
        there is no view.
    """
    _, rows, columns, classes = probabilities.shape
    weights = score_weights(views, rows, columns)
    if not shown.all():
        weights = weights[:, np.repeat(shown, rows * columns)]
    total = weights @ probabilities.reshape(-1, classes)
    weight = np.asarray(weights.sum(1), np.float32)
    total /= np.maximum(weight, 1e-9)[:, None]
    return total.reshape(HEIGHT, 2 * HEIGHT, classes), weight.reshape(HEIGHT, 2 * HEIGHT)
