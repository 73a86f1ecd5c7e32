"""Suggest a turn of the camera towards the largest azimuth sector that the query does not show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from salframe.panoramas.geometry import wrap_angle


@dataclass(frozen=True)
class NextView:
    """A suggested turn of the camera on the spot. The camera takes views at equal angles during the turn, the last one
    at its end.

    Attributes:
        turn_deg: Turn in degrees, positive to the left.
        max_step_deg: Maximum angle between two successive views in degrees; inf: the turn has a single view.
    """

    turn_deg: float
    max_step_deg: float = math.inf

    @property
    def views_deg(self) -> tuple[float, ...]:
        """Angles of the views in degrees, relative to the direction before the turn. The last angle is `turn_deg`."""
        count = max(math.ceil(abs(self.turn_deg) / self.max_step_deg), 1)
        return tuple(self.turn_deg * number / count for number in range(1, count + 1))

    def __str__(self) -> str:
        turn = f"turn {'left' if self.turn_deg > 0 else 'right'} {abs(round(self.turn_deg))} deg"
        step_deg = abs(self.views_deg[0])
        return turn if len(self.views_deg) == 1 else f"{turn}, with a view every {round(step_deg)} deg"


def next_view_of(shown: np.ndarray) -> NextView | None:
    """Return the turn to the middle of the largest sector that a query does not show, in whole degrees.

    The maximum angle between views is the width of the widest sector that the last view shows without a gap. The views
    of this sector then leave no direction out, up to the width of a bin.

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
    max_step_deg = 360 * _widest_run(shown[-1]) / num_bins
    return NextView(abs(turn_deg) if abs(turn_deg) == 180 else turn_deg, max_step_deg)


def _widest_run(shown: np.ndarray) -> int:
    """Return the length of the longest run of true values on a circle (B,), which has at least one false value."""
    hidden = np.flatnonzero(~shown)
    return int(np.diff(np.append(hidden, hidden[0] + len(shown))).max()) - 1
