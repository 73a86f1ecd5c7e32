"""Recognition of pictures that a 360 camera has not stitched: two fisheye circles side by side."""

from __future__ import annotations

import numpy as np

_ROWS = 128
"""Height to which a picture is reduced."""
_CORNER_RADIUS, _RING = 0.6, (0.3, 0.4)
"""Radii around the centre of each half of the picture, relative to the height. Corners are the pixels beyond the first
radius. The image of a fisheye lens fills the ring between the other two."""
_POLE_ROWS, _POLE_COLUMN = (0.4, 0.44), 0.08
"""Regions at the top and bottom of a circle: limits of their rows and columns from its centre, relative to the height.
At these rows the corners are black and the circle is lit."""
_MAX_BLACK, _MAX_BLACK_SHARE = 32.0, 0.25
"""Maximum brightness of the corners: absolute (0 to 255), and relative to the ring."""
_MIN_CONTRAST = 12.0
"""Minimum difference of brightness between the image of a lens and the corners."""
_MIN_LIT = 0.5
"""Minimum share of lit pixels for a region to count as lit."""
_NUM_SECTORS, _MIN_SECTORS, _MIN_POLES = 8, 7, 3
"""Number of sectors of each ring, minimum number of lit sectors of each ring, and minimum number of lit regions among
the four at the tops and bottoms of the two circles."""


def is_dual_fisheye(rgb: np.ndarray) -> bool:
    """Return whether a picture shows two fisheye circles side by side on black.

    The eight corners of the two square halves must be black. The circles must be lit all around, also in the top and
    the bottom rows, where the corners are black. In a panorama that is dark or partial, or has a black cap at a pole,
    each row is either lit or black over its whole width, so it does not meet both conditions.

    Args:
        rgb: (H, 2H, 3) uint8 picture.
    """
    import cv2

    small = cv2.resize(rgb, (2 * _ROWS, _ROWS), interpolation=cv2.INTER_AREA).max(axis=2).astype(np.float64)
    offset = (np.arange(_ROWS) + 0.5) / _ROWS - 0.5
    down, right = np.meshgrid(offset, offset, indexing="ij")
    radius, angle = np.hypot(down, right), np.arctan2(down, right)
    corner = radius > _CORNER_RADIUS
    ring = (radius > _RING[0]) & (radius < _RING[1])
    sector = ((angle + np.pi) * _NUM_SECTORS / (2 * np.pi)).astype(int) % _NUM_SECTORS
    halves = small[:, :_ROWS], small[:, _ROWS:]
    black = max(
        float(np.percentile(half[corner & quadrant], 95)) for half in halves for quadrant in _quadrants(down, right)
    )
    lit_level = min(float(np.median(half[ring])) for half in halves)
    if black > min(_MAX_BLACK, _MAX_BLACK_SHARE * lit_level):
        return False
    poles = [
        (np.abs(right) < _POLE_COLUMN) & (side * down > _POLE_ROWS[0]) & (side * down < _POLE_ROWS[1])
        for side in (-1, 1)
    ]
    lit = [half > black + _MIN_CONTRAST for half in halves]
    num_poles = sum(half[pole].mean() >= _MIN_LIT for half in lit for pole in poles)
    num_sectors = min(sum(half[ring & (sector == k)].mean() >= _MIN_LIT for k in range(_NUM_SECTORS)) for half in lit)
    return num_poles >= _MIN_POLES and num_sectors >= _MIN_SECTORS


def _quadrants(down: np.ndarray, right: np.ndarray) -> list[np.ndarray]:
    return [(down * y > 0) & (right * x > 0) for y in (-1, 1) for x in (-1, 1)]
