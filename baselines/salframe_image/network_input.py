"""Input of networks that were trained on perspective images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import InputMissing
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig

HIDDEN_GREY = np.uint8(127)
"""Grey level that replaces pixels that a partial panorama does not show. Most networks subtract about this value from
an image."""


def cut_views(panorama: Panorama, rig: ViewRig) -> tuple[np.ndarray, np.ndarray]:
    """Cut perspective views from a panorama.

    Returns:
        (V, height, width, 3) uint8 views, and (V,) bool, whether at least half of the pixels of a view are valid.

    Raises:
        InputMissing: The panorama has no colour.
    """
    if panorama.rgb is None:
        raise InputMissing(f"{panorama.display_name} has no colour image (rgb), which the image network needs")
    views = rig.cut(panorama.rgb)
    if panorama.valid is None:
        return views, np.ones(rig.count, bool)
    return views, rig.cut(panorama.valid.astype(np.uint8)).mean((1, 2)) >= 0.5


def cut_visible_views(panorama: Panorama, rig: ViewRig) -> tuple[np.ndarray, np.ndarray]:
    """Cut perspective views from a panorama, with grey pixels where a partial panorama shows nothing.

    Returns:
        (V, height, width, 3) uint8 views, and (V,) float64, the fraction of valid pixels of each view.

    Raises:
        InputMissing: The panorama has no colour.
    """
    views, _ = cut_views(panorama, rig)
    if panorama.valid is None:
        return views, np.ones(rig.count)
    valid = rig.cut(panorama.valid.astype(np.uint8))
    return np.where(valid[..., None] > 0, views, HIDDEN_GREY), valid.mean((1, 2))


def as_batch(views: np.ndarray, mean: Sequence[float], std: Sequence[float]) -> np.ndarray:
    """Return views as (V, 3, height, width) float32 network input, (grey level - mean) / std.

    Args:
        views: (V, height, width, 3) uint8 images.
        mean: Mean of red, green and blue, in grey levels from 0 to 255.
        std: Standard deviation of red, green and blue, in grey levels.
    """
    scaled = (views - np.array(mean, np.float32)) / np.array(std, np.float32)
    return np.ascontiguousarray(scaled.transpose(0, 3, 1, 2))
