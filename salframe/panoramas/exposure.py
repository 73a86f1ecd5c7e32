"""Exposure of panoramas: mean luminance, and the correction of dark images for networks."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from salframe.panoramas.geometry import pixel_solid_angles
from salframe.panoramas.srgb import LINEAR, LUMINANCE, multiply_light

DARK_LUMINANCE = 0.18
"""Maximum mean luminance of a dark image. Panoramas rendered in dim light have 0.08 to 0.17, and by day at least 0.26
(`house-42`, seeds 100 and 101)."""
USUAL_LUMINANCE = 0.29
"""Mean luminance of panoramas rendered by day (`house-42`, seeds 100 and 101). Photographs of rooms have 0.19 to 0.36
(8 of NYU Depth v2)."""
MAX_GAIN = 16.0
"""Maximum factor of a correction (4 stops): an 8-bit image that is darker has too few grey levels."""
NOISE_RADIUS_PX = 2
"""Radius in pixels of the neighbourhood that the noise filter averages."""
NOISE_SIGMA_PX = 1.5
"""Standard deviation in pixels of the weights of the noise filter by distance."""
NOISE_SIGMA_COLOUR = 15.0
"""Standard deviation of the weights of the noise filter by colour. The difference of two colours is the sum of the
absolute differences of red, green and blue, from 0 to 765."""
SAMPLED_ROWS = 128
"""Approximate number of rows that the mean luminance is computed from."""


def mean_luminance(rgb: np.ndarray, valid: np.ndarray | None = None) -> float:
    """Return the mean linear luminance of a panorama, weighted by solid angle, from 0 (black) to 1 (white).

    Args:
        rgb: Colour (H, 2H, 3) uint8 sRGB.
        valid: Pixels (H, 2H) bool that the panorama covers; None: all.

    Returns:
        The mean; NaN if no pixel is valid.
    """
    step = max(1, rgb.shape[0] // SAMPLED_ROWS)
    sampled = slice(step // 2, None, step)
    luminance = LINEAR[rgb[sampled, sampled]] @ np.array(LUMINANCE, np.float32)
    area_sr = np.broadcast_to(pixel_solid_angles(rgb.shape[0])[sampled, None], luminance.shape)
    if valid is not None:
        area_sr = area_sr * valid[sampled, sampled]
    total_sr = float(area_sr.sum())
    return float((area_sr * luminance).sum() / total_sr) if total_sr > 0 else float("nan")


def correct_dark(rgb: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """Return a dark panorama with the usual mean luminance and less noise, and any other panorama unchanged.

    First, a bilateral filter (Tomasi and Manduchi, Bilateral filtering for gray and color images, ICCV 1998) reduces
    noise and keeps edges. Then linear light is multiplied by one factor, which does not change colours except where a
    channel exceeds white.

    Args:
        rgb: Colour (H, 2H, 3) uint8 sRGB.
        valid: Pixels (H, 2H) bool that the panorama covers; None: all.

    Returns:
        Colour (H, 2H, 3) uint8 sRGB.
    """
    luminance = mean_luminance(rgb, valid)
    if not 0 < luminance < DARK_LUMINANCE:
        return rgb
    return multiply_light(_without_noise(rgb), np.full(3, min(USUAL_LUMINANCE / luminance, MAX_GAIN)))


def _without_noise(rgb: np.ndarray) -> np.ndarray:
    """Apply a bilateral filter to an image (H, 2H, 3) uint8, which wraps around horizontally."""
    import cv2

    around = cv2.copyMakeBorder(rgb, 0, 0, NOISE_RADIUS_PX, NOISE_RADIUS_PX, cv2.BORDER_WRAP)
    smooth = cv2.bilateralFilter(around, 2 * NOISE_RADIUS_PX + 1, NOISE_SIGMA_COLOUR, NOISE_SIGMA_PX)
    return np.ascontiguousarray(smooth[:, NOISE_RADIUS_PX:-NOISE_RADIUS_PX])


def exposure_setting() -> Any:
    """Return the field of the setting `exposure` of a detector that applies `correct_dark` to its input."""
    return Field(
        "auto",
        description="correction of dark panoramas before the network runs. auto: a dark panorama (mean luminance below "
        "0.18, where white is 1) is filtered against noise and brightened to the mean 0.29, by a factor of at most 16; "
        "none: no correction",
    )
