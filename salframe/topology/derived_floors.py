"""Floors of data without floor masks, derived from panoramas with poses and range."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from salframe.framework.errors import FRAME_ERRORS, DataError
from salframe.panoramas.camera_height import USUAL_M, camera_height
from salframe.panoramas.floors import MAX_PIXELS, SAME_FLOOR_M, FloorMasks, floor_numbers, without_places
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.samples import load_samples
from salframe.topology.free_space import FreeSpace, OccupancyGrid
from salframe.topology.region_names import name_regions
from salframe.topology.regions import grow_regions, regions_at, split_regions
from salframe.topology.storeys import storeys
from salframe.topology.topological_map import PartSource, TopologySources

NUM_HEIGHT_FRAMES = 30
"""Maximum number of frames per storey from which the height of the floor is measured."""
NUM_SAMPLES = 5
"""Number of frames that are read to check whether the frames have range."""
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
    """The frames of a storey, their positions (N, 2) in the world, the height z_m of the floor, and the free space."""

    frames: tuple[ReferenceFrame, ...]
    xy_m: np.ndarray
    z_m: float
    space: FreeSpace


def has_places(frames: Sequence[ReferenceFrame]) -> bool:
    """Return whether frames have places. In data that were imported without places, the place of each frame is its
    id."""
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
    have no places (the place of each frame is its id), regions are split where the free space narrows (`split_regions`)
    and named by their objects (`name_regions`). If no such region contains two frames, the ids are used as places.

    Args:
        frames: The reference frames.
        labels: Function that returns the labels of the objects in a frame. They determine the names of the regions if
            the frames have no places. None: no labels are known.
        progress: Called as progress(done, total) with numbers of frames.
        space: The free space of the only storey, for example from the occupancy map of a robot; None: it is computed
            from the range images.

    Raises:
        DataError: In any of these cases: a free space was passed for frames on several storeys; the frames have no
            range; no frame shows free floor; a storey is too large for one grid.
        RequirementMissing: scikit-image is not installed.
    """
    if space is None and not any(panorama.range_m is not None for _, panorama in load_samples(frames, NUM_SAMPLES)):
        raise DataError(
            "the data have neither floor masks nor range images to derive floors from, expected one of them"
        )
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
            notes.append(f"the storey at z = {storey.z_m:.1f} m has no floor: its range images show no free floor")
    if not floors:
        raise DataError(f"no floor can be derived: {'; '.join(notes)}")
    regions_from = PartSource.PLACES if split is None else PartSource.FREE_SPACE
    space_from = PartSource.RANGE if space is None else PartSource.MAP_FILE
    sources = TopologySources(free_space=space_from, regions=regions_from)
    placed = tuple(replace(frame, place=places.get(frame.id, frame.place)) for frame in frames)
    return FloorPlan(tuple(floors), placed, sources, tuple(notes))


