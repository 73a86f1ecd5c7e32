"""Black bands at the top and bottom of a panorama. Many 360-degree cameras paint the tripod below them black, and
scanners leave the zenith black too."""

from __future__ import annotations

import numpy as np

MAX_BLACK = 4
"""Maximum value (0 to 255) of a channel in a black row. JPEG compression changes black by a few levels."""
MIN_HEIGHT = 0.02
"""Minimum height of a band, as a share of the rows of the panorama: 3.6 degrees around the pole."""
MAX_FRINGE, FRINGE_ROWS = 40, 16
"""Maximum value of a channel in the fringe of a band, and maximum number of rows of the fringe. JPEG compression brings
light into the band, at most one block (16 rows) deep. The largest value in seven panoramas, compressed with quality 50
to 97, is 35."""


def blank_rows(rgb: np.ndarray, range_m: np.ndarray | None = None) -> np.ndarray:
    """Return the rows at the top and bottom of a panorama that show nothing.

    All pixels of these rows are black. The floor of a dark room is not black in all directions, because of the noise of
    the camera and the light of the room. A row with a known range shows a surface, even if the row is black. A panorama
    that is black everywhere has no blank rows.

    Args:
        rgb: (R, 2H, 3) uint8 colour of all rows of a panorama, or of R adjacent rows.
        range_m: (R, 2H) float32 range in metres, NaN where unknown; None: no range.

    Returns:
        (R,) bool, true in the blank rows.
    """
    brightest = rgb.max(axis=(1, 2))
    blank = np.zeros(len(rgb), bool)
    if (brightest <= MAX_BLACK).all():
        return blank
    unknown = ~blank if range_m is None else np.isnan(range_m).all(axis=1)
    min_rows = MIN_HEIGHT * rgb.shape[1] / 2
    for inwards in (slice(None), slice(None, None, -1)):
        blank[inwards][: _band_height(brightest[inwards], unknown[inwards], min_rows)] = True
    return blank


def _band_height(brightest: np.ndarray, unknown: np.ndarray, min_rows: float) -> int:
    """Return the number of rows of the band that begins at the first row; 0 if there is no band.

    Args:
        brightest: (R,) uint8, maximum value of the channels in each row.
        unknown: (R,) bool, whether no pixel of the row has a range.
        min_rows: Minimum number of black rows.
    """
    black = _num_leading(unknown & (brightest <= MAX_BLACK))
    if black < min_rows:
        return 0
    fringe = slice(black, black + FRINGE_ROWS)
    return black + _num_leading(unknown[fringe] & (brightest[fringe] <= MAX_FRINGE))


def _num_leading(rows: np.ndarray) -> int:
    """Return the number of true values before the first false value."""
    return len(rows) if rows.all() else int(rows.argmin())
