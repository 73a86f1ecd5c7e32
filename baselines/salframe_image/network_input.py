"""What networks trained on perspective images are shown of a panorama."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import InputMissing
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig


def cut_views(panorama: Panorama, rig: ViewRig) -> tuple[np.ndarray, np.ndarray]:
    """The views (V, height, width, 3) uint8 of a panorama with colour, and which of them lie for at least a half in
    what was seen, (V,) bool. Raises InputMissing where it has none."""
    if panorama.rgb is None:
        raise InputMissing(f"{panorama.id} has no colour, which views are cut from")
    views = rig.cut(panorama.rgb)
    if panorama.valid is None:
        return views, np.ones(rig.count, bool)
    return views, rig.cut(panorama.valid.astype(np.uint8)).mean((1, 2)) >= 0.5


def as_batch(views: np.ndarray, mean: Sequence[float], std: Sequence[float]) -> np.ndarray:
    """(V, 3, height, width) float32 network input: (grey level - mean) / std for red, green, blue; mean and std in grey
    levels, 0 to 255."""
    scaled = (views - np.array(mean, np.float32)) / np.array(std, np.float32)
    return np.ascontiguousarray(scaled.transpose(0, 3, 1, 2))
