"""The parts of a floor that a query shows: azimuth sectors around the positions of its views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.panoramas.geometry import as_complex, column_azimuth, row_elevation

BINS = 72
"""Number of azimuth bins of an outline and of the sectors, 5 degrees each."""
HORIZON_RAD = np.radians(15)
"""Maximum elevation and depression of the pixels that decide whether a sector was seen."""
MIN_SHOWN_SHARE = 0.5
"""Minimum share of seen pixels near the horizon in a sector that was seen."""
MIDDLES_RAD = (np.arange(BINS) + 0.5) * (2 * np.pi / BINS)
"""(BINS,) azimuths of the centres of the bins, float64."""


def azimuth_bins(azimuth_rad: np.ndarray) -> np.ndarray:
    """Return the bins (int32) of azimuths in [-2 pi, 2 pi); 0 where the azimuth is NaN."""
    with np.errstate(invalid="ignore"):
        number = np.floor(azimuth_rad * azimuth_rad.dtype.type(BINS / (2 * np.pi))).astype(np.int32)
    number += BINS * (number < 0)
    return np.minimum(np.maximum(number, 0), BINS - 1)


def shown_bins(valid: np.ndarray) -> np.ndarray:
    """Return whether each azimuth bin of a panorama was seen near the horizon, (BINS,) bool.

    Args:
        valid: (H, 2H) bool, the visible part of the sphere.
    """
    height, width = valid.shape
    near = np.abs(row_elevation(height)) <= HORIZON_RAD
    column_share = valid[near].mean(0) if near.any() else valid.mean(0)
    bins = azimuth_bins(column_azimuth(width))
    count = np.bincount(bins, minlength=BINS)
    share = np.bincount(bins, weights=column_share, minlength=BINS) / np.maximum(count, 1)
    return np.where(count > 0, share >= MIN_SHOWN_SHARE, True)


@dataclass(frozen=True, eq=False)
class Sectors:
    """Sectors that V views of a query showed, in the frame of the query.

    Attributes:
        bins: (V, BINS) bool: whether each view showed each azimuth bin around its position.
        position_m: (V, 2) float64 x and y of the views.
    """

    bins: np.ndarray
    position_m: np.ndarray

    @property
    def share(self) -> float:
        """Share of the azimuths that at least one view showed."""
        return float(self.bins.any(0).mean())

    def show(self, points: np.ndarray) -> np.ndarray:
        """Return whether at least one view showed the direction of points (T,) complex x + iy in metres, (T,) bool."""
        shown = np.zeros(len(points), bool)
        for view_bins, position in zip(self.bins, as_complex(self.position_m), strict=True):
            shown |= view_bins[azimuth_bins(np.angle(points - position))]
        return shown
