"""Suggest a turn of the camera towards the largest azimuth sector that the query does not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.panoramas.geometry import wrap_angle


@dataclass(frozen=True)
class NextView:
    """A suggested turn of the camera on the spot. The camera takes views at equal angles during the turn, the last one
    at its end.

    Attributes:
        turn_deg: Turn in degrees, positive to the left.
        num_views: Number of views, at least 1.
    """

    turn_deg: float
    num_views: int = 1

    @classmethod
    def of(cls, turn_deg: float, view_deg: float) -> NextView:
        """Return a turn with the smallest number of views between which no direction is left out.

        Args:
            turn_deg: Turn in degrees, positive to the left.
            view_deg: Width of the sector that the camera shows, in degrees.
        """
        return cls(turn_deg, max(int(np.ceil(abs(turn_deg) / view_deg - 1e-9)), 1))

    @property
    def views_deg(self) -> tuple[float, ...]:
        """Angles of the views in degrees, relative to the direction before the turn. The last angle is `turn_deg`."""
        return tuple(self.turn_deg * number / self.num_views for number in range(1, self.num_views + 1))

    def __str__(self) -> str:
        turn = f"turn {'left' if self.turn_deg > 0 else 'right'} {abs(round(self.turn_deg))} deg"
        return turn if self.num_views == 1 else f"{turn}, with a view every {abs(round(self.views_deg[0]))} deg"


def next_view_of(shown: np.ndarray) -> NextView | None:
    """Return the turn to the middle of the largest sector that a query does not show, in whole degrees.

    The number of views during the turn is such that they leave no direction out, see `NextView.of`.

    Args:
        shown: (V, B) bool, whether each view shows each azimuth bin. The last row is the present view of the camera.
            The bins have equal widths and start at the x axis of the query, counter-clockwise.

    Returns:
        The turn. If several sectors have the maximum size, the smallest turn is returned. None if the views show all
        directions, or if the last view shows no direction.
    """
    num_bins = shown.shape[1]
    before = np.flatnonzero(shown.any(0))
    if len(before) == num_bins or not shown[-1].any():
        return None
    width = np.diff(np.append(before, before[0] + num_bins))
    before = before[width == width.max()]
    bin_rad = 2 * np.pi / num_bins
    azimuth_rad = (before + 0.5 * (width.max() + 1)) * bin_rad
    camera_rad = np.angle(np.exp(1j * (np.flatnonzero(shown[-1]) + 0.5) * bin_rad).sum())
    turns_deg = np.degrees(wrap_angle(azimuth_rad - camera_rad)).round()
    turn_deg = float(min(turns_deg, key=abs))
    view_deg = np.degrees(bin_rad) * np.count_nonzero(shown[-1])
    return NextView.of(abs(turn_deg) if abs(turn_deg) == 180 else turn_deg, view_deg)
