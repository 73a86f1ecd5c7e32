"""Change a saved map by places: add, replace and remove them, or merge maps. The map's panoramas are not needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from salframe.framework.errors import ConfigError, DataError, UnknownName, shorten, unknown
from salframe.framework.files.cache import Cache
from salframe.localization.describing import describe_ahead
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import MapParts, read_map, write_map
from salframe.localization.preparing import Tell, silent
from salframe.panoramas.camera_height import units_note
from salframe.panoramas.floors import FloorMasks, join_floors, without_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.opening import Progress, find_dataset, reference_frames
from salframe.topology.build import build_topology
from salframe.topology.building_map import BuildingMap
from salframe.topology.store import TOPOLOGY, read_topology
from salframe.topology.topological_map import TopologicalMap

_Change = Callable[[LocalizationMap, Sequence[FloorMasks]], Sequence[FloorMasks]]
"""A function that changes a map with these floors, and returns the floors of the changed map."""
_Source = tuple[Path, Sequence[ReferenceFrame]]
"""A map or dataset, and its frames."""


@dataclass(frozen=True)
class MapChange:
    """A change of a map: the places that were added, replaced and removed, the number of places and reference frames of
    the changed map, and the notes of its topology."""

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
    """Add the places of a dataset to the map in the folder `directory`, described as the map was.

    A place that the map has is replaced: all its frames are removed. Panoramas of the map are not described again. The
    dataset's floors are laid over the map's (`join_floors`), and a topology is computed again from floors and frames.
    Data and map share one world frame. The map changes in one step. data_dir, overrides and engine, which describes
    too, are as in `find_dataset`. Raises DataError where the folder holds no map with a method, where a frame has the
    id of another place's in the map, and on floors that cannot be joined; InputMissing on panoramas that lack what the
    method needs.
    """
    directory = Path(directory)
    read_map(directory, MapParts.read_config)  # reports a missing map before the data are prepared
    dataset = find_dataset(data, data_dir, overrides, progress, engine)
    frames = reference_frames(dataset)
    if units := units_note(frames):
        tell(f"warning: {units}")

    def add(known: LocalizationMap, floors: Sequence[FloorMasks]) -> Sequence[FloorMasks]:
        places = {frame.place for frame in frames}
        staying = [frame for frame in known.frames if frame.place not in places]
        _check_ids([(directory, staying), (Path(data), frames)])
        joined = join_floors(floors, dataset.floors())
        tracked = progress and partial(progress, known.localizer.name)
        describe_ahead(known.localizer.config, dataset, tracked)
        known.extend(frames, Cache(), dataset.content_key, floors=joined, progress=tracked, tell=tell)
        return joined

    return _change(directory, add)


def remove_from_map(directory: str | Path, places: Iterable[str]) -> MapChange:
    """Remove places from the map in the folder `directory`: their frames, and their regions with the floor in them, so
    that no route leads there or through.

    A topology is computed again from what stays, and dropped where no place with a floor stays. The map changes in one
    step. Raises UnknownName on a place that the map does not have, ConfigError where none would stay, DataError where
    the folder holds no map with a method.
    """
    removed = list(dict.fromkeys(places))

    def remove(known: LocalizationMap, floors: Sequence[FloorMasks]) -> Sequence[FloorMasks]:
        names = _places(known.frames, floors)
        for place in removed:
            if place not in names:
                raise UnknownName(unknown("place", place, names))
        if {frame.place for frame in known.frames} <= set(removed):
            raise ConfigError(f"received all places of {directory} to remove, expected one to stay")
        rest = without_places(floors, removed)
        known.remove(removed, rest)
        return rest

    return _change(Path(directory), remove)


def merge_maps(directory: str | Path, others: Iterable[str | Path]) -> MapChange:
    """Add the places of other maps, which do not change, to the map in the folder `directory`.

    All maps are of one method and described alike; settings that matter to matching only stay those of the first. All
    share one world frame: masks of the same floor are joined (`join_floors`), and floors at other heights are added. A
    topology is computed again from all; a map without topology stays one. The map changes in one step. Raises
    DataError where a folder holds no map with a method, where methods, settings or weights differ, where two maps have
    a place or a frame of one name, and on floors that cannot be joined.
    """
    directory = Path(directory)

    def merge(known: LocalizationMap, floors: Sequence[FloorMasks]) -> Sequence[FloorMasks]:
        sources, added = [(directory, known.frames)], []
        for folder in map(Path, others):
            other, topology = read_map(folder, _read)
            _check_alike(known.localizer, directory, other.localizer, folder)
            _check_places(sources, other.frames, folder)
            sources.append((folder, other.frames))
            floors = join_floors(floors, _floors(other, topology))
            added.append(other)
        _check_ids(sources)
        known.merge(added, floors)
        return floors

    return _change(directory, merge)


def _read(parts: MapParts) -> tuple[LocalizationMap, TopologicalMap | None]:
    """Read a map that can be changed, and its topology. Raises DataError where it has no method."""
    return LocalizationMap.read(parts, indexed=False), read_topology(parts) if parts.has(TOPOLOGY) else None


def _floors(known: LocalizationMap, topology: TopologicalMap | None) -> tuple[FloorMasks, ...]:
    return known.floors if topology is None else topology.floors


def _change(directory: Path, change: _Change) -> MapChange:
    """Read a map, change it and write it, while no other process writes to it."""
    read_map(directory, MapParts.read_config)  # or write_map would create the folders above one that does not exist
    with write_map(directory) as parts:
        known, topology = read_map(directory, _read)
        old, old_floors = known.frames, _floors(known, topology)
        floors = change(known, old_floors)
        notes: tuple[str, ...] = ()
        if topology is not None and floors:
            topology = build_topology(floors, known.frames, topology.parameters)
            notes = topology.notes
        elif topology is not None:
            topology, notes = None, ("the map has no topology any more: none of its places has a floor",)
        BuildingMap(known, topology).write(parts)
    frames, kept, before = known.frames, set(old), {frame.place for frame in old}
    fresh = dict.fromkeys(frame.place for frame in frames if frame not in kept)
    after = _places(frames, floors)
    return MapChange(
        added=tuple(place for place in fresh if place not in before),
        replaced=tuple(place for place in fresh if place in before),
        removed=tuple(place for place in _places(old, old_floors) if place not in after),
        places=len({frame.place for frame in frames}),
        frames=len(frames),
        notes=notes,
    )


def _places(frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]) -> list[str]:
    """The places of frames, and those that floors have regions of, each once."""
    regions = (place for floor in floors for place in floor.regions.values())
    return list(dict.fromkeys([*(frame.place for frame in frames), *regions]))


def _check_alike(first: Localizer, folder: Path, other: Localizer, other_folder: Path) -> None:
    """Raises DataError on localizers whose descriptions do not belong in one map."""
    if first.name != other.name:
        raise DataError(f"{other_folder} is a map of {other.name}, expected one of {first.name} as {folder}")
    one, two = first.describe_identity(), other.describe_identity()
    if one != two:
        settings, others = one.get("settings", {}), two.get("settings", {})
        differing = [key for key in settings if settings[key] != others.get(key)]
        raise DataError(
            f"{other_folder} was described with other {', '.join(differing) or 'weights'} than {folder}, "
            f"expected the same settings of {first.name}"
        )


def _check_places(known: Iterable[_Source], frames: Sequence[ReferenceFrame], folder: Path) -> None:
    """Raises DataError on frames of places that another map has."""
    places = {frame.place for frame in frames}
    for other, theirs in known:
        if both := sorted(places & {frame.place for frame in theirs}):
            raise DataError(
                f"both {other} and {folder} have {shorten(', '.join(both))}, expected places of different names: "
                "remove them from one of the two, or build it with other names"
            )


def _check_ids(sources: Iterable[_Source]) -> None:
    """Raises DataError on two frames of one id."""
    known: dict[str, tuple[Path, str]] = {}
    for folder, frames in sources:
        for frame in frames:
            if frame.id in known:
                other, place = known[frame.id]
                raise DataError(
                    f"the frame {frame.id} is of {place} in {other} and of {frame.place} in {folder}, "
                    "expected different ids"
                )
            known[frame.id] = folder, frame.place
