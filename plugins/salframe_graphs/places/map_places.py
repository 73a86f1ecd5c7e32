"""The places of a map in the layout for matching: objects, frames and regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from salframe.framework.files.array_files import ArrayKind
from salframe.framework.files.columns import PackedColumn, read_columns, write_columns
from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.floors import Regions
from salframe.panoramas.frames import ReferenceFrame
from salframe_graphs.places.heights import place_heights
from salframe_graphs.places.merging import gather_places
from salframe_graphs.places.place_index import PLACE_COLUMNS, PlaceIndex, index_places, place_rows, read_places
from salframe_graphs.places.poses import Poses
from salframe_graphs.places.rates import Likelihood, Rates
from salframe_graphs.places.scene_frames import SceneFrames
from salframe_graphs.places.windows import Windows

_PLACES = "places"
"""Name under which the places are stored in the folder of a map's index."""
_SCENE_FRAMES_COLUMNS = {"name": ArrayKind("U", ()), "frames": ArrayKind("u", (None,))}


@dataclass(frozen=True, eq=False)
class MapPlaces:
    """K places of a map with S reference frames (in rooms and in doorways).

    Attributes:
        scene_frames: The places and their scene frames (reference frames in rooms, not in doorways).
        index: The objects of the places.
        T_world_pano: (S, 3, 4) poses of the frames.
        regions: The floor area of each place; None if it is unknown.
    """

    scene_frames: SceneFrames
    index: PlaceIndex
    T_world_pano: np.ndarray
    regions: Regions | None

    @classmethod
    def gather(
        cls,
        graphs: Sequence[SaliencyGraph],
        frames: Sequence[ReferenceFrame],
        heights_m: np.ndarray,
        regions: Regions | None,
        rates: Rates,
        likelihood: Likelihood,
        merged: bool,
    ) -> MapPlaces:
        """Return the places of reference frames.

        Args:
            graphs: The graph of each frame.
            frames: The frames.
            heights_m: (S,) height of each frame's camera above the floor, NaN where it is unknown.
            regions: The floor area of each place, or None.
            rates: Error rates of the detector.
            likelihood: Constants of the likelihood.
            merged: Whether to merge the frames of a place.
        """
        place_of = None if regions is None else partial(_places_at, regions)
        places = gather_places(graphs, frames, rates, place_of, merged)
        T_world_pano = np.array([frame.T_world_pano[:3] for frame in frames])
        cameras_m = [T_world_pano[list(place.frames), :, 3] for place in places]
        scene_frames = SceneFrames.of(places)
        camera_height_m = place_heights(scene_frames, heights_m, T_world_pano[:, 2, 3])
        triangulated = np.array([graph.variance_m2.any() for graph in graphs])
        has_boxes = _of_places(scene_frames, ~triangulated)
        index = index_places(places, cameras_m, rates, likelihood, camera_height_m, has_boxes)
        return cls(scene_frames, index, T_world_pano, regions)

    def write(self, folder: Path) -> None:
        """Write the places to a folder, without the poses, which the map stores with its frames."""
        scene_frames = self.scene_frames
        frames = np.split(scene_frames.frame.astype(np.uint32), scene_frames.start[1:-1])
        rows = (
            {"name": np.array(scene_frames.names[name]), "frames": of_place, **objects}
            for name, of_place, objects in zip(scene_frames.name, frames, place_rows(self.index), strict=True)
        )
        write_columns(folder / _PLACES, rows)

    @classmethod
    def read(
        cls,
        folder: Path,
        height_mm: PackedColumn | None,
        deviation_mm: PackedColumn | None,
        num_frames: int,
        T_world_pano: np.ndarray,
        regions: Regions | None,
    ) -> MapPlaces:
        """Return the places that `write` wrote.

        Args:
            folder: The folder of `write`.
            height_mm: The packed heights of the frames' cameras; None if no frame has one.
            deviation_mm: The packed deviations of triangulated objects; None if no frame has one.
            num_frames: Number of reference frames, S.
            T_world_pano: (S, 3, 4) poses of the frames.
            regions: The floor area of each place, or None.
        """
        columns = read_columns(folder / _PLACES, {**_SCENE_FRAMES_COLUMNS, **PLACE_COLUMNS}).columns
        names, frames = columns["name"], columns["frames"]
        scene_frames = SceneFrames(names.words or (), names.values.astype(int), frames.values.astype(int), frames.start)
        height_m = np.full(num_frames, np.nan)
        if height_mm is not None:
            height_m[np.diff(height_mm.start) > 0] = height_mm.values / 1000
        camera_height_m = place_heights(scene_frames, height_m, T_world_pano[:, 2, 3])
        measured = np.ones(num_frames, bool)
        if deviation_mm is not None:
            measured = np.diff(deviation_mm.start) == 0
        cameras_m = T_world_pano[scene_frames.padded, :2, 3]
        index = read_places(columns, cameras_m, camera_height_m, _of_places(scene_frames, measured))
        return cls(scene_frames, index, T_world_pano, regions)

    def __len__(self) -> int:
        return len(self.scene_frames)

    @property
    def names(self) -> Sequence[str]:
        """The distinct names of the places."""
        return self.scene_frames.names

    @property
    def number(self) -> dict[str, int]:
        """Mapping from each place name to its position in `names`."""
        return self.scene_frames.number

    def windows(self, radius_m: float) -> Windows:
        """Return the windows of the places. A window consists of all objects of the map up to `radius_m` metres from
        the frames of a place."""
        return Windows(self.index, self.scene_frames, self._frames_m, radius_m)

    @cached_property
    def _frames_m(self) -> np.ndarray:
        """(S, 3) positions of the frames in the world."""
        return self.T_world_pano[:, :, 3].copy()

    @cached_property
    def _name_of_region(self) -> np.ndarray:
        """(R + 1,) index in `names` of the place of each region, -1 for a place that is not in the map.

        The last value, -1, stands for positions outside all regions.
        """
        regions = self.regions.places if self.regions else ()
        return np.array([*(self.number.get(place, -1) for place in regions), -1])

    def names_at(self, poses: Poses) -> np.ndarray:
        """Return the index (C,) in `names` of the place that contains each pose.

        This is the place of the region at the pose. If the pose is in no region, or if the place of the region is not
        in the map, this is the place whose objects gave the pose (`poses.place`).
        """
        matched = self.scene_frames.name[poses.place]
        if self.regions is None:
            return matched
        height_m = self._frames_m[self.scene_frames.frame[self.scene_frames.start[poses.place]], 2]
        region_name = self._name_of_region[self.regions.at(poses.shift_m, height_m)]
        return np.where(region_name >= 0, region_name, matched)

    def heights_m(self, name: int) -> np.ndarray:
        """Return the world heights (N,) in metres of the scene frames of the place `names[name]`, ascending."""
        return np.sort(self._frames_m[self.scene_frames.of_name(name), 2])

    def camera_z_m(self, place: int, camera_height_m: float) -> float:
        """Return the world z of a camera at the height `camera_height_m` above the floor of a place, in metres.

        If `camera_height_m` is unknown, or the height of the place's cameras above the floor is unknown, return the
        median world z of these cameras.
        """
        frames = self.scene_frames.frame[self.scene_frames.start[place] : self.scene_frames.start[place + 1]]
        return float(np.median(self._frames_m[frames, 2]) - self.index.camera_height_offset_m(camera_height_m)[place])

    def nearest_frames(self, names: np.ndarray, poses: Poses, row: np.ndarray) -> list[int]:
        """Return the scene frame of each place that is nearest to a pose.

        Args:
            names: (N,) indices in `names` of the names of places.
            poses: Poses in the world.
            row: (N,) index of the pose for each name, or -1 to return the first frame of the place.

        Returns:
            Indices of N frames.
        """
        near_m = np.append(poses.shift_m, [[np.nan, np.nan]], 0)[row]
        nearest: list[int] = self.scene_frames.nearest(names, self._frames_m[:, :2], near_m).tolist()
        return nearest


def _of_places(scene_frames: SceneFrames, of_frames: np.ndarray) -> np.ndarray:
    """Return for each place whether `of_frames` (S,) bool is true for all its scene frames, (K,) bool."""
    return np.array(
        [of_frames[frames].all() for frames in np.split(scene_frames.frame, scene_frames.start[1:-1])], bool
    )


def _places_at(regions: Regions, xy_m: np.ndarray, frame: ReferenceFrame) -> list[str | None]:
    """Return the place at each position (N, 2) on the storey of a frame, None outside all regions."""
    numbers = regions.at(xy_m, np.full(len(xy_m), frame.T_world_pano[2, 3]))
    return [regions.places[number] if number >= 0 else None for number in numbers.tolist()]
