"""Lines, areas and letters on images (h, w, 3) uint8 RGB; points (..., 2) are pixels (x, y), the first's centre 0.5."""

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
"""Binary places of a pixel that OpenCV is given, whose first pixel's centre is 0."""


def stroke(image: np.ndarray, line: np.ndarray, colour: Colour, width: float, *, closed: bool = False) -> None:
    """Draw a line (K, 2) into an image, this many pixels wide."""
    import cv2

    cv2.polylines(image, [_fixed(line)], closed, colour, max(1, round(width)), cv2.LINE_AA, _BITS)


def fill(image: np.ndarray, polygon: np.ndarray, colour: Colour) -> None:
    """Fill a polygon (K, 2) of an image."""
    import cv2

    cv2.fillPoly(image, [_fixed(polygon)], colour, cv2.LINE_AA, _BITS)


def disk(image: np.ndarray, centre: np.ndarray, radius: float, colour: Colour) -> None:
    """Fill a circle about a pixel."""
    import cv2

    x, y = _fixed(centre).tolist()
    cv2.circle(image, (x, y), round(radius * 2**_BITS), colour, -1, cv2.LINE_AA, _BITS)


def coat(image: np.ndarray, polygons: Iterable[tuple[np.ndarray, Colour]], opacity: float) -> np.ndarray:
    """An image with polygons in their colours on it, the later over the earlier, that let it shine through."""
    covered = image.copy()
    for polygon, colour in polygons:
        fill(covered, polygon, colour)
    return np.round(opacity * covered.astype(np.float32) + (1 - opacity) * image).astype(np.uint8)


@cache
def font(points: int) -> FreeTypeFont | ImageFont:
    """The font that pictures are lettered in."""
    from PIL import ImageFont

    return ImageFont.load_default(points)


def _fixed(points: np.ndarray) -> np.ndarray:
    return np.round((np.asarray(points) - 0.5) * 2**_BITS).astype(np.int32)
