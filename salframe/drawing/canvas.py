"""Draw lines, areas and text on images (h, w, 3) uint8 RGB. Points (..., 2) are (x, y) in pixels. The centre of the
first pixel is (0.5, 0.5)."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

Colour = tuple[int, int, int]
INK, PAPER, FAINT = (40, 44, 52), (255, 255, 255), (120, 126, 138)
_BITS = 4
"""Number of fractional bits of pixel coordinates passed to OpenCV. In OpenCV, the centre of the first pixel is
(0, 0)."""


def stroke(image: np.ndarray, line: np.ndarray, colour: Colour, width: float, *, closed: bool = False) -> None:
    """Draw a line (K, 2) on an image, `width` pixels wide."""
    import cv2

    cv2.polylines(image, [_fixed(line)], closed, colour, max(1, round(width)), cv2.LINE_AA, _BITS)


def fill(image: np.ndarray, polygon: np.ndarray, colour: Colour) -> None:
    """Fill a polygon (K, 2) of an image."""
    import cv2

    cv2.fillPoly(image, [_fixed(polygon)], colour, cv2.LINE_AA, _BITS)


def disk(image: np.ndarray, centre: np.ndarray, radius: float, colour: Colour) -> None:
    """Draw a filled circle on an image. `centre` (2,) and `radius` are in pixels."""
    import cv2

    x, y = _fixed(centre).tolist()
    cv2.circle(image, (x, y), round(radius * 2**_BITS), colour, -1, cv2.LINE_AA, _BITS)


def fill_translucent(image: np.ndarray, polygons: Iterable[tuple[np.ndarray, Colour]], opacity: float) -> np.ndarray:
    """Return an image with translucent polygons. Later polygons cover earlier polygons.

    Args:
        image: (h, w, 3) uint8.
        polygons: Points (K, 2) and colour of each polygon.
        opacity: Opacity of the polygons, from 0 to 1.
    """
    overlay = image.copy()
    for polygon, colour in polygons:
        fill(overlay, polygon, colour)
    return np.round(opacity * overlay.astype(np.float32) + (1 - opacity) * image).astype(np.uint8)


@cache
def font(points: int) -> FreeTypeFont | ImageFont:
    """Return the font of the texts in pictures, in a size."""
    from PIL import ImageFont

    return ImageFont.load_default(points)


def _fixed(points: np.ndarray) -> np.ndarray:
    return np.round((np.asarray(points) - 0.5) * 2**_BITS).astype(np.int32)
