"""Detect places whose frames lie on different storeys: two rooms above each other with one name."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.frames import ReferenceFrame

MAX_STEP_M = 1.8
"""Maximum difference of height between a frame of a room and the next higher frame of this room. Steps and galleries
cause smaller differences; two storeys cause larger ones."""
NUM_FRAMES = 3
"""Number of frames to load above and below such a difference."""


def storeys_note(frames: Sequence[ReferenceFrame]) -> str | None:
    """Return a one-line warning about places whose frames cannot be in one room; None if there are none.

    The frames of a place lie in two rooms if three conditions hold: a step in their sorted heights exceeds MAX_STEP_M,
    the lower frames see a ceiling below the upper cameras, and the upper frames see a floor above the lower cameras.
    Only frames around such a step are loaded. Frames without range, floor or ceiling cause no warning.
    """
    of_place: dict[str, list[ReferenceFrame]] = {}
    for frame in frames:
        of_place.setdefault(frame.place, []).append(frame)
    divided = {place: step for place, members in of_place.items() if (step := _storey_step(members))}
    if not divided:
        return None
    place, (lower, upper) = next(iter(divided.items()))
    rest = "1 other place" if len(divided) == 2 else f"{len(divided) - 1} other places"
    more = f"; the same holds for {rest}, the next: {[*divided][1]!r}" if len(divided) > 1 else ""
    return (
        f"the place {place!r} has frames on two storeys ({lower.id} at z = {_z_m(lower):.2f} m, {upper.id} at "
        f"{_z_m(upper):.2f} m, a floor between them), expected the frames of one room: use a different place name for "
        f"each room{more}"
    )


def _storey_step(frames: Sequence[ReferenceFrame]) -> tuple[ReferenceFrame, ReferenceFrame] | None:
    """Return the frames below and above a floor that divides the frames of a place; None if they are one room."""
    by_height = sorted(frames, key=_z_m)
    for number, (lower, upper) in enumerate(pairwise(by_height), 1):
        if _z_m(upper) - _z_m(lower) <= MAX_STEP_M:
            continue
        below, above = by_height[:number][-NUM_FRAMES:], by_height[number:][:NUM_FRAMES]
        ceiling_m, floor_m = _surface_m(below, above_camera=True), _surface_m(above, above_camera=False)
        if ceiling_m < _z_m(upper) and floor_m > _z_m(lower):
            return lower, upper
    return None


def _surface_m(frames: Sequence[ReferenceFrame], *, above_camera: bool) -> float:
    """Return the median height in the world of the ceilings or floors that frames see; NaN if they see none."""
    heights_m = []
    for frame in frames:
        try:
            range_m = frame.load().range_m
        except Exception:  # raised by a plugin; the code that uses the frame later reports the error
            continue
        distance_m = None if range_m is None else camera_height(range_m[::-1] if above_camera else range_m)
        if distance_m is not None:
            heights_m.append(_z_m(frame) + (distance_m if above_camera else -distance_m))
    return float(np.median(heights_m)) if heights_m else np.nan


def _z_m(frame: ReferenceFrame) -> float:
    return float(frame.T_world_pano[2, 3])
