"""How high the camera stands over the floor, by the range image: what tells ranges in a wrong unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama

_Seen = ReferenceFrame | QueryFrame | Panorama

ROWS = 96
"""The panorama is thinned to about this many rows: 2 deg a pixel."""
MIN_SLOPE_DEG = 12.0
"""Surfaces less far below the horizon are seen at too flat an angle to tell how they lie."""
LEVEL = 0.93
"""Cosine of the steepest slope (22 deg) of what counts as level."""
BIN_SHARE = 0.04
"""Heights of the same surface differ by less than about this share."""
MIN_SHARE, FLOOR_SHARE = 0.02, 0.3
"""A surface is a floor where it fills so much of the sphere below the horizon, and so much of what the most visible
level surface does: the lowest such is the floor, and not the table that the camera stands over."""
USUAL_M, PLAUSIBLE_M = 1.5, (0.45, 2.8)
"""Height of a camera at eye level, and the heights that nobody is warned of: from small robots to raised tripods."""
FRAMES = 3
"""So many panoramas are looked at."""

UNITS = {
    1 / 4: "quarter millimetres read as millimetres",
    1 / 5: "fifths of a millimetre read as millimetres",
    0.3048: "feet read as metres",
    1 / 10: "tenths of a millimetre read as millimetres",
    1 / 100: "centimetres read as metres",
    1 / 1000: "millimetres read as metres",
    4.0: "millimetres read as quarter millimetres",
    5.0: "millimetres read as fifths of a millimetre",
    1 / 0.3048: "metres read as feet",
    10.0: "centimetres read as millimetres",
    100.0: "metres read as centimetres",
    1000.0: "metres read as millimetres",
}
"""What ranges must be multiplied by, and how they came to be wrong."""


def camera_height(range_m: np.ndarray) -> float | None:
    """How far below the camera the floor lies, in the unit of range_m (H, 2H), NaN where unknown; None where no floor
    is seen.

    The floor is the lowest of the level surfaces that fill enough of the view down. Only shares of heights are
    compared, so that a range of any unit has a floor.
    """
    step = max(1, round(len(range_m) / ROWS))
    rays = equirectangular_rays(len(range_m))[step // 2 :: step, step // 2 :: step]
    points = rays * range_m[step // 2 :: step, step // 2 :: step, None]
    down = -points[..., 2]
    downward = rays[..., 2] <= -np.sin(np.radians(MIN_SLOPE_DEG))
    seen = downward & (down > 0) & (_slope_cosine(points) >= LEVEL)
    if not seen.any():
        return None
    solid_angle = np.hypot(rays[..., 0], rays[..., 1])
    share = (solid_angle / solid_angle[rays[..., 2] < 0].sum())[seen]
    height = np.log(down[seen], dtype=np.float64)
    order = np.argsort(height)
    height, share = height[order], share[order]
    below = np.append(0, np.cumsum(share))
    first, last = (np.searchsorted(height, height + offset) for offset in (-BIN_SHARE / 2, BIN_SHARE / 2))
    support = below[last] - below[first]
    floors = np.flatnonzero(support >= max(MIN_SHARE, FLOOR_SHARE * support.max()))
    if not len(floors):
        return None
    lowest = floors[height[floors] >= height[floors[-1]] - 2 * BIN_SHARE]
    mode = lowest[np.argmax(support[lowest])]
    return float(np.exp(np.median(height[first[mode] : last[mode]])))


def _slope_cosine(points: np.ndarray) -> np.ndarray:
    """(h, w) cosine of the slope of the surface through each point (h, w, 3) of a panorama and its neighbours, NaN
    where one of them is not known."""
    along = np.roll(points, -1, 1) - np.roll(points, 1, 1)  # the first and the last column are neighbours
    across = np.full_like(points, np.nan)
    across[1:-1] = points[2:] - points[:-2]
    normal = np.cross(along, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.abs(normal[..., 2]) / np.linalg.norm(normal, axis=-1)


def units_note(frames: Sequence[_Seen]) -> str | None:
    """What must be said of the unit of ranges, in one line, None where there is nothing: a few of the frames are
    loaded, and their floors lie where no camera would stand over them.

    Panoramas without range, or without a floor, and those that cannot be read, tell nothing.
    """
    heights = {frame.id: height for frame in _few(frames) if (height := _height_of(frame)) is not None}
    if not heights:
        return None
    height_m = float(np.median(list(heights.values())))
    min_m, max_m = PLAUSIBLE_M
    if min_m <= height_m <= max_m:
        return None
    first = next(iter(heights))
    seen = f"in {first}" if len(heights) == 1 else f"median of {len(heights)} panoramas from {first} on"
    factor = min(UNITS, key=lambda factor: abs(np.log(height_m * factor / USUAL_M)))
    times = f"{round(max(factor, 1 / factor), 2):g} times too {'large' if factor < 1 else 'small'}"
    plausible = min_m <= height_m * factor <= max_m
    cause = f"ranges may be about {times}, likely {UNITS[factor]}" if plausible else "are its ranges in metres?"
    return f"the floor lies {height_m:.3g} m below the camera ({seen}), expected {min_m:g} to {max_m:g} m: {cause}"


def _few(frames: Sequence[_Seen]) -> list[_Seen]:
    """The first frame, the last, and those between that make FRAMES."""
    if not frames:
        return []
    return [frames[i] for i in sorted({round(i) for i in np.linspace(0, len(frames) - 1, FRAMES)})]


def _height_of(frame: _Seen) -> float | None:
    try:
        panorama = frame if isinstance(frame, Panorama) else frame.load()
    except Exception:  # a plugin's own code; whoever needs the frame will say what is wrong with it
        return None
    return None if panorama.range_m is None else camera_height(panorama.range_m)
