"""Changes of the colour image of a query: exposure, white balance, blur, JPEG compression, resolution."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from salframe.framework.validation import Settings
from salframe.panoramas.srgb import LINEAR, multiply_light, srgb_from_linear

BLUR_REACH = 4
"""Distance from a pixel, in standard deviations of the blur, beyond which other pixels have no effect."""

RED_TO_BLUE = np.array([0.5, 0.0, -0.5])
"""Exponents of the gains of red, green and blue that change the ratio of red to blue by a factor of 2."""


class QueryImage(Settings):
    """Changes of a colour image. They are applied in the order of the settings, and are not random."""

    blur_px: float = Field(
        0.0,
        ge=0,
        le=50,
        description="standard deviation (pixels of the panorama) of a Gaussian blur of the query; 0: no blur",
    )
    exposure_ev: float = Field(
        0.0,
        ge=-10,
        le=10,
        description="change of the exposure in stops (EV): the light of the query is multiplied by 2 to the power of "
        "this value. For example, -2 leaves a quarter of the light. Pixels that become too bright are white; 0: no "
        "change",
    )
    warmth_ev: float = Field(
        0.0,
        ge=-4,
        le=4,
        description="error of the white balance in stops (EV): the ratio of red to blue light is multiplied by 2 to "
        "the power of this value. Positive: the image is more yellow; negative: it is more blue; 0: no change",
    )
    scale: float = Field(
        1.0,
        gt=0,
        le=1,
        description="loss of resolution: the width and height of the query are multiplied by this factor, and the "
        "image is then enlarged to its original size. For example, 0.5 halves the resolution; 1: no change",
    )
    jpeg_quality: int | None = Field(
        None,
        ge=1,
        le=100,
        description="JPEG quality (1 to 100) at which the query is compressed; small values give visible artefacts; "
        "null: no compression",
    )


def change_image(rgb: np.ndarray, changes: QueryImage) -> np.ndarray:
    """Return a changed colour image of a panorama.

    The image wraps around horizontally. Black pixels outside of the valid part of a panorama count as black when the
    image is blurred or reduced.

    Args:
        rgb: Colour (H, 2H, 3) uint8 sRGB.
        changes: The changes.

    Returns:
        Colour (H, 2H, 3) uint8 sRGB. Without any change, it equals `rgb`.
    """
    if changes.blur_px:
        rgb = _blurred(rgb, changes.blur_px)
    if changes.exposure_ev or changes.warmth_ev:
        rgb = multiply_light(rgb, 2.0 ** (changes.exposure_ev + changes.warmth_ev * RED_TO_BLUE))
    if changes.scale < 1:
        rgb = _reduced(rgb, changes.scale)
    if changes.jpeg_quality is not None:
        rgb = _compressed(rgb, changes.jpeg_quality)
    return rgb


def _blurred(rgb: np.ndarray, sigma_px: float) -> np.ndarray:
    """Blur the linear light of an image."""
    import cv2

    reach = int(np.ceil(BLUR_REACH * sigma_px))
    margin = min(reach, rgb.shape[1])
    around = cv2.copyMakeBorder(LINEAR[rgb], 0, 0, margin, margin, cv2.BORDER_WRAP)
    light = cv2.GaussianBlur(around, (2 * reach + 1,) * 2, sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.round(255 * srgb_from_linear(np.clip(light[:, margin:-margin], 0, 1))).astype(np.uint8)


def _reduced(rgb: np.ndarray, scale: float) -> np.ndarray:
    """Reduce an image by area averaging, and enlarge it to its size by bilinear interpolation."""
    import cv2

    height, width = rgb.shape[:2]
    small_size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(rgb, small_size, interpolation=cv2.INTER_AREA)
    around = cv2.copyMakeBorder(small, 0, 0, 1, 1, cv2.BORDER_WRAP)
    # `around` has one more column on each side.
    columns, rows = np.meshgrid(
        ((np.arange(width) + 0.5) * (small_size[0] / width) + 0.5).astype(np.float32),
        ((np.arange(height) + 0.5) * (small_size[1] / height) - 0.5).astype(np.float32),
    )
    enlarged: np.ndarray = cv2.remap(around, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return enlarged


def _compressed(rgb: np.ndarray, quality: int) -> np.ndarray:
    """Compress an image as JPEG and decode it."""
    import cv2

    _, code = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))
    return cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB)
