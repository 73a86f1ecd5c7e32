"""Floors of data without floor masks, derived from panoramas with poses and range."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from salframe.framework.errors import FRAME_ERRORS, DataError
from salframe.panoramas.camera_height import USUAL_M, camera_height
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.samples import load_samples
from salframe.topology.free_space import FreeSpace, OccupancyGrid
from salframe.topology.region_names import name_regions
from salframe.topology.regions import grow_regions, split_regions
from salframe.topology.topological_map import PartSource, TopologySources

MIN_STOREY_M = 1.5
"""Minimum difference in height between two successive cameras of different storeys."""
NUM_HEIGHT_FRAMES = 30
"""Maximum number of frames per storey that the height of the floor is measured in."""
NUM_SAMPLES = 5
"""Number of frames that are read to find out whether the frames have range."""
NUM_LISTED = 3
"""Number of frames to name in a note."""


@dataclass(frozen=True)
class DerivedFloors:
    """Floors that were derived from reference frames.

    Attributes:
        floors: The floors, lowest first.
        frames: The reference frames, in their order. If regions were derived, the place of a frame is its region.
        sources: How each part was derived.
        notes: Notes for the user, one line each.
    """

    floors: tuple[FloorMasks, ...]
    frames: tuple[ReferenceFrame, ...]
    sources: TopologySources
    notes: tuple[str, ...]


def has_places(frames: Sequence[ReferenceFrame]) -> bool:
    """Return whether frames have places. An import without places makes each frame a place, named by its id."""
    return any(frame.place != frame.id for frame in frames)


def derive_floors(
    frames: Sequence[ReferenceFrame],
    labels: Mapping[str, Sequence[str]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DerivedFloors:
    """Derive the floors of a building from its reference frames.

    Storeys are clusters of camera heights. The free space of a storey is an occupancy grid of the range images
    (`OccupancyGrid`). Its regions grow from the places of the frames of kind "scene" (`grow_regions`). Without places,
    regions are split where the free space narrows (`split_regions`) and named by their objects (`name_regions`).

    Args:
        frames: The reference frames.
        labels: Labels of the objects in each frame, by its id, which name the regions of frames without places.
        progress: Called as progress(done, total) with numbers of frames.

    Raises:
        DataError: The frames have no range, no free floor was seen, or a storey is too large for one grid.
        RequirementMissing: scikit-image is not installed.
    """
    if not any(panorama.range_m is not None for _, panorama in load_samples(frames, NUM_SAMPLES)):
        raise DataError("the reference frames have no range, expected range images or floor masks")
    is_split = not has_places(frames)
    floors, places, notes = [], {}, []
    names: Counter[str] = Counter()
    count = _Count(len(frames), progress)
    for numbers in storeys(np.array([frame.T_world_pano[2, 3] for frame in frames])):
        members = [frames[number] for number in numbers]
        z_m = _floor_height(members)
        xy_m = np.array([frame.T_world_pano[:2, 3] for frame in members])
        space = _scan(members, xy_m, z_m, count, notes)
        if is_split:
            region = split_regions(space)
            frame_region = _regions_at(region, space, xy_m)
            seen = [(labels or {}).get(frame.id, ()) for frame in members]
            regions = name_regions(frame_region, seen, int(region.max(initial=0)), names)
            places |= {frame.id: regions[at] for frame, at in zip(members, frame_region.tolist(), strict=True) if at}
        else:
            scenes = [number for number, frame in enumerate(members) if frame.kind is FrameKind.SCENE]
            region, regions = grow_regions(space, xy_m[scenes], [members[number].place for number in scenes])
        if region.any():
            masks = (space.floor, region, space.low, space.resolution_m, space.origin_m, regions, z_m)
            floors.append(FloorMasks(*masks))
        else:
            notes.append(f"the storey at z = {z_m:.1f} m has no floor: no free floor of a place was seen")
    if not floors:
        raise DataError(f"no floor can be derived: {'; '.join(notes)}")
    regions_from = PartSource.FREE_SPACE if is_split else PartSource.PLACES
    sources = TopologySources(free_space=PartSource.RANGE, regions=regions_from)
    placed = tuple(replace(frame, place=places.get(frame.id, frame.place)) for frame in frames)
    return DerivedFloors(tuple(floors), placed, sources, tuple(notes))


class _Count:
    """Reports the number of frames that were read."""

    def __init__(self, total: int, progress: Callable[[int, int], None] | None) -> None:
        self._done, self._total, self._progress = 0, total, progress

    def step(self) -> None:
        self._done += 1
        if self._progress:
            self._progress(self._done, self._total)


def _scan(frames: Sequence[ReferenceFrame], xy_m: np.ndarray, z_m: float, count: _Count, notes: list[str]) -> FreeSpace:
    """Return the free space of a storey from its frames, at positions xy_m (N, 2), and note those without range.

    Frames that cannot be read are left out; the localizer reports them.
    """
    grid, without_range = OccupancyGrid(xy_m, z_m), []
    for frame in frames:
        range_m = None
        with suppress(*FRAME_ERRORS):
            range_m = frame.load().range_m
        if range_m is None:
            without_range.append(frame.id)
        else:
            grid.add(range_m, frame.T_world_pano)
        count.step()
    if without_range:
        listed = f"{', '.join(without_range[:NUM_LISTED])}{', ...' if len(without_range) > NUM_LISTED else ''}"
        notes.append(
            f"{len(without_range)} of {len(frames)} frames at z = {z_m:.1f} m add no free space, because they have no "
            f"range: {listed}"
        )
    return grid.free_space(xy_m)


def storeys(camera_z_m: np.ndarray) -> list[np.ndarray]:
    """Return the indices of the cameras of each storey, lowest first.

    A storey ends where the next higher camera is at least MIN_STOREY_M higher.

    Args:
        camera_z_m: (N,) heights of the cameras in the world frame.
    """
    order = np.argsort(camera_z_m, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(camera_z_m[order]) >= MIN_STOREY_M) + 1)


def _floor_height(frames: Sequence[ReferenceFrame]) -> float:
    """Return the height of the floor below cameras in the world frame, in metres: the median over frames that see it,
    or USUAL_M below the cameras where none does."""
    heights_m = []
    for frame, panorama in load_samples(frames, NUM_HEIGHT_FRAMES):
        height_m = None if panorama.range_m is None else camera_height(panorama.range_m)
        if height_m is not None and isinstance(frame, ReferenceFrame):
            heights_m.append(frame.T_world_pano[2, 3] - height_m)
    if not heights_m:
        heights_m = [frame.T_world_pano[2, 3] - USUAL_M for frame in frames]
    return float(np.median(heights_m))


def _regions_at(region: np.ndarray, space: FreeSpace, xy_m: np.ndarray) -> np.ndarray:
    """Return the region label at positions (N, 2), (N,) int, 0 outside of the regions."""
    cells = space.cells(xy_m)
    is_inside = ((cells >= 0) & (cells < region.shape)).all(1)
    row, column = np.where(is_inside[:, None], cells, 0).T
    return np.where(is_inside, region[row, column], 0)
