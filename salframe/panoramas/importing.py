"""Write a recording of a foreign format as a folder of panoramas."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.config import parse_override
from salframe.framework.errors import ConfigError, DataError, counted, describe_error
from salframe.framework.files.reading import read_json
from salframe.framework.files.writing import atomic_path, lock_folder, write_json, write_text
from salframe.framework.overrides import Override
from salframe.panoramas.data_checks import data_notes
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.folder_format import (
    FrameEntry,
    RangeKeys,
    TruthEntry,
    image_names,
    is_written,
    write_floor,
    write_manifest,
    write_objects,
    write_panorama,
)
from salframe.panoramas.frames import Fold, ReferenceFrame
from salframe.panoramas.import_floors import read_floors, with_regions
from salframe.panoramas.import_selection import SelectedPanorama, select
from salframe.panoramas.importer import ImageFiles, Importer, PlaceSource, Recording
from salframe.panoramas.motion_file import COLUMNS
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import visible_instances
from salframe.panoramas.range_encoding import RangeEncoding

SETTINGS = "import.json"
"""File with the format, the settings and the source of an imported folder."""
OBJECTS, ODOMETRY = "objects.parquet", "odometry.csv"


@dataclass(frozen=True, eq=False)
class ImportResult:
    """The folder that `import_data` wrote.

    Attributes:
        folder: The folder.
        num_references: Number of reference frames.
        num_queries: Number of queries; the views of a sequence are one query.
        num_places: Number of places of reference frames.
        place_from: Source of the names of places.
        failures: A one-line error for each panorama that could not be read, by id.
        notes: Warnings, one line each: images that were left out, and conventions that are probably wrong.
        seconds: Time of the import.
    """

    folder: Path
    num_references: int
    num_queries: int
    num_places: int
    place_from: PlaceSource
    failures: Mapping[str, str]
    notes: tuple[str, ...]
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON."""
        return {**asdict(self), "folder": str(self.folder)}

    def lines(self) -> list[str]:
        """Return the result as text."""
        frames = f"{self.num_references} reference frames in {self.num_places} places (--place-from {self.place_from})"
        return [f"{self.folder}: {frames}, {self.num_queries} queries, in {self.seconds:.1f} s"]


def find_importer(format: str, settings: Sequence[str] = ()) -> Importer:
    """Return an importer.

    Args:
        format: Name of the importer.
        settings: Settings as "key=value".

    Raises:
        UnknownName: There is no such importer.
        ConfigError: A setting is invalid.
        RequirementMissing: A package is not installed.
    """
    overrides = [Override(path, value) for path, value in map(parse_override, settings)]
    importer: Importer = registry().build("importer", configure("importer", format, {"kind": format}, overrides))
    return importer


def read_recording(importer: Importer, source: str | Path) -> Recording:
    """Return the panoramas of a recording. Raises DataError."""
    source = Path(source)
    if not source.exists():
        raise DataError(f"{source} does not exist, expected a recording in the format {importer.name}")
    return importer.read(source)


