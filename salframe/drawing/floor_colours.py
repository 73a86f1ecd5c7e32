"""The colours of a floor viewed from above."""

from __future__ import annotations

import numpy as np

from salframe.drawing.canvas import PAPER, Colour
from salframe.panoramas.floor_outlines import REGION_COLOURS
from salframe.panoramas.floors import FloorMasks

WALL: Colour = (92, 96, 104)
WALL_M = 0.12
"""Thickness of drawn walls in metres."""


def floor_colours(floor: FloorMasks) -> np.ndarray:
    """Return a colour for each pixel of a floor, (rows, columns, 3) uint8. Walls are dark, the floor has the colour of
    its region, and obstacles have a darker shade of this colour."""
    from scipy import ndimage

    inside = floor.free | (floor.region > 0)
    reach = max(1, round(WALL_M / floor.resolution_m))
    wall = ndimage.binary_dilation(inside, np.ones((2 * reach + 1,) * 2, bool)) & ~inside
    colour = (
        np.array(REGION_COLOURS)[floor.region % len(REGION_COLOURS)] * np.where(floor.obstacle, 0.84, 1.0)[..., None]
    )
    return np.select([inside[..., None], wall[..., None]], [colour, np.array(WALL)], np.array(PAPER)).astype(np.uint8)
