"""The parts of a floor that a query shows: azimuth sectors around the positions of its views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.panoramas.geometry import as_complex, column_azimuth, row_elevation

BINS = 72
"""Number of azimuth bins of an outline and of the sectors, 5 degrees each."""
HORIZON_RAD = np.radians(15)
"""Maximum angle above or below the horizon of the pixels that decide whether a sector was seen."""
MIN_SHOWN_SHARE = 0.5
"""A sector was seen if the image shows at least this share of its pixels near the horizon."""
MARGIN_M = 0.3
"""Distance behind the outline of free space up to which objects should be visible, because objects stand at walls."""
MIDDLES_RAD = (np.arange(BINS) + 0.5) * (2 * np.pi / BINS)
"""(BINS,) azimuths of the centres of the bins, float64."""


def azimuth_bins(azimuth_rad: np.ndarray) -> np.ndarray:
    """Return the bin indices (int32) of azimuths in [-2 pi, 2 pi); 0 where the azimuth is NaN."""
    with np.errstate(invalid="ignore"):
        number = np.floor(azimuth_rad * azimuth_rad.dtype.type(BINS / (2 * np.pi))).astype(np.int32)
    number += BINS * (number < 0)
    return np.minimum(np.maximum(number, 0), BINS - 1)


def shown_bins(valid: np.ndarray) -> np.ndarray:
    """Return whether each azimuth bin of a panorama was seen near the horizon, (BINS,) bool.

    Args:
        valid: (H, 2H) bool, true for the pixels that the image shows.
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
    """Parts of the floor in which V views of a query should show objects, in the frame of the query.

    Attributes:
        reach_m: (V, BINS) float32: distance in metres up to which each view should show objects, in each azimuth bin
            around the position of the view. 0: the view does not show the bin; inf: the distance of the walls is
            unknown.
        position_m: (V, 2) float64 x and y of the views.
    """

    reach_m: np.ndarray
    position_m: np.ndarray

    @classmethod
    def of_view(cls, shown: np.ndarray | None, outline_m: np.ndarray | None) -> Sectors:
        """Return the sectors that one view shows, in the frame of this view.

        Args:
            shown: (BINS,) bool, whether the view shows each bin; None: all bins.
            outline_m: (BINS,) outline of free space in metres, NaN where unknown; None: unknown.
        """
        reach_m = np.full(BINS, np.inf, np.float32)
        if outline_m is not None:
            reach_m = np.where(np.isfinite(outline_m), outline_m + np.float32(MARGIN_M), reach_m)
        if shown is not None:
            reach_m = np.where(shown, reach_m, np.float32(0))
        return cls(reach_m[None], np.zeros((1, 2)))

    @property
    def share(self) -> float:
        """Fraction of the azimuths that at least one view showed."""
        return float((self.reach_m > 0).any(0).mean())

    def show(self, points: np.ndarray) -> np.ndarray:
        """Return for each point whether at least one view should show an object there, (T,) bool.

        Args:
            points: (T,) complex x + iy in the query frame, in metres.
        """
        if np.isinf(self.reach_m).all(1).any():  # a whole panorama, with walls at unknown distances
            return np.ones(len(points), bool)
        shown = np.zeros(len(points), bool)
        for reach_m, position in zip(self.reach_m, as_complex(self.position_m), strict=True):
            offset = points - position
            shown |= np.abs(offset) < reach_m[azimuth_bins(np.angle(offset))]
        return shown
