"""Conversion between sRGB values of images and linear light (IEC 61966-2-1)."""

from __future__ import annotations

import numpy as np

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue in the luminance."""


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """Return the sRGB values from 0 to 1 of linear light from 0 to 1, in the shape and dtype of the input."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def linear_from_srgb(srgb: np.ndarray) -> np.ndarray:
    """Return the linear light from 0 to 1 of sRGB values from 0 to 1, in the shape and dtype of the input."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


LINEAR = linear_from_srgb(np.arange(256) / 255).astype(np.float32)
"""Linear light of the values 0 to 255 of an 8-bit image."""
LINEAR.flags.writeable = False


def multiply_light(rgb: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Multiply the linear light of an image; what exceeds white is white.

    Args:
        rgb: Image (H, W, 3) uint8 sRGB.
        gains: Factors (3,) of linear red, green and blue.

    Returns:
        Image (H, W, 3) uint8 sRGB.
    """
    light = np.minimum(LINEAR * np.asarray(gains, np.float32)[:, None], 1)  # (3, 256)
    table = np.round(255 * srgb_from_linear(light)).astype(np.uint8)
    return np.stack([table[channel].take(rgb[..., channel]) for channel in range(3)], -1)
