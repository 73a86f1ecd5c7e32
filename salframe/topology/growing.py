"""Maps that change by places: added, replaced, removed, taken from other maps. What is remembered of the others stays,
no panorama of theirs is needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from salframe.framework.cache import Cache
from salframe.framework.errors import ConfigError, DataError, UnknownName, shorten, unknown
from salframe.localization.describing import describe_ahead
from salframe.localization.localizer import Localizer
from salframe.localization.map_folder import read_map, write_map
from salframe.localization.map_parts import read_method
from salframe.localization.saved_map import Tell, read_unindexed, silent
from salframe.panoramas.camera_height import units_note
from salframe.panoramas.floors import FloorMasks, join_floors, without_places
from salframe.panoramas.frames import MapFrame
from salframe.panoramas.opening import Progress, find_dataset, mapping_frames
from salframe.topology.build import build_topology
from salframe.topology.store import TOPOLOGY, read_topology, write_topology
from salframe.topology.topological_map import TopologicalMap

_Change = Callable[[Localizer, Sequence[FloorMasks]], Sequence[FloorMasks]]
"""What changes a localizer that remembers a map on some floors, and gives the floors of the changed map."""
_Source = tuple[Path, Sequence[MapFrame]]
"""Where frames come from, a map or data, and the frames."""


@dataclass(frozen=True)
class MapChange:
    """What became of a map: the places that were added, replaced and removed, how many places and mapping frames it has
    now, and what the reader of its topology must know."""

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
    """Describe a data set's mapping frames as the map in the folder `directory` was, and add their places to it.

    A place that the map has is replaced: all its frames give way to the data set's. Panoramas of the map are not
    described again. The data set's floors are laid over the map's (`join_floors`), and a topological map is made anew
    from floors and frames. Data and map share one world frame. The map changes whole. data_dir, overrides and engine,
    which describes too, are as of `find_dataset`. Raises DataError where the folder holds no map with a method, where a
    frame has the id of another place's in the map, and on floors that cannot be joined; InputMissing on panoramas that
    lack what the method needs.
    """
    directory = Path(directory)
    read_map(directory, read_method)  # what is no map is told before the data are prepared
    dataset = find_dataset(data, data_dir, overrides, progress, engine)
    frames = mapping_frames(dataset)
    if units := units_note(frames):
        tell(f"warning: {units}")

    def add(localizer: Localizer, floors: Sequence[FloorMasks]) -> Sequence[FloorMasks]:
        places = {frame.place for frame in frames}
        staying = [frame for frame in localizer.mapped_frames if frame.place not in places]
        _check_ids([(directory, staying), (Path(data), frames)])
        joined = join_floors(floors, dataset.floors())
        tracked = progress and partial(progress, localizer.name)
        describe_ahead(localizer.config, dataset, tracked)
        for note in localizer.extend(frames, Cache(), dataset.content_key, tracked, joined):
            tell(note)
        return joined

    return _change(directory, add)


def remove_from_map(directory: str | Path, places: Iterable[str]) -> MapChange:
    """Remove places from the map in the folder `directory`: what it remembers of their frames, and their regions with
    the floor in them, so that no way leads there or through.

    A topological map is made anew from what stays. The map changes whole. Raises UnknownName on a place that it does
    not have, ConfigError where none would stay, DataError where the folder holds no map with a method.
    """
    removed = list(dict.fromkeys(places))

    def remove(localizer: Localizer, floors: Sequence[FloorMasks]) -> Sequence[FloorMasks]:
        known = _places(localizer.mapped_frames, floors)
        for place in removed:
            if place not in known:
                raise UnknownName(unknown("place", place, list(known)))
        if {frame.place for frame in localizer.mapped_frames} <= set(removed):
            raise ConfigError(f"received all places of {directory} to remove, expected one to stay")
        rest = without_places(floors, removed)
        localizer.remove(removed, rest)
        return rest

    return _change(Path(directory), remove)


def merge_maps(directory: str | Path, others: Iterable[str | Path]) -> MapChange:
    """Add the places of other maps, which stay as they are, to the map in the folder `directory`.

    All are of one method and describe alike; what matters to matching only stays as in the first. All share one world
    frame: where they have the same floor, masks are joined (`join_floors`), and floors at other heights are added.
    A topological map is made anew from all; a map without topology stays one. The map changes whole. Raises DataError
    where a folder holds no map with a method, where methods, settings or weights differ, where two maps have a place or
    a frame of one name, and on floors that cannot be joined.
    """
    directory = Path(directory)

    def merge(localizer: Localizer, floors: Sequence[FloorMasks]) -> Sequence[FloorMasks]:
        frames, taken = [(directory, localizer.mapped_frames)], []
        for folder in map(Path, others):
            other = read_map(folder, _read)
            _check_alike(localizer, directory, other.localizer, folder)
            _check_places(frames, other.localizer.mapped_frames, folder)
            frames.append((folder, other.localizer.mapped_frames))
            floors = join_floors(floors, other.floors)
            taken.append(other.localizer)
        _check_ids(frames)
        localizer.merge(taken, floors)
        return floors

    return _change(directory, merge)


@dataclass(frozen=True)
class _Parts:
    """The parts of a map: its localizer, which remembers it, and its topology where it has one."""

    localizer: Localizer
    topology: TopologicalMap | None

    @property
    def floors(self) -> tuple[FloorMasks, ...]:
        return self.localizer.floors if self.topology is None else self.topology.floors


def _read(parts: Path) -> _Parts:
    return _Parts(read_unindexed(parts), read_topology(parts) if (parts / TOPOLOGY).exists() else None)


def _change(directory: Path, change: _Change) -> MapChange:
    """Read a map, change it and write it, while no other process writes to it."""
    read_map(directory, read_method)  # or write_map would make the folders above one that is not there
    with write_map(directory) as parts:
        known = read_map(directory, _read)
        localizer, old, old_floors = known.localizer, known.localizer.mapped_frames, known.floors
        floors = change(localizer, old_floors)
        localizer.write_parts(parts)
        notes: tuple[str, ...] = ()
        if known.topology is not None:
            topology = build_topology(floors, localizer.mapped_frames, known.topology.parameters)
            write_topology(parts, topology)
            notes = topology.notes
    frames = localizer.mapped_frames
    kept, before = set(old), {frame.place for frame in old}
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


def _places(frames: Sequence[MapFrame], floors: Sequence[FloorMasks]) -> list[str]:
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


def _check_places(known: Iterable[_Source], frames: Sequence[MapFrame], folder: Path) -> None:
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
