"""Selection of the points in a box that belong to its object."""

from __future__ import annotations

import numpy as np

BEFORE_SHARE, BEHIND_SHARE = 0.7, 0.5
"""Maximum depth of an object towards the camera and away from it, as a share of its width. The share behind is smaller,
because there a box also shows the wall or floor. Measured with boxes around the objects of a rendered home: the
centroid was within 0.3 m of the true one for 88 % of the objects with all pixels, and for 94 % with these pixels."""
MIN_REACH = 0.05
"""Minimum depth in either direction, as a share of the range."""


def foreground(range_m: np.ndarray, solid_angle_sr: np.ndarray) -> np.ndarray:
    """Return the mask (n,) of the pixels of an object's outline that show the object; all False if no range is known.

    A box also contains background. The object is assumed to be at the median range of the outline, and to be as deep as
    wide. Its width is the side of a square with the outline's solid angle at this range.

    Args:
        range_m: Ranges (n,) in metres, NaN where unknown.
        solid_angle_sr: Solid angles (n,).
    """
    finite = np.flatnonzero(range_m > 0)
    if not len(finite):
        return np.zeros(len(range_m), bool)
    nearest_first = finite[np.argsort(range_m[finite], kind="stable")]
    share = np.cumsum(solid_angle_sr[nearest_first])
    object_m = range_m[nearest_first[np.searchsorted(share, share[-1] / 2)]]
    across = np.sqrt(solid_angle_sr.sum())
    before, behind = max(BEFORE_SHARE * across, MIN_REACH), max(BEHIND_SHARE * across, MIN_REACH)
    return (range_m >= object_m * (1 - before)) & (range_m <= object_m * (1 + behind))