def import_data(
    format: str,
    source: str | Path,
    output: str | Path,
    *,
    settings: Sequence[str] = (),
    place_from: str | None = None,
    queries: str | Path | None = None,
    every: str | None = None,
    floors: str | Path | None = None,
    progress: Progress | None = None,
) -> ImportResult:
    """Write a recording of another format as a folder of panoramas, which every command accepts as a dataset.

    A panorama that cannot be read is left out. If the import is interrupted, the same call resumes it. Panoramas whose
    source files have changed are written again.

    Args:
        format: Name of the importer.
        source: The folder or file of the recording.
        output: The folder to write.
        settings: Settings of the importer as "key=value".
        place_from: Source of the places: "column", "region", "folder" or "none". With "none", each reference frame is a
            place of its own. None: the first source that names the place of every reference frame.
        queries: "every:N" makes every Nth panorama with a pose a query; otherwise a text file with the ids of queries,
            one a line. Panoramas without a pose are queries in any case.
        every: Minimum distance ("0.5m") or time ("2s") between panoramas with poses.
        floors: YAML file with floor masks in the world of the poses, as in the manifest (`import_floors.read_floors`).
            Each panorama gets the place of the region where it stands, with the source "region".
        progress: Called with the number of panoramas that are written.

    Raises:
        UnknownName: There is no such importer, or the file of queries has an id that no panorama has.
        ConfigError: An argument is invalid, or the folder has other content or was imported with other settings.
        DataError: The source is missing or malformed, or no reference panorama can be read.
    """
    start, output = time.perf_counter(), Path(output)
    importer = find_importer(format, settings)
    masks = [] if floors is None else read_floors(Path(floors))
    recording = with_regions(read_recording(importer, source), masks)
    place_source, selected = select(recording, place_from, queries, every)
    _claim(output, importer, Path(source))
    with lock_folder(output, "name another folder"):
        writer = _Writer(output, recording)
        for done, panorama in enumerate(selected):
            if progress is not None:
                progress(f"import {format}", done, len(selected))
            writer.write(panorama)
        if progress is not None:
            progress(f"import {format}", len(selected), len(selected))
        writer.finish(masks)
    dataset = FolderDataset(FolderDataset.Config(root=output))
    (fold,) = dataset.folds()
    references = fold.references
    try:
        checks = data_notes(dataset)
    except DataError as error:  # building a map stops with it
        checks = [str(error)]
    return ImportResult(
        output,
        len(references),
        len(fold.queries),
        len({frame.place for frame in references}),
        place_source,
        writer.failures,
        (*recording.notes, *writer.notes, *checks),
        time.perf_counter() - start,
    )


def selected_fold(selected: Sequence[SelectedPanorama]) -> Fold:
    """Return a fold (a map and its queries) with the selected reference panoramas and without queries."""
    frames = [
        ReferenceFrame(panorama.record.id, panorama.place or "", pose, load=panorama.record.load)
        for panorama in selected
        if not panorama.is_query and (pose := panorama.record.T_world_pano) is not None
    ]
    return Fold("import", tuple(frames), ())


def _claim(folder: Path, importer: Importer, source: Path) -> None:
    """Store the format and settings in a new folder. In an existing folder, check that they are equal, else raise
    ConfigError."""
    settings = {
        "format": importer.name,
        "version": importer.version,
        "source": str(source.resolve()),
        "settings": importer.config.model_dump(mode="json", exclude={"kind"}),
    }
    path = folder / SETTINGS
    if not path.exists():
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ConfigError(
                f"{folder} contains files that `salframe data import` did not write: choose a new or an empty folder"
            )
        write_json(path, settings)
    elif (stored := read_json(path)) != settings:
        words = ("another format", "another importer version", "another source", "other importer settings")
        changed = [
            text
            for (key, value), text in zip(settings.items(), words, strict=True)
            if not isinstance(stored, dict) or stored.get(key) != value
        ]
        raise ConfigError(
            f"{folder} was imported earlier with {' and '.join(changed)}: remove this folder, or choose another one"
        )


