"""Change a saved map: add, replace and remove places, merge maps, and calibrate. The panoramas of the map are not
needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from salframe.framework.errors import ConfigError, DataError, RequirementMissing, UnknownName, shorten, unknown
from salframe.framework.files.cache import Cache
from salframe.localization.calibration import MapCalibration
from salframe.localization.describing import describe_ahead
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import MapParts, read_map, write_map
from salframe.localization.preparing import Tell, silent
from salframe.panoramas.data_checks import data_notes
from salframe.panoramas.floors import FloorMasks, join_floors, without_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.opening import Progress, find_dataset, reference_frames
from salframe.topology.build import build_topology
from salframe.topology.building_map import BuildingMap, by_place
from salframe.topology.connections import restore_connections
from salframe.topology.derived_floors import extend_floors
from salframe.topology.store import TOPOLOGY, read_topology
from salframe.topology.topological_map import PartSource, TopologicalMap, TopologySources

_Floors = tuple[Sequence[FloorMasks], TopologySources]
"""Floors, and where they come from."""
_Change = Callable[[LocalizationMap, Sequence[FloorMasks], TopologySources], _Floors]
"""A function that receives a map, its floors and the sources of the floors. It changes the map, and returns the floors
and the sources of the changed map."""
_Source = tuple[Path, Sequence[ReferenceFrame]]
"""A map or dataset, and its frames."""


@dataclass(frozen=True)
class MapChange:
    """A change of a map.

    Attributes:
        added: Places that were added.
        replaced: Places that were replaced.
        removed: Places that were removed.
        places: Number of places of the changed map.
        frames: Number of reference frames of the changed map.
        notes: Warnings about the changed topology, such as a connection that was dropped.
    """

    added: tuple[str, ...]
    replaced: tuple[str, ...]
    removed: tuple[str, ...]
    places: int
    frames: int
    notes: tuple[str, ...]


def add_to_map(
    directory: str | Path,
    data: str | Path,
    *,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    engine: str | None = None,
    progress: Progress | None = None,
    tell: Tell = silent,
) -> MapChange:
    """Add the places of a dataset to the map in the folder `directory`, with the method and settings of the map.

    A place that the map already has is replaced, with all its frames. The panoramas of the map are not needed. The
    floors of the dataset and of the map are joined (`join_floors`), and the topology is computed again. If the floors
    of the map were derived and the dataset has no floor masks, the floors are extended (`extend_floors`). If this is
    impossible, `tell` is called with the reason, and the new places have no nodes. Dataset and map must have the same
    world frame. If an error occurs, the map does not change.

    Args:
        directory: folder of the map.
        data: name of a dataset or preset, a YAML file, or a folder with a manifest.json.
        data_dir: as in `find_dataset`.
        overrides: as in `find_dataset`.
        engine: as in `find_dataset`; it also describes the panoramas.
        progress: called with the name of the step, the number of items done and their total number.
        tell: called with messages for the user, one line each.

    Raises:
        DataError: In any of these cases: the folder contains no map with a localization method; a frame has the id of a
            frame of another place in the map; floors cannot be joined.
        InputMissing: Panoramas lack an input that the method needs.
    """
    directory = Path(directory)
    read_map(directory, MapParts.read_config)  # report a missing map before the data are prepared
    dataset = find_dataset(data, data_dir, overrides, progress, engine)
    frames = reference_frames(dataset)
    for note in data_notes(dataset):
        tell(f"warning: {note}")

    def add(localization: LocalizationMap, floors: Sequence[FloorMasks], sources: TopologySources) -> _Floors:
        places = {frame.place for frame in frames}
        remaining = [frame for frame in localization.frames if frame.place not in places]
        _check_ids([(directory, remaining), (Path(data), frames)])
        more = dataset.floors()
        new_floors = join_floors(floors, more)
        if floors and not more and sources.free_space in (PartSource.RANGE, PartSource.MAP_FILE):
            try:
                new_floors = extend_floors(floors, remaining, frames, sources, progress and partial(progress, "floors"))
            except (DataError, RequirementMissing) as error:
                tell(f"warning: places without floor masks get no topology nodes: {error}")
        method_progress = progress and partial(progress, localization.localizer.name)
        describe_ahead(localization.localizer.config, dataset, method_progress)
        localization.extend(
            frames, Cache(), dataset.content_key, floors=new_floors, progress=method_progress, tell=tell
        )
        return new_floors, sources.joined(TopologySources()) if more else sources

    return _change(directory, add)


def calibrate_map(directory: str | Path) -> MapCalibration:
    """Calibrate the probabilities of the map in the folder `directory` with its reference frames.

    If an error occurs, the map does not change.

    Raises:
        DataError: The folder contains no map with a localization method, or the method computes no probabilities.
    """
    made: list[MapCalibration] = []

    def calibrate(localization: LocalizationMap, floors: Sequence[FloorMasks], sources: TopologySources) -> _Floors:
        made.append(localization.calibrate())
        return floors, sources

    _change(Path(directory), calibrate)
    return made[0]


def remove_from_map(directory: str | Path, places: Iterable[str]) -> MapChange:
    """Remove places from the map in the folder `directory`.

    The frames, regions and floor areas of these places are removed, so that no route leads to or through them. The
    topology is computed again from the remaining places. If none of the remaining places has a floor, the topology is
    removed. If an error occurs, the map does not change.

    Raises:
        UnknownName: The map has no such place.
        ConfigError: No place would remain.
        DataError: The folder contains no map with a localization method.
    """
    removed = list(dict.fromkeys(places))

    def remove(localization: LocalizationMap, floors: Sequence[FloorMasks], sources: TopologySources) -> _Floors:
        names = _places(localization.frames, floors)
        for place in removed:
            if place not in names:
                raise UnknownName(unknown("place", place, names))
        if {frame.place for frame in localization.frames} <= set(removed):
            raise ConfigError(f"cannot remove all places of {directory}, expected at least one place to remain")
        remaining = without_places(floors, removed)
        localization.remove(removed, remaining)
        return remaining, sources

    return _change(Path(directory), remove)


def merge_maps(directory: str | Path, others: Iterable[str | Path]) -> MapChange:
    """Add the places of other maps to the map in the folder `directory`. The other maps do not change.

    All maps must have the same method, the same settings that affect descriptions, and the same world frame. Settings
    that affect only matching are those of the map in `directory`. Masks of the same floor are joined (`join_floors`),
    and floors at other heights are added. If the map in `directory` has a topology, the topology is computed again. If
    an error occurs, the map does not change.

    Raises:
        DataError: In any of these cases: a folder contains no map with a localization method; methods, settings or
            weights differ; two maps have a place or a frame of the same name; floors cannot be joined.
    """
    directory = Path(directory)

    def merge(localization: LocalizationMap, floors: Sequence[FloorMasks], sources: TopologySources) -> _Floors:
        maps, added = [(directory, localization.frames)], []
        for folder in map(Path, others):
            other, topology = read_map(folder, _read)
            _check_alike(localization.localizer, directory, other.localizer, folder)
            _check_places(maps, other.frames, folder)
            maps.append((folder, other.frames))
            if topology is not None:
                sources = sources.joined(topology.sources)
            floors = join_floors(floors, _floors(other, topology))
            added.append(other)
        _check_ids(maps)
        localization.merge(added, floors)
        return floors, sources

    return _change(directory, merge)


def _read(parts: MapParts) -> tuple[LocalizationMap, TopologicalMap | None]:
    """Read a map that can be changed, and its topology.

    Raises:
        DataError: The map has no localizer, so that places cannot be added to it.
    """
    return LocalizationMap.read(parts, indexed=False), read_topology(parts) if parts.has(TOPOLOGY) else None


def _floors(localization: LocalizationMap, topology: TopologicalMap | None) -> tuple[FloorMasks, ...]:
    return localization.floors if topology is None else topology.floors


def _sources(topology: TopologicalMap | None) -> TopologySources:
    return TopologySources() if topology is None else topology.sources


def _change(directory: Path, change: _Change) -> MapChange:
    """Read a map, change it and write it. Other processes cannot write to the map during this time."""
    read_map(
        directory, MapParts.read_config
    )  # without this check, write_map would create the parents of a missing folder
    with write_map(directory) as parts:
        localization, topology = read_map(directory, _read)
        old, old_floors = localization.frames, _floors(localization, topology)
        floors, sources = change(localization, old_floors, _sources(topology))
        notes: tuple[str, ...] = ()
        if topology is not None and floors:
            connections = topology.connections
            topology = build_topology(floors, by_place(localization.frames), topology.parameters, sources)
            topology = restore_connections(topology, connections)
            notes = topology.notes
        elif topology is not None:
            topology, notes = (
                None,
                ("the topology (graph for routes) was removed: none of the remaining places has a floor",),
            )
        BuildingMap(localization, topology).write(parts)
    frames, old_set, old_places = localization.frames, set(old), {frame.place for frame in old}
    changed = dict.fromkeys(frame.place for frame in frames if frame not in old_set)
    places = _places(frames, floors)
    return MapChange(
        added=tuple(place for place in changed if place not in old_places),
        replaced=tuple(place for place in changed if place in old_places),
        removed=tuple(place for place in _places(old, old_floors) if place not in places),
        places=len({frame.place for frame in frames}),
        frames=len(frames),
        notes=notes,
    )


def _places(frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]) -> list[str]:
    """Return the places of frames and the places of the floors' regions, without duplicates."""
    regions = (place for floor in floors for place in floor.regions.values())
    return list(dict.fromkeys([*(frame.place for frame in frames), *regions]))


