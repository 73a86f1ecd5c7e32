"""Logos at the bottom of panoramas. Many 360-degree cameras hide the tripod under a picture, such as the logo of their
maker. It is the same in every panorama of the camera."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

MIN_PICTURES = 4
"""Minimum number of panoramas that show whether a picture at the bottom is a logo. Fewer may show one floor."""
MAX_DIFFERENCE = 8
"""Maximum difference of a channel (0 to 255) between two pixels of the same logo. JPEG compression changes equal blocks
equally."""
MAX_FRINGE, FRINGE_ROWS = 40, 16
"""Maximum difference in the fringe of the logo, and maximum number of rows of the fringe: one block of JPEG. Such a
block also contains pixels above the logo, which differ between panoramas."""
MIN_SHARE = 0.95
"""Minimum share of the pixels in a row of a logo that are equal in all panoramas."""
MIN_HEIGHT, MAX_HEIGHT = 0.02, 0.25
"""Minimum and maximum height of a logo, as shares of the rows: 3.6 and 45 degrees around the nadir. If more rows are
equal, the camera did not move."""


def find_logo(pictures: Iterable[np.ndarray]) -> np.ndarray | None:
    """Return the logo of the camera that took all pictures.

    Args:
        pictures: Panoramas at different positions, (H, 2H, 3) uint8 as stored in their files, in the orientation of the
            camera.

    Returns:
        (R, 2H, 3) uint8, the R lowest rows, which are the same in all panoramas. None if there is no logo, if the sizes
        differ, or if there are fewer than MIN_PICTURES panoramas.
    """
    # One row more than a logo may have, to recognize a camera that did not move. A copy, so that the rest of each
    # picture is not held in memory.
    bottoms = [picture[-int(MAX_HEIGHT * len(picture)) - 1 :].copy() for picture in pictures]
    if len(bottoms) < MIN_PICTURES or len({bottom.shape for bottom in bottoms}) > 1:
        return None
    lowest = np.min(bottoms, axis=0)
    num_rows = num_logo_rows(np.max(bottoms, axis=0), lowest)
    is_logo = MIN_HEIGHT * lowest.shape[1] / 2 <= num_rows < len(lowest)
    return lowest[-num_rows:] if is_logo else None


def num_logo_rows(picture: np.ndarray, logo: np.ndarray) -> int:
    """Return how many of the lowest rows of a panorama show the logo.

    Args:
        picture: (H, 2H, 3) uint8 panorama as stored in its file.
        logo: (R, 2H, 3) uint8, lowest rows of the panoramas of the camera.

    Returns:
        Number of rows; 0 if the panorama has another width.
    """
    if picture.shape[1:] != logo.shape[1:]:
        return 0
    num_rows = min(len(picture), len(logo))
    difference = np.abs(picture[-num_rows:].astype(np.int16) - logo[-num_rows:]).max(axis=2)[::-1]
    num_equal = _num_leading(difference, MAX_DIFFERENCE)
    return num_equal and num_equal + _num_leading(difference[num_equal : num_equal + FRINGE_ROWS], MAX_FRINGE)


def _num_leading(difference: np.ndarray, limit: int) -> int:
    """Return the number of rows before the first row in which fewer than MIN_SHARE of the pixels differ by at most
    `limit`. `difference` is (R, 2H)."""
    is_equal = (difference <= limit).mean(axis=1) >= MIN_SHARE
    return int(np.logical_and.accumulate(is_equal).sum())