class _Writer:
    """Writes panoramas to a folder, and the manifest at the end."""

    def __init__(self, folder: Path, recording: Recording) -> None:
        self._folder, self._recording = folder, recording
        self._entries: list[FrameEntry] = []
        self._truth: dict[str, TruthEntry] = {}
        self._noted: dict[str, list[str]] = {}
        self.failures: dict[str, str] = {}

    @property
    def notes(self) -> list[str]:
        """The notes on panoramas. Each note appears once, and lists its panoramas."""
        return [_listed(ids, note) for note, ids in self._noted.items()]

    def write(self, panorama: SelectedPanorama) -> None:
        """Write the images of a panorama, unless they are stored and newer than their sources."""
        record = panorama.record
        instances: tuple[int, ...] = ()
        entry = _entry(panorama)
        if not self._is_current(entry, record.sources):
            try:
                loaded = record.load()
                if isinstance(record.images, ImageFiles):
                    for key, path in record.images.by_part.items():
                        _copy(path, self._folder / getattr(entry, key))
                else:
                    ids = None if loaded.annotations is None else loaded.annotations.instance_id
                    write_panorama(self._folder, entry, loaded.rgb, loaded.range_m, ids, loaded.valid)
                    for note in loaded.notes:
                        self._noted.setdefault(note, []).append(record.id)
            except DataError as error:
                self.failures[record.id] = describe_error(error)
                return
        self._entries.append(entry)
        if panorama.is_query and panorama.place is not None:
            if entry.instances:
                from salframe.panoramas.images import read_ids

                instances = visible_instances(read_ids(self._folder / entry.instances))
            pose = None if record.T_world_pano is None else tuple(record.T_world_pano.ravel().tolist())
            self._truth[record.id] = TruthEntry(place=panorama.place, pose=pose, instances=instances)

    def finish(self, floors: Sequence[FloorMasks]) -> None:
        """Write the manifest, the tables and the floor masks. Raises DataError if no reference frame was written."""
        if not any(entry.role == "map" for entry in self._entries):
            first = next(iter(self.failures.values()), "none was selected")
            raise DataError(
                f"no panorama for the map could be imported ({counted(len(self.failures), 'panorama')} failed), the "
                f"first error: {first}"
            )
        objects, odometry = self._recording.objects, self._recording.odometry
        if objects is not None:
            write_objects(self._folder / OBJECTS, objects)
        if odometry is not None:
            rows = [",".join(map(repr, row)) for row in odometry.tolist()]
            write_text(self._folder / ODOMETRY, "\n".join([",".join(COLUMNS), *rows, ""]))
        write_manifest(
            self._folder,
            self._entries,
            self._truth,
            None if objects is None else OBJECTS,
            [write_floor(self._folder, f"floor-{number}", floor) for number, floor in enumerate(floors, 1)],
            odometry=None if odometry is None else ODOMETRY,
        )

    def _is_current(self, entry: FrameEntry, sources: Sequence[Path]) -> bool:
        """Return whether all images of an entry are stored, and none of them is older than its sources."""
        if not is_written(self._folder, entry):
            return False
        names = [name for key in ("rgb", "range", "instances", "valid") if (name := getattr(entry, key))]
        written_ns = min((self._folder / name).stat().st_mtime_ns for name in names)
        return all(not path.exists() or path.stat().st_mtime_ns <= written_ns for path in sources)


def _entry(panorama: SelectedPanorama) -> FrameEntry:
    """Return the entry of a panorama in the manifest."""
    record = panorama.record
    keys: dict[str, Any] = image_names(f"frames/{record.id}", record.parts)
    if isinstance(record.images, ImageFiles):
        if record.images.rgb is not None:
            keys["rgb"] = f"frames/{record.id}{record.images.rgb.suffix.lower()}"
        encoding = record.images.encoding
        if encoding != RangeEncoding():
            declared = RangeKeys(range_unit_m=encoding.unit_m, range_missing=encoding.missing, range_kind=encoding.kind)
            keys |= declared.model_dump()
    if panorama.is_query:
        times = {} if record.sequence is None else {"sequence": record.sequence, "t_s": record.t_s}
        return FrameEntry(id=record.id, role="query", **keys, **times)
    pose = tuple(np.asarray(record.T_world_pano).ravel().tolist())
    return FrameEntry(id=record.id, role="map", place=panorama.place, pose=pose, **keys)


def _listed(ids: Sequence[str], note: str) -> str:
    others = f" and {len(ids) - 1} other panoramas" if len(ids) > 1 else ""
    return f"{ids[0]}{others}: {note}"


def _copy(source: Path, target: Path) -> None:
    """Copy a file. The copy is as new as the time of the copy."""
    with atomic_path(target) as temporary:
        shutil.copyfile(source, temporary)
