"""Windows: a window consists of all objects of the map that are near the frames of a place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.scene_frames import SceneFrames
from salframe_graphs.sightings import Sightings, merge_sightings

if TYPE_CHECKING:
    from scipy.spatial import KDTree

MAX_CACHED = 2000
"""Maximum number of windows that are kept in memory, about 5 kB each."""


@dataclass(frozen=True, eq=False)
class _WindowObjects:
    """The N objects of a window, in the columns of PlaceIndex."""

    label: np.ndarray
    xy_m: np.ndarray
    z_m: np.ndarray
    variance_m2: np.ndarray
    log_size: np.ndarray
    detection_logit: np.ndarray


class Windows:
    """The windows of the places of a map: for each place, all objects of the map that are near its scene frames.

    A window is computed when it is first used.
    """

    def __init__(self, index: PlaceIndex, scene_frames: SceneFrames, frames_m: np.ndarray, radius_m: float) -> None:
        """Create the windows.

        Args:
            index: The objects of the K places.
            scene_frames: The places and their scene frames.
            frames_m: (S, 3) positions of the reference frames in metres.
            radius_m: Maximum distance of an object from a scene frame of the place.
        """
        self._index, self._scene_frames, self._frames_m, self._radius_m = index, scene_frames, frames_m, radius_m
        self._window = lru_cache(MAX_CACHED)(self._compute)
        self._taken: tuple[bytes, PlaceIndex] | None = None

    def take(self, places: np.ndarray) -> PlaceIndex:
        """Return an index of the places (C,), ascending, in which each place has the objects of its window.

        The labels are indices in the vocabulary of the map.
        """
        if self._taken is None or self._taken[0] != places.tobytes():
            windows = [self._window(place) for place in places.tolist()]
            columns: dict[str, Any] = {
                name: np.concatenate([getattr(window, name) for window in windows])
                for name in _WindowObjects.__dataclass_fields__
            }
            count = np.array([len(window.label) for window in windows])
            self._taken = places.tobytes(), replace(self._index.take(places), count=count, **columns)
        return self._taken[1]

    @cached_property
    def _camera_z_m(self) -> np.ndarray:
        """(K,) median world height of the cameras of each place. PlaceIndex.z_m is relative to this height."""
        frames = np.split(self._scene_frames.frame, self._scene_frames.start[1:-1])
        return np.array([np.median(self._frames_m[of_place, 2]) for of_place in frames])

    @cached_property
    def _objects_m(self) -> np.ndarray:
        """(M, 3) positions of the objects in the world."""
        index = self._index
        return np.column_stack([index.xy_m, index.z_m + self._camera_z_m[index.place]])

    @cached_property
    def _tree(self) -> KDTree:
        from scipy.spatial import KDTree

        return KDTree(self._objects_m)

    def _compute(self, place: int) -> _WindowObjects:
        """Return the window of a place. Objects that several places have are merged."""
        index = self._index
        cameras_m = self._frames_m[self._scene_frames.frame[slice(*self._scene_frames.start[place : place + 2])]]
        near = self._tree.query_ball_point(cameras_m, self._radius_m)
        rows = np.unique(np.concatenate([np.array(part, int) for part in near]))
        offset_m = self._objects_m[rows, None, :2] - cameras_m[:, :2]
        sightings = Sightings(
            index.place[rows],
            index.label[rows],
            self._objects_m[rows],
            np.hypot(offset_m[..., 0], offset_m[..., 1]).min(1),
            index.log_size[rows],
            np.zeros(len(rows)),
            np.zeros(len(rows)),
        )
        merged = merge_sightings(sightings, index.variance_m2[rows].astype(np.float64))
        label = np.zeros(len(merged.centroid_m), np.int64)
        label[merged.owner] = index.label[rows]
        logit = np.full(len(label), -np.inf)
        np.maximum.at(logit, merged.owner, index.detection_logit[rows])
        xy_m, z_m = merged.centroid_m[:, :2], merged.centroid_m[:, 2] - self._camera_z_m[place]
        return _WindowObjects(label, xy_m, z_m, merged.variance_m2, merged.log_size, logit)
