"""Detect range images that hold the z-depth of cube faces instead of the range along the ray."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays

NUM_ROWS = 128
"""Approximate number of rows of a range image after subsampling."""
MIN_KNOWN_SHARE = 0.03
"""Minimum share of the panorama that the face below the camera must fill with known values. The whole face fills 1/4 of
its pixels."""
MIN_SUPPORT, MIN_SUPPORT_RATIO = 0.2, 1.5
"""Minimum share of pixels with the same depth on the face below the camera, and minimum ratio of this share to the
share of pixels with the same height."""
LEVEL_SHARE = 0.02
"""Maximum relative difference of the values of one floor."""


def is_cube_depth(range_m: np.ndarray) -> bool:
    """Return whether the values of a range image look like depth along the axes of cube faces.

    The face below the camera decides. If the values are such depths, the floor has the same value everywhere. If they
    are ranges along the ray, the floor has the same height everywhere.

    Args:
        range_m: (H, 2H) ranges in any unit; values that are not finite or not positive are unknown.
    """
    step = max(1, len(range_m) // NUM_ROWS)
    rays = equirectangular_rays(len(range_m))[step // 2 :: step, step // 2 :: step]
    values = range_m[step // 2 :: step, step // 2 :: step]
    is_below = (-rays[..., 2] >= np.abs(rays).max(-1)) & np.isfinite(values) & (values > 0)
    if is_below.mean() < MIN_KNOWN_SHARE:
        return False
    weight = np.hypot(rays[..., 0], rays[..., 1])[is_below]
    of_one_depth = _mode_share(values[is_below], weight)
    of_one_height = _mode_share((values * -rays[..., 2])[is_below], weight)
    return of_one_depth >= MIN_SUPPORT and of_one_depth >= MIN_SUPPORT_RATIO * of_one_height


def _mode_share(values: np.ndarray, weight: np.ndarray) -> float:
    """Return the maximum share of the total weight over all groups of values that differ by at most LEVEL_SHARE."""
    order = np.argsort(values)
    logs, total = np.log(values[order].astype(np.float64)), np.append(0, np.cumsum(weight[order]))
    last = np.searchsorted(logs, logs + LEVEL_SHARE, side="right")
    return float((total[last] - total[:-1]).max() / total[-1])
