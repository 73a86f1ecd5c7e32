"""Which places a map shows, and its scene frames in each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.graphs.segments import ranges, starts
from salframe_graphs.places.merging import Place


@dataclass(frozen=True, eq=False)
class ShownPlaces:
    """K places of a map, several of which may bear one of P names: names, each once; name (K,), number of each place's;
    frame (F,), positions in the map of their scene frames, one place's after the other's; start (K + 1,), where each
    place's begin."""

    names: Sequence[str]
    name: np.ndarray
    frame: np.ndarray
    start: np.ndarray

    @classmethod
    def of(cls, places: Sequence[Place]) -> ShownPlaces:
        """Of gathered places."""
        number = {name: i for i, name in enumerate(dict.fromkeys(place.name for place in places))}
        return cls(
            list(number),
            np.array([number[place.name] for place in places], int),
            np.array([frame for place in places for frame in place.frames], int),
            starts(np.array([len(place.frames) for place in places], int)),
        )

    def __len__(self) -> int:
        return len(self.name)

    @cached_property
    def number(self) -> dict[str, int]:
        """The number of each name."""
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def place(self) -> np.ndarray:
        """(F,) the place of each of `frame`."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    @cached_property
    def padded(self) -> np.ndarray:
        """(K, most frames of a place): `frame`, the last one of each place repeated."""
        count = np.diff(self.start)
        return self.frame[self.start[:-1, None] + np.minimum(np.arange(count.max()), count[:, None] - 1)]

    @cached_property
    def _of_names(self) -> tuple[np.ndarray, np.ndarray]:
        """`frame` name by name, and where each name's begin."""
        name = self.name[self.place]
        return self.frame[np.argsort(name, kind="stable")], starts(np.bincount(name, minlength=len(self.names)))

    def nearest(self, names: np.ndarray, frames_m: np.ndarray, xy_m: np.ndarray) -> np.ndarray:
        """(N,) of each of some names (N,) the frame that stands nearest to a position (N, 2), the first one where that
        is NaN; frames_m (S, 2): where the frames of the map stand."""
        frame, start = self._of_names
        count = start[names + 1] - start[names]
        found, begins = frame[ranges(start[names], count)], starts(count)[:-1]
        if len(found) > len(names):
            row = np.repeat(np.arange(len(names)), count)
            away_m = np.hypot(*(frames_m[found] - xy_m[row]).T)
            begins = np.lexsort((np.where(np.isnan(away_m), 0, away_m), row))[begins]
        return found[begins]
