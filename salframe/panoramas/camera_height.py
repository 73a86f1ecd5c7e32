"""Estimate the height of the camera above the floor, to detect ranges in a wrong unit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.samples import Frame, load_samples

NUM_ROWS = 96
"""Approximate number of rows after subsampling: 2 deg per pixel."""
MIN_SLOPE_DEG = 12.0
"""Minimum angle of rays below the horizon. The slope of a surface cannot be measured at smaller angles."""
MIN_LEVEL_COSINE = 0.93
"""Cosine of the maximum slope of a level surface (22 deg)."""
BIN_SHARE = 0.04
"""Maximum relative difference of heights of the same surface."""
MIN_SHARE, MIN_RELATIVE_SHARE = 0.02, 0.3
"""Minimum solid angle of a floor, relative to the half sphere below the horizon and to the largest level surface. The
floor is the lowest surface above both limits, so that a table below the camera is not taken for the floor."""
USUAL_M, PLAUSIBLE_M = 1.5, (0.45, 2.8)
"""Height of a camera at eye level, and limits of heights without a warning (small robots to raised tripods)."""
MIN_CONFIRMED_M = 0.1
"""Minimum height of a camera that the z of a pose can confirm. If the origin of the world is a camera, z is often near
0 and confirms nothing."""
NUM_FRAMES = 3
"""Maximum number of panoramas that are loaded for a check, such as of the unit of the ranges."""

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
"""Factor that corrects the ranges -> likely cause of the error."""


class LevelSurfaces(NamedTuple):
    """Distances of the camera from the level surfaces below and above it, in metres; NaN where unknown."""

    floor_m: float
    ceiling_m: float


def find_level_surfaces(panorama: Panorama) -> LevelSurfaces:
    """Return the distances of the camera from floor and ceiling. They are NaN without a measured range."""
    if panorama.range_m is None or panorama.range_by is not None:
        return LevelSurfaces(np.nan, np.nan)
    heights_m = (camera_height(range_m) for range_m in (panorama.range_m, panorama.range_m[::-1]))
    return LevelSurfaces(*(np.nan if height_m is None else height_m for height_m in heights_m))


def camera_height(range_m: np.ndarray) -> float | None:
    """Return the height of the camera above the floor, in the unit of range_m; None if no floor is visible.

    The floor is the lowest of the level surfaces that fill enough of the view below the horizon. Heights are compared
    by their ratios only, so that the unit of the ranges does not matter.

    Args:
        range_m: (H, 2H) range along the ray, NaN where unknown.
    """
    step = max(1, round(len(range_m) / NUM_ROWS))
    rays = equirectangular_rays(len(range_m))[step // 2 :: step, step // 2 :: step]
    points = rays * range_m[step // 2 :: step, step // 2 :: step, None]
    down = -points[..., 2]
    downward = rays[..., 2] <= -np.sin(np.radians(MIN_SLOPE_DEG))
    is_level = downward & (down > 0) & (_slope_cosine(points) >= MIN_LEVEL_COSINE)
    if not is_level.any():
        return None
    solid_angle = np.hypot(rays[..., 0], rays[..., 1])
    share = (solid_angle / solid_angle[rays[..., 2] < 0].sum())[is_level]
    height = np.log(down[is_level], dtype=np.float64)
    order = np.argsort(height)
    height, share = height[order], share[order]
    below = np.append(0, np.cumsum(share))
    first, last = (np.searchsorted(height, height + offset) for offset in (-BIN_SHARE / 2, BIN_SHARE / 2))
    support = below[last] - below[first]
    floors = np.flatnonzero(support >= max(MIN_SHARE, MIN_RELATIVE_SHARE * support.max()))
    if not len(floors):
        return None
    lowest = floors[height[floors] >= height[floors[-1]] - 2 * BIN_SHARE]
    mode = lowest[np.argmax(support[lowest])]
    return float(np.exp(np.median(height[first[mode] : last[mode]])))


def _slope_cosine(points: np.ndarray) -> np.ndarray:
    """Return the cosine of the slope of the surface at each pixel, (h, w), NaN where a neighbour is unknown.

    Args:
        points: (h, w, 3) points of a panorama.
    """
    along = np.roll(points, -1, 1) - np.roll(points, 1, 1)  # the first and the last column are neighbours
    across = np.full_like(points, np.nan)
    across[1:-1] = points[2:] - points[:-2]
    normal = np.cross(along, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.abs(normal[..., 2]) / np.linalg.norm(normal, axis=-1)


def units_note(frames: Sequence[Frame], camera_z_m: Sequence[float] | np.ndarray = ()) -> str | None:
    """Return a one-line warning if the ranges seem to be in a wrong unit; None if they do not.

    A few of the frames are loaded. The warning is returned if the median height of the camera above the floor is not
    plausible and the poses do not confirm it. Panoramas without range or without a floor, and unreadable panoramas, are
    ignored.

    Args:
        frames: Reference frames, queries or panoramas.
        camera_z_m: World z of other cameras in this building, such as the cameras of the map. A height of at least
            MIN_CONFIRMED_M is confirmed if it is close to one of these z or to the z of a reference frame.
    """
    heights = {}
    z_m = list(camera_z_m)
    for frame, panorama in load_samples(frames, NUM_FRAMES):
        height = None if panorama.range_m is None else camera_height(panorama.range_m)
        if height is not None:
            heights[panorama.id] = height
            z_m += [float(frame.T_world_pano[2, 3])] if isinstance(frame, ReferenceFrame) else []
    if not heights:
        return None
    height_m = float(np.median(list(heights.values())))
    min_m, max_m = PLAUSIBLE_M
    is_confirmed = height_m >= MIN_CONFIRMED_M and bool(np.isclose(z_m, height_m, rtol=0.15, atol=0.05).any())
    if min_m <= height_m <= max_m or (is_confirmed and height_m <= 2 * max_m):
        return None
    first = next(iter(heights))
    source = f"in {first}" if len(heights) == 1 else f"median of {len(heights)} panoramas, the first: {first}"
    factor = min(UNITS, key=lambda factor: abs(np.log(height_m * factor / USUAL_M)))
    times = f"{round(max(factor, 1 / factor), 2):g} times too {'large' if factor < 1 else 'small'}"
    plausible = min_m <= height_m * factor <= max_m
    cause = f"ranges may be about {times}, likely {UNITS[factor]}" if plausible else "the ranges may be wrong"
    return (
        f"the floor lies {height_m:.3g} m below the camera ({source}), expected {min_m:g} to {max_m:g} m: {cause}. "
        "Check the unit of the ranges: range_unit_m in manifest.json, or --range-unit for single images"
    )
