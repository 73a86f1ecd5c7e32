"""The folder that holds a map: it changes whole, and what was edited or cut short is refused."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from pydantic import Field

from salframe.framework.config import Settings
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files import alone, file_sha256, naming, read_json, read_model, write_json

MAP, MAP_FORMAT = "map.json", 4
_PARTS = "parts-"

_Read = TypeVar("_Read")


class Manifest(Settings):
    """map.json: the sub-folder that holds the map's parts, and the sha256 of each by its path in there."""

    format: int
    parts: str = Field(pattern=r"^parts-[0-9a-f]{16}$")
    sha256: dict[str, str]


@contextmanager
def write_map(directory: Path) -> Iterator[Path]:
    """A new folder for the parts of a map, which replace the map in `directory` when the block ends well.

    The parts lie in a sub-folder of their own, and map.json, which names it, is replaced in one step: whenever the
    process is killed, `directory` holds the old map or the new one. What killed ones left is removed by the next.
    Raises ConfigError where it holds something else than a map, or another process writes to it.
    """
    check_output(directory)
    was_there = directory.exists()
    directory.mkdir(parents=True, exist_ok=True)
    with alone(directory, "name a new folder"), naming(directory):
        yield from _replace_parts(directory, was_there)


def _replace_parts(directory: Path, was_there: bool) -> Iterator[Path]:
    parts = directory / f"{_PARTS}{secrets.token_hex(8)}"
    parts.mkdir()
    try:
        yield parts
        files = sorted(path for path in parts.rglob("*") if path.is_file())
        sha256 = {path.relative_to(parts).as_posix(): file_sha256(path) for path in files}
        write_json(parts / MAP, {"format": MAP_FORMAT, "parts": parts.name, "sha256": sha256})
        os.replace(parts / MAP, directory / MAP)
    finally:
        _remove_other_parts(directory)
        if not was_there and not any(directory.iterdir()):
            directory.rmdir()


def read_map(directory: Path, read: Callable[[Path], _Read]) -> _Read:
    """What `read` makes of the folder with the parts of a map; once more where the map was replaced meanwhile.

    Raises DataError, in one line, where `directory` holds no map, one of another format, or one that was edited or is
    not whole.
    """
    while True:
        manifest = _manifest(directory)
        try:
            _check_parts(directory / manifest.parts, manifest.sha256)
            return read(directory / manifest.parts)
        except (DataError, OSError):
            if _manifest(directory) == manifest:
                raise


def check_output(directory: Path) -> None:
    """Raises ConfigError where a folder to write a map to holds something else than a map, or what is left of one."""
    if not directory.exists() or (directory / MAP).exists():
        return
    if not directory.is_dir() or not all(path.name.startswith(_PARTS) for path in directory.iterdir()):
        raise ConfigError(f"{directory} holds something else than a map: name a new folder, or remove it")


def _manifest(directory: Path) -> Manifest:
    path = directory / MAP
    if not path.exists():
        raise DataError(f"{directory} holds no map: make one with salframe build DATA -o {directory}")
    content = read_json(path)
    if isinstance(content, Mapping) and content.get("format", MAP_FORMAT) != MAP_FORMAT:
        raise DataError(f"{directory} has map format {content['format']}, expected {MAP_FORMAT}: build it again")
    return read_model(path, Manifest)


def _check_parts(parts: Path, sha256: Mapping[str, str]) -> None:
    for name, expected in sha256.items():
        path = parts / name
        if not path.is_file():
            raise DataError(f"{path} is missing: build the map again")
        if file_sha256(path) != expected:
            raise DataError(f"{path} is not what was written when the map was built: build the map again")


def _remove_other_parts(directory: Path) -> None:
    """Remove the parts that map.json does not name: of the map before, and of builds that did not end."""
    try:
        current = _manifest(directory).parts
    except DataError:
        current = None
    for folder in directory.glob(f"{_PARTS}*"):
        if folder.name != current:
            shutil.rmtree(folder, ignore_errors=True)
