"""The folder of a saved map. Only this module reads and writes it.

`map.json` names a sub-folder, which contains the parts of the map, and the SHA-256 of every file in it. The parts are
`method.json`, tables (`frames`, `scenes`, and the tables of a topology), `floors.npz`, the calibration, and the index
of the localizer.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import identity
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, DataError, format_advice
from salframe.framework.files.array_files import MAX_READ_BYTES, ArrayKind, FileStamp, map_array
from salframe.framework.files.columns import Columns, Row, read_columns, write_columns
from salframe.framework.files.hashes import digest, file_sha256
from salframe.framework.files.reading import read_json, read_model
from salframe.framework.files.writing import lock_folder, naming, write_json
from salframe.framework.validation import Settings, validate
from salframe.localization.calibration import MapCalibration
from salframe.localization.localizer import Localizer
from salframe.localization.saved_frames import FRAME_COLUMNS, SavedFrames, frame_row
from salframe.panoramas.floors import FLOORS, FloorMasks, read_floors, write_floors
from salframe.panoramas.frames import ReferenceFrame

MAP, MAP_FORMAT = "map.json", 8
METHOD, FRAMES, SCENES, INDEX, CALIBRATION = "method.json", "frames", "scenes", "index", "calibration"
_PARTS = "parts-"

_Result = TypeVar("_Result")
_Model = TypeVar("_Model", bound=BaseModel)


class _MapManifest(Settings):
    """map.json: the sub-folder that holds the parts, and the sha256 of each file by its path in the sub-folder."""

    format: int
    parts: str = Field(pattern=r"^parts-[0-9a-f]{16}$")
    sha256: dict[str, str]


class _SavedMethod(Settings):
    """method.json: version and settings of the localizer, and a digest of what its descriptions depend on."""

    version: str
    localizer: dict[str, Any]
    described_by: str


class MapParts:
    """The folder with the parts of one map, which are read and written one by one."""

    def __init__(self, folder: Path, files: Iterable[str] = ()) -> None:
        """Open the parts in a folder.

        Args:
            folder: The sub-folder that map.json names.
            files: Paths, relative to `folder`, that map.json lists. Other files are not parts of the map.
        """
        self.folder = folder
        self._names = frozenset(file.partition("/")[0] for file in files)

    def has(self, name: str) -> bool:
        """Return whether map.json lists a part of this name."""
        return name in self._names

    def copy_to(self, folder: Path) -> None:
        """Copy the parts that map.json lists to another folder."""
        for name in sorted(self._names):
            source, target = self.folder / name, folder / name
            (shutil.copytree if source.is_dir() else shutil.copy2)(source, target)

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a part of the map as a JSON file."""
        write_json(self.folder / name, content)

    def read_json(self, name: str, model: type[_Model]) -> _Model:
        """Read a part that is a JSON file. Raises DataError on content that the model does not allow."""
        return read_model(self.folder / name, model)

    def write_table(self, name: str, rows: Iterable[Row]) -> None:
        """Write a part that is a table. The rows may be a stream, as in `write_columns`."""
        write_columns(self.folder / name, rows)

    def read_table(self, name: str, columns: Mapping[str, ArrayKind] | None = None) -> Columns:
        """Read a part that is a table, or map it into memory if it is large.

        Raises DataError if the columns of the table differ from `columns` (None: any columns are allowed).
        """
        return read_columns(self.folder / name, columns)

    def write_floors(self, floors: Sequence[FloorMasks]) -> None:
        """Write the floors of the map."""
        write_floors(self.folder, floors)

    def mapped_files(self) -> tuple[FileStamp, ...]:
        """Return the stamps of the large files, which are memory-mapped and not read."""
        stamps = (FileStamp.of(path) for path in sorted(self.folder.rglob("*.npy")))
        return tuple(stamp for stamp in stamps if stamp.size >= MAX_READ_BYTES)

    def read_floors(self) -> tuple[FloorMasks, ...]:
        """Read the floors of the map; empty if it has no floors. Raises DataError if they are invalid."""
        return read_floors(self.folder) if self.has(FLOORS) else ()

    def write_scenes(self, packed: Iterable[Row], frames: Iterable[ReferenceFrame]) -> None:
        """Write the reference frames, without their panoramas, and the packed description of each frame."""
        self.write_table(FRAMES, map(frame_row, frames))
        self.write_table(SCENES, packed)

    def read_scenes(self) -> tuple[Columns, SavedFrames]:
        """Read packed descriptions and reference frames, as `read_table`. Raises DataError."""
        packed, frames = self.read_table(SCENES), SavedFrames(self.read_table(FRAMES, FRAME_COLUMNS))
        if len(packed) != len(frames):
            raise DataError(
                f"{self.folder} has {len(packed)} descriptions of {len(frames)} frames, expected one description "
                "for each frame: build the map again"
            )
        return packed, frames

    def write_method(self, localizer: Localizer) -> None:
        """Write name, version and settings of the localizer that computed the descriptions (features) in the map."""
        settings, described_by = localizer.config.model_dump(mode="json"), digest(localizer.describe_identity())
        self.write_json(METHOD, {"version": localizer.version, "localizer": settings, "described_by": described_by})

    def read_config(self) -> ComponentConfig:
        """Read the settings of the localizer.

        Raises:
            DataError: The map has no localizer.
            UnknownName: The localizer is not installed.
            ConfigError: The settings are invalid.
        """
        saved = self._read_method().localizer
        if not isinstance(kind := saved.get("kind"), str):
            raise DataError(f"{self.folder / METHOD} has no key 'kind' with the name of a method: build the map again")
        config: ComponentConfig = validate(registry().get(Localizer.role, kind).Config, saved, f"{self.folder.parent}:")
        return config

    def check_method(self, localizer: Localizer) -> None:
        """Raise DataError if the descriptions (features) in the map come from another localizer, or from this localizer
        with other settings, weights or files."""
        saved, directory, name, version = self._read_method(), self.folder.parent, localizer.name, localizer.version
        kind = saved.localizer.get("kind")
        if (kind, saved.version) != (name, version):
            raise DataError(
                f"{directory} was built with version {saved.version} of the method {kind!r}, expected version "
                f"{version} of {name!r}: build the map again"
            )
        if saved.described_by != digest(localizer.describe_identity()):
            raise DataError(
                f"{directory} was built with other settings, weights or files than the method {name!r} has now: build "
                "the map again"
            )

    def index_folder(self, localizer: Localizer) -> Path:
        """Return the folder for the index of a localizer. Its name depends on the settings of the localizer."""
        return self.folder / self._index_name(localizer)

    def has_index(self, localizer: Localizer) -> bool:
        """Return whether the map has an index of a localizer with these settings."""
        return self.has(self._index_name(localizer))

    @staticmethod
    def _index_name(localizer: Localizer) -> str:
        return f"{INDEX}-{_settings_key(localizer.config)}"

    def write_calibration(self, config: ComponentConfig, calibration: MapCalibration) -> None:
        """Write the calibration of a localizer with these settings."""
        self.write_json(self._calibration_name(config), calibration.model_dump(mode="json"))

    def read_calibration(self, config: ComponentConfig) -> MapCalibration | None:
        """Read the calibration of a localizer with these settings; None if the map has none. Raises DataError."""
        name = self._calibration_name(config)
        return self.read_json(name, MapCalibration) if self.has(name) else None

    def has_other_calibration(self, config: ComponentConfig) -> bool:
        """Return whether the map has calibrations, but none of a localizer with these settings."""
        names = [name for name in self._names if name.startswith(f"{CALIBRATION}-")]
        return bool(names) and self._calibration_name(config) not in names

    @staticmethod
    def _calibration_name(config: ComponentConfig) -> str:
        return f"{CALIBRATION}-{_settings_key(config)}.json"

    def _read_method(self) -> _SavedMethod:
        if not self.has(METHOD):
            raise DataError(
                f"the map {self.folder.parent} cannot localize: no reference frame (panorama with pose and place); "
                "build the map from data with reference frames"
            )
        return self.read_json(METHOD, _SavedMethod)


