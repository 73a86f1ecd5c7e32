"""Floors of data without floor masks, derived from panoramas with poses and range."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from salframe.framework.errors import FRAME_ERRORS, DataError
from salframe.panoramas.camera_height import USUAL_M, camera_height
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.samples import load_samples
from salframe.topology.free_space import FreeSpace, OccupancyGrid
from salframe.topology.region_names import name_regions
from salframe.topology.regions import grow_regions, regions_at, split_regions
from salframe.topology.storeys import storeys
from salframe.topology.topological_map import PartSource, TopologySources

NUM_HEIGHT_FRAMES = 30
"""Maximum number of frames per storey that the height of the floor is measured in."""
NUM_SAMPLES = 5
"""Number of frames that are read to find out whether the frames have range."""
NUM_LISTED = 3
"""Number of frames to name in a note."""


@dataclass(frozen=True)
class FloorPlan:
    """Floors of a building, and its reference frames.

    Attributes:
        floors: The floors, lowest first.
        frames: The reference frames. If regions were derived, the place of a frame is its region.
        sources: Where the floors come from.
        notes: Notes for the user, one line each.
    """

    floors: tuple[FloorMasks, ...]
    frames: tuple[ReferenceFrame, ...]
    sources: TopologySources = field(default_factory=TopologySources)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Storey:
    """The frames of a storey, their positions (N, 2), the height of the floor, and the free space."""

    frames: tuple[ReferenceFrame, ...]
    xy_m: np.ndarray
    z_m: float
    space: FreeSpace


def has_places(frames: Sequence[ReferenceFrame]) -> bool:
    """Return whether frames have places. An import without places makes each frame a place, named by its id."""
    return any(frame.place != frame.id for frame in frames)


def derive_floors(
    frames: Sequence[ReferenceFrame],
    labels: Callable[[ReferenceFrame], Sequence[str]] | None = None,
    progress: Callable[[int, int], None] | None = None,
    space: FreeSpace | None = None,
) -> FloorPlan:
    """Derive the floors of a building from its reference frames.

    Storeys are clusters of camera heights. The free space of a storey is an occupancy grid of the range images
    (`OccupancyGrid`). Its regions grow from the places of the frames of kind "scene" (`grow_regions`). If the frames
    have no places, regions are split where the free space narrows (`split_regions`) and named by their objects
    (`name_regions`). Frames whose places are their ids have no places if two of them stand in one such region.

    Args:
        frames: The reference frames.
        labels: Returns the labels of the objects in a frame, which name the regions of frames without places.
        progress: Called as progress(done, total) with numbers of frames.
        space: The free space of the only storey, such as that of a robot's map; None: from the range images.

    Raises:
        DataError: A free space was passed for frames on several storeys, the frames have no range, no free floor was
            seen, or a storey is too large for one grid.
        RequirementMissing: scikit-image is not installed.
    """
    if space is None and not any(panorama.range_m is not None for _, panorama in load_samples(frames, NUM_SAMPLES)):
        raise DataError("the data have no floor masks and no range images to derive floors from, expected one of them")
    notes: list[str] = []
    levels = _find_storeys(frames, space, progress, notes)
    split = None if has_places(frames) else [split_regions(storey.space) for storey in levels]
    if split is not None:
        counts = [
            np.bincount(regions_at(region, one.space, one.xy_m))[1:] for region, one in zip(split, levels, strict=True)
        ]
        if max(count.max(initial=0) for count in counts) < 2:
            split = None
    floors, places = [], {}
    numbers: Counter[str] = Counter()
    for index, storey in enumerate(levels):
        if split is not None:
            region = split[index]
            frame_region = regions_at(region, storey.space, storey.xy_m)
            frame_labels = [labels(frame) if labels else () for frame in storey.frames]
            regions = name_regions(frame_region, frame_labels, int(region.max(initial=0)), numbers)
            for frame, label in zip(storey.frames, frame_region.tolist(), strict=True):
                places[frame.id] = regions.get(label, frame.place)
        else:
            scenes = [number for number, frame in enumerate(storey.frames) if frame.kind is FrameKind.SCENE]
            scene_places = [storey.frames[number].place for number in scenes]
            region, regions = grow_regions(storey.space, storey.xy_m[scenes], scene_places)
        if region.any():
            floors.append(_masks(storey, region, regions))
        else:
            notes.append(f"the storey at z = {storey.z_m:.1f} m has no floor: no free floor of a place was seen")
    if not floors:
        raise DataError(f"no floor can be derived: {'; '.join(notes)}")
    regions_from = PartSource.PLACES if split is None else PartSource.FREE_SPACE
    space_from = PartSource.RANGE if space is None else PartSource.MAP_FILE
    sources = TopologySources(free_space=space_from, regions=regions_from)
    placed = tuple(replace(frame, place=places.get(frame.id, frame.place)) for frame in frames)
    return FloorPlan(tuple(floors), placed, sources, tuple(notes))


def _masks(storey: _Storey, region: np.ndarray, regions: Mapping[int, str]) -> FloorMasks:
    space = storey.space
    return FloorMasks(space.floor, region, space.low, space.resolution_m, space.origin_m, regions, storey.z_m)


def _find_storeys(
    frames: Sequence[ReferenceFrame],
    space: FreeSpace | None,
    progress: Callable[[int, int], None] | None,
    notes: list[str],
) -> list[_Storey]:
    """Return the storeys with their free space, lowest first. `space` is that of a single storey, None if unknown."""
    levels = []
    groups = storeys(np.array([frame.T_world_pano[2, 3] for frame in frames]))
    if space is not None and len(groups) > 1:
        raise DataError(f"the frames are on {len(groups)} storeys, expected one: a map file shows one storey")
    on_stairs = sorted(set(range(len(frames))) - set(np.concatenate(groups).tolist()))
    if on_stairs:
        notes.append(f"{len(on_stairs)} frames are on no storey: {_listed([frames[k].id for k in on_stairs])}")
    count = _Count(len(frames) - len(on_stairs), progress)
    for numbers in groups:
        members = tuple(frames[number] for number in numbers)
        xy_m = np.array([frame.T_world_pano[:2, 3] for frame in members])
        z_m = _floor_height(members)
        free = _scan(members, xy_m, z_m, count, notes) if space is None else space
        levels.append(_Storey(members, xy_m, z_m, free))
    return levels


class _Count:
    """Reports the number of frames that were read."""

    def __init__(self, total: int, progress: Callable[[int, int], None] | None) -> None:
        self._done, self._total, self._progress = 0, total, progress

    def step(self) -> None:
        self._done += 1
        if self._progress:
            self._progress(self._done, self._total)


def _listed(ids: Sequence[str]) -> str:
    """Return the first ids of a list in words."""
    return f"{', '.join(ids[:NUM_LISTED])}{', ...' if len(ids) > NUM_LISTED else ''}"


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
        notes.append(
            f"{len(without_range)} of {len(frames)} frames at z = {z_m:.1f} m add no free space, because they have no "
            f"range: {_listed(without_range)}"
        )
    return grid.free_space(xy_m)


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
