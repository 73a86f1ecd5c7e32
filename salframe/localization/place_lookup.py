"""The place at a position in a map."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from salframe.panoramas.floors import FloorMasks, Regions
from salframe.panoramas.frames import FrameKind, ReferenceFrame


class PlaceLookup:
    """Finds the place at a position: the nearest region of the floor below the position.

    If there is no such floor, the place of the nearest scene frame (reference frame in a room) of the map is used.
    """

    def __init__(self, floors: Sequence[FloorMasks], frames: Sequence[ReferenceFrame]) -> None:
        self._regions = Regions(floors) if floors else None
        self._frames = frames

    def at(self, position_m: np.ndarray) -> str:
        """Return the name of the place at the position (3,) of a camera."""
        if self._regions is not None:
            number = int(self._regions.at(position_m[None, :2], position_m[None, 2])[0])
            if number >= 0:
                return self._regions.places[number]
        places, scenes_m = self._scenes
        return places[int(np.linalg.norm(scenes_m - position_m, axis=1).argmin())]

    @cached_property
    def _scenes(self) -> tuple[list[str], np.ndarray]:
        """Places and positions (N, 3) of the scene frames; of all frames if there are no scene frames."""
        scenes = [frame for frame in self._frames if frame.kind is FrameKind.SCENE] or list(self._frames)
        return [frame.place for frame in scenes], np.array([frame.T_world_pano[:3, 3] for frame in scenes])
