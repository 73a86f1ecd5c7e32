"""The places of a map and their scene frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.graphs.segments import ranges, starts
from salframe.localization.evidence_model import PlaceFrames
from salframe_graphs.places.merging import Place


@dataclass(frozen=True, eq=False)
class SceneFrames(PlaceFrames):
    """The places of a map and their scene frames (reference frames in rooms, not in doorways).

    If frames are not merged, several places have the same name.
    """

    @classmethod
    def of(cls, places: Sequence[Place]) -> SceneFrames:
        """Return the names and frames of places."""
        number = {name: i for i, name in enumerate(dict.fromkeys(place.name for place in places))}
        return cls(
            list(number),
            np.array([number[place.name] for place in places], int),
            np.array([frame for place in places for frame in place.frames], int),
            starts(np.array([len(place.frames) for place in places], int)),
        )

    @cached_property
    def number(self) -> dict[str, int]:
        """Mapping from each place name to its position in `names`."""
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def _of_names(self) -> tuple[np.ndarray, np.ndarray]:
        """The frames sorted by name, and the position of each name's first frame."""
        name = self.name[self.place]
        return self.frame[np.argsort(name, kind="stable")], starts(np.bincount(name, minlength=len(self.names)))

    def of_name(self, name: int) -> np.ndarray:
        """Return the map indices (N,) of the scene frames of all places with the name `names[name]`."""
        frame, start = self._of_names
        return frame[start[name] : start[name + 1]]

    def nearest(self, names: np.ndarray, frames_m: np.ndarray, xy_m: np.ndarray) -> np.ndarray:
        """Return the frame of each name that is nearest to a position.

        Args:
            names: (N,) indices of names.
            frames_m: (S, 2) positions of all reference frames in metres.
            xy_m: (N, 2) positions in metres. For a NaN position, the first frame of the name is returned.

        Returns:
            (N,) indices of frames.
        """
        frame, start = self._of_names
        count = start[names + 1] - start[names]
        candidates, first = frame[ranges(start[names], count)], starts(count)[:-1]
        if len(candidates) > len(names):
            row = np.repeat(np.arange(len(names)), count)
            distance_m = np.hypot(*(frames_m[candidates] - xy_m[row]).T)
            first = np.lexsort((np.where(np.isnan(distance_m), 0, distance_m), row))[first]
        return candidates[first]