def _check_alike(first: Localizer, folder: Path, other: Localizer, other_folder: Path) -> None:
    """Check that the descriptions of two localizers can be in one map: method, settings and weights are equal.

    Raises:
        DataError: Methods, settings or weights differ.
    """
    if first.name != other.name:
        raise DataError(
            f"the map {other_folder} was built with the method {other.name!r}, expected {first.name!r}, the method of "
            f"{folder}: build {other_folder} again with this method"
        )
    identity, other_identity = first.describe_identity(), other.describe_identity()
    if identity != other_identity:
        settings, other_settings = identity.get("settings", {}), other_identity.get("settings", {})
        differing = [key for key in settings if settings[key] != other_settings.get(key)]
        names = f"values of the setting {', '.join(differing)}" if differing else "weights of networks"
        raise DataError(
            f"the maps {other_folder} and {folder} were built with different {names}, expected the same settings and "
            f"weights of the method {first.name!r} in all maps to merge: build {other_folder} again "
            f"with those of {folder}"
        )


def _check_places(sources: Iterable[_Source], frames: Sequence[ReferenceFrame], folder: Path) -> None:
    """Check that no other map has a place of these frames.

    Raises:
        DataError: Another map has a place of the same name.
    """
    places = {frame.place for frame in frames}
    for other, other_frames in sources:
        if both := sorted(places & {frame.place for frame in other_frames}):
            raise DataError(
                f"the maps {other} and {folder} both contain the places {shorten(', '.join(both))}, expected different "
                "places: remove these places from one map, or rename them in the data of one map and build this map "
                "again"
            )


def _check_ids(sources: Iterable[_Source]) -> None:
    """Check that all frames have different ids.

    Raises:
        DataError: Two frames have the same id.
    """
    origin: dict[str, tuple[Path, str]] = {}
    for folder, frames in sources:
        for frame in frames:
            if frame.id in origin:
                other, place = origin[frame.id]
                raise DataError(
                    f"two frames have the id {frame.id} ({place} in {other}, {frame.place} in {folder}), "
                    "expected different ids: rename one of these frames in its data, and build its map again"
                )
            origin[frame.id] = folder, frame.place