def extend_floors(
    floors: Sequence[FloorMasks],
    frames: Sequence[ReferenceFrame],
    added: Sequence[ReferenceFrame],
    sources: TopologySources,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[FloorMasks, ...]:
    """Extend derived floors by new reference frames. The range images of the map are not needed.

    The free space of the new frames is added to the free space of the map. If the free space of the map comes from a
    map file, it does not change. All regions grow again from the places of the frames.

    Args:
        floors: The derived floors.
        frames: The reference frames of the map that remain. They need no range.
        added: The new reference frames. A new place replaces a place of the map with the same name.
        sources: Where the floors come from.
        progress: Called as progress(done, total) with numbers of new frames.

    Raises:
        DataError: The places of the map were derived and the new frames have no places, or `derive_floors` fails.
        RequirementMissing: scikit-image is not installed.
    """
    if sources.regions is PartSource.FREE_SPACE and not has_places(added):
        raise DataError(
            "the new frames have no places. The places of this map were derived from free space, which is only "
            "possible for all frames together: build the map again from all data"
        )
    extended = list(floors)
    if sources.free_space is PartSource.RANGE:
        extended = list(without_places(floors, {frame.place for frame in added}))
        for floor in derive_floors(added, progress=progress).floors:
            same = next((k for k, one in enumerate(extended) if abs(one.z_m - floor.z_m) < SAME_FLOOR_M), None)
            if same is None:
                extended.append(floor)
            else:
                extended[same] = _unite(extended[same], floor)
    extended.sort(key=lambda floor: floor.z_m)
    scenes = [frame for frame in (*frames, *added) if frame.kind is FrameKind.SCENE]
    xyz_m = np.array([frame.T_world_pano[:3, 3] for frame in scenes]).reshape(-1, 3)
    numbers = floor_numbers(extended, xyz_m)
    grown = []
    for number, floor in enumerate(extended):
        members = np.flatnonzero(numbers == number)
        space = FreeSpace(floor.free & ~floor.obstacle, floor.obstacle, floor.origin_m, floor.resolution_m)
        region, regions = grow_regions(space, xyz_m[members, :2], [scenes[k].place for k in members.tolist()])
        if region.any():
            grown.append(replace(floor, region=region, regions=regions))
    return tuple(grown)


def _unite(floor: FloorMasks, other: FloorMasks) -> FloorMasks:
    """Return a floor with the free space of two floors, without regions. Both floors must have the same resolution."""
    size_m = floor.resolution_m
    corners_m = np.array([one.origin_m for one in (floor, other)])
    left_m, top_m = float(corners_m[:, 0].min()), float(corners_m[:, 1].max())
    starts = np.round((corners_m - (left_m, top_m)) / (size_m, -size_m)).astype(int)[:, ::-1]
    shape = tuple(np.max([starts[k] + one.free.shape for k, one in enumerate((floor, other))], axis=0).tolist())
    if shape[0] * shape[1] > MAX_PIXELS:
        raise DataError(
            f"the map and the new frames together span {shape[1]} x {shape[0]} cells of {size_m:g} m at z = "
            f"{floor.z_m:.1f} m, expected at most {MAX_PIXELS} cells: use poses in the world frame of the map"
        )
    walkable, low = np.zeros(shape, bool), np.zeros(shape, bool)
    for (row, column), one in zip(starts.tolist(), (floor, other), strict=True):
        window = slice(row, row + one.free.shape[0]), slice(column, column + one.free.shape[1])
        walkable[window] |= one.free & ~one.obstacle
        low[window] |= one.obstacle
    low &= ~walkable
    return FloorMasks(walkable | low, np.zeros(shape, np.int32), low, size_m, (left_m, top_m), {}, floor.z_m)


def _masks(storey: _Storey, region: np.ndarray, regions: Mapping[int, str]) -> FloorMasks:
    space = storey.space
    return FloorMasks(space.floor, region, space.low, space.resolution_m, space.origin_m, regions, storey.z_m)


def _find_storeys(
    frames: Sequence[ReferenceFrame],
    space: FreeSpace | None,
    progress: Callable[[int, int], None] | None,
    notes: list[str],
) -> list[_Storey]:
    """Return the storeys with their free space, lowest first. `space` is the free space of a single storey; None: it is
    computed from the range images."""
    levels = []
    groups = storeys(np.array([frame.T_world_pano[2, 3] for frame in frames]))
    if space is not None and len(groups) > 1:
        raise DataError(
            f"the frames are on {len(groups)} storeys, expected one, because the occupancy map (--floor-map) shows one"
        )
    on_stairs = sorted(set(range(len(frames))) - set(np.concatenate(groups).tolist()))
    if on_stairs:
        notes.append(
            f"{len(on_stairs)} frames are between the storeys, and are ignored: "
            f"{_listed([frames[k].id for k in on_stairs])}"
        )
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
    """Return the free space of a storey from its frames at positions xy_m (N, 2). Append a note on frames without
    range.

    Frames that cannot be read are left out. The localizer reports them later.
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
    """Return the height of the floor below cameras, in the world frame in metres: the median over the frames that show
    the floor. If no frame shows the floor, the floor is assumed USUAL_M below the cameras."""
    heights_m = []
    for frame, panorama in load_samples(frames, NUM_HEIGHT_FRAMES):
        height_m = None if panorama.range_m is None else camera_height(panorama.range_m)
        if height_m is not None and isinstance(frame, ReferenceFrame):
            heights_m.append(frame.T_world_pano[2, 3] - height_m)
    if not heights_m:
        heights_m = [frame.T_world_pano[2, 3] - USUAL_M for frame in frames]
    return float(np.median(heights_m))
