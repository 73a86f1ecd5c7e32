"""Computation of the network's input, which detection and training share."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays

HEIGHT = 256
"""Height in pixels of the panorama that the network takes. Its width is twice the height."""
CHANNELS = 6
"""Number of input channels."""

_MEAN, _STD = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)
_HEIGHT_SCALE_M = 1.5
"""Height in metres that is scaled to 1."""


def network_input(rgb: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """Compute the network's input: (6, HEIGHT, 2 HEIGHT) float32.

    The channels are colour normalised as for ImageNet, nearness 1 / (1 + range), height above the camera, and
    elevation.

    Args:
        rgb: Colour (H, 2H, 3) uint8.
        range_m: Range (H, 2H) float32 in metres, NaN where unknown. Nearness and height are 0 where it is NaN.
    """
    import cv2

    size = (2 * HEIGHT, HEIGHT)
    if rgb.shape[0] != HEIGHT:
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    range_m = smaller(range_m)
    elevation = equirectangular_rays(HEIGHT)[..., 2]
    known = np.isfinite(range_m)
    distance = np.where(known, range_m, 0)
    image = np.empty((CHANNELS, HEIGHT, 2 * HEIGHT), np.float32)
    image[:3] = ((rgb / np.float32(255) - _MEAN) / _STD).transpose(2, 0, 1)
    image[3] = np.where(known, 1 / (1 + distance), 0)
    image[4] = np.clip(distance * elevation / _HEIGHT_SCALE_M, -2, 2)
    image[5] = elevation
    return image


def smaller(image: np.ndarray) -> np.ndarray:
    """Resize an image (H, 2H) of ranges or ids to the network's size by nearest-neighbour sampling."""
    import cv2

    if image.shape[0] == HEIGHT:
        return image
    return cv2.resize(image, (2 * HEIGHT, HEIGHT), interpolation=cv2.INTER_NEAREST)