def _settings_key(config: ComponentConfig) -> str:
    """Return a digest of the settings of a localizer, for the file names of the parts that depend on these settings."""
    return digest(identity(config))[:16]


def find_not_finite(folder: Path) -> list[str]:
    """Return the names of the saved description arrays that contain NaN or infinity. `folder` contains the parts of the
    map."""
    arrays = {path.name: map_array(path) for path in sorted((folder / SCENES).glob("*.npy"))}
    return [
        f"{SCENES}/{name}" for name, array in arrays.items() if array.dtype.kind == "f" and not np.isfinite(array).all()
    ]


@contextmanager
def write_map(directory: Path) -> Iterator[MapParts]:
    """Write the parts of a map in a `with` block; they replace the map in `directory` when the block ends without an
    error.

    The parts are written to a new sub-folder. Then map.json, which names this sub-folder, is replaced in one step. If
    the process is killed, `directory` therefore contains either the old map or the new map. The next call removes the
    incomplete sub-folders of killed processes.

    Raises:
        ConfigError: `directory` contains something other than a map, or another process writes to it.
    """
    check_output(directory)
    existed = directory.exists()
    directory.mkdir(parents=True, exist_ok=True)
    with lock_folder(directory, "name a new folder"), naming(directory):
        yield from _replace_parts(directory, existed)


