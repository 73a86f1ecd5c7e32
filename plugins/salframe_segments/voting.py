"""Views of a panorama for a network, and their votes on the panorama's pixels."""

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
"""Rows of the panorama that views vote on; it has twice as many columns. 0.7 deg a pixel, as fine as networks of 513
pixels are that give their scores at a quarter of that."""
TILT_RAD = np.pi / 3
"""Elevation of the views that look up, and depression of those that look down."""
BORDER = 0.02
"""The weight of a vote at a view's border; it is 1 in its middle. There a network sees the least around a pixel."""


@dataclass(frozen=True)
class Views:
    """The views of a panorama: a level ring of `level`, and `tilted` each that look up and down; pixels and field of
    view (across the width) are the same for all."""

    level: int
    tilted: int
    width_px: int
    height_px: int
    fov_rad: float

    @property
    def rings(self) -> tuple[ViewRig, ...]:
        """The rings that have views."""
        rings = ((self.level, 0.0), (self.tilted, TILT_RAD), (self.tilted, -TILT_RAD))
        return tuple(ViewRig(n, self.width_px, self.height_px, self.fov_rad, up) for n, up in rings if n)

    @property
    def count(self) -> int:
        """V, how many views there are."""
        return self.level + 2 * self.tilted

    def cut(self, image: np.ndarray) -> np.ndarray:
        """(V, height_px, width_px, 3) uint8, ring by ring, of a panorama's colour (H, 2H, 3)."""
        return np.concatenate([ring.cut(image) for ring in self.rings])

    def show(self, valid: np.ndarray) -> np.ndarray:
        """(V,) bool: the views that show any of the pixels that are valid (HEIGHT, 2 HEIGHT) bool."""
        rays = equirectangular_rays(HEIGHT)[valid]
        return np.array([ring.project(rays, view)[1].any() for ring in self.rings for view in range(ring.count)], bool)


@lru_cache(maxsize=4)
def ballot(views: Views, rows: int, columns: int) -> csr_array:
    """(P, V * rows * columns) float32: how much each pixel of each view's scores (rows, columns) counts for each of the
    P = HEIGHT * 2 HEIGHT pixels of the panorama: bilinear, times a weight that falls linearly from the middle of a view
    to its borders. A row's sum is the weight of all its votes, 0 where no view looks."""
    from scipy.sparse import csr_array

    rays = equirectangular_rays(HEIGHT).reshape(-1, 3).astype(np.float64)
    weights, voters, pixels = [], [], []
    first = 0
    for ring in views.rings:
        for view in range(ring.count):
            seen, inside = ring.project(rays, view)
            pixel = np.flatnonzero(inside)
            x, y = seen[inside].T / ((ring.width_px,), (ring.height_px,))
            near_border = 2 * np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
            for voter, share in _bilinear(x * columns - 0.5, y * rows - 0.5, columns, rows):
                pixels.append(pixel)
                voters.append(first + voter)
                weights.append(share * np.maximum(near_border, BORDER))
            first += rows * columns
    data = np.concatenate(weights).astype(np.float32), (np.concatenate(pixels), np.concatenate(voters))
    return csr_array(data, shape=(len(rays), first))


def _bilinear(x: np.ndarray, y: np.ndarray, columns: int, rows: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The four pixels around each position, as indices into an image (rows, columns), and their shares."""
    left, top = np.floor(x), np.floor(y)
    right_share, low_share = x - left, y - top
    found = []
    for right in (0, 1):
        for low in (0, 1):
            column = np.clip(left + right, 0, columns - 1).astype(int)
            row = np.clip(top + low, 0, rows - 1).astype(int)
            share = np.abs(1 - right - right_share) * np.abs(1 - low - low_share)
            found.append((row * columns + column, share))
    return found


def vote(views: Views, shown: np.ndarray, probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean of the views' probabilities on the panorama: (HEIGHT, 2 HEIGHT, C) float32, and the weight of all votes
    (HEIGHT, 2 HEIGHT), 0 where no view looks and all probabilities are 0.

    shown (V,) bool: the views that probabilities (v, rows, columns, C) float32 are of.
    """
    _, rows, columns, classes = probabilities.shape
    counts = ballot(views, rows, columns)
    if not shown.all():
        counts = counts[:, np.repeat(shown, rows * columns)]
    total = counts @ probabilities.reshape(-1, classes)
    weight = np.asarray(counts.sum(1), np.float32)
    total /= np.maximum(weight, 1e-9)[:, None]
    return total.reshape(HEIGHT, 2 * HEIGHT, classes), weight.reshape(HEIGHT, 2 * HEIGHT)