def _replace_parts(directory: Path, existed: bool) -> Iterator[MapParts]:
    folder = directory / f"{_PARTS}{secrets.token_hex(8)}"
    folder.mkdir()
    try:
        yield MapParts(folder)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        sha256 = {path.relative_to(folder).as_posix(): file_sha256(path) for path in files}
        write_json(folder / MAP, {"format": MAP_FORMAT, "parts": folder.name, "sha256": sha256})
        os.replace(folder / MAP, directory / MAP)
    finally:
        _remove_other_parts(directory)
        if not existed and not any(directory.iterdir()):
            directory.rmdir()


def read_map(directory: Path, read: Callable[[MapParts], _Result]) -> _Result:
    """Return the result of `read` for the parts of a map. If the map was replaced during the call and the call failed,
    `read` is called again with the new parts.

    Raises:
        DataError: `directory` contains no map, or a map of another format, or the map was edited or is incomplete.
    """
    while True:
        manifest = _read_manifest(directory)
        try:
            _check_files(directory / manifest.parts, manifest.sha256)
            return read(MapParts(directory / manifest.parts, manifest.sha256))
        except (DataError, OSError):
            if _read_manifest(directory) == manifest:
                raise


def map_config(directory: str | Path) -> ComponentConfig:
    """Return the settings of a saved map's localizer, with the components that `auto` selected. Raises as
    `open_map`."""
    return read_map(Path(directory), MapParts.read_config)


def map_labels(directory: str | Path) -> tuple[str, ...]:
    """Return the distinct labels of the objects of a saved map, sorted.

    Raises:
        DataError: `directory` contains no map, or a map whose method does not store labels of objects.
    """

    def read(parts: MapParts) -> tuple[str, ...]:
        column = parts.read_scenes()[0].columns.get("labels")
        if column is None or column.words is None:
            raise DataError(
                f"the map {directory} has no labels of objects, expected a map of a method that has a detector, "
                "such as 'proposed'"
            )
        return tuple(sorted(column.words))

    return read_map(Path(directory), read)


def map_calibration(directory: str | Path) -> tuple[MapCalibration | None, bool]:
    """Return the calibration of a saved map, None if it has none, and whether it has only a calibration for other
    settings. Raises as `open_map`."""

    def read(parts: MapParts) -> tuple[MapCalibration | None, bool]:
        if not parts.has(METHOD):
            return None, False
        config = parts.read_config()
        return parts.read_calibration(config), parts.has_other_calibration(config)

    return read_map(Path(directory), read)


def check_output(directory: Path) -> None:
    """Raise ConfigError if an output folder contains something other than a map or the parts of one."""
    if not directory.exists() or (directory / MAP).exists():
        return
    if not directory.is_dir() or not all(path.name.startswith(_PARTS) for path in directory.iterdir()):
        raise ConfigError(
            f"{directory} contains files that are not a map, expected a new or empty folder, or a map to replace: "
            "choose another folder"
        )


def _read_manifest(directory: Path) -> _MapManifest:
    path = directory / MAP
    if not path.exists():
        raise DataError(f"{directory} contains no map: build one with salframe build DATA -o {directory}")
    content = read_json(path)
    if isinstance(content, Mapping) and content.get("format") != MAP_FORMAT:
        received = f"has map format {content['format']}" if "format" in content else f"has no `format` in {MAP}"
        advice = format_advice(content.get("format"), MAP_FORMAT, "build the map again")
        raise DataError(f"{directory} {received}, expected {MAP_FORMAT}: {advice}")
    return read_model(path, _MapManifest)


def _check_files(folder: Path, sha256: Mapping[str, str]) -> None:
    for name, expected in sha256.items():
        path = folder / name
        if not path.is_file():
            raise DataError(f"{path} is missing: build the map again")
        if file_sha256(path) != expected:
            raise DataError(f"{path} was changed after the map was built: build the map again")


def _remove_other_parts(directory: Path) -> None:
    """Remove the sub-folders that map.json does not name. They remain from the previous map and from interrupted
    builds."""
    try:
        current = _read_manifest(directory).parts
    except DataError:
        current = None
    for folder in directory.glob(f"{_PARTS}*"):
        if folder.name != current:
            shutil.rmtree(folder, ignore_errors=True)
