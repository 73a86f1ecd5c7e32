"""Files that are never half written, and their hashes."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel

from salframe.framework.config import validate
from salframe.framework.errors import ConfigError, DataError

_Model = TypeVar("_Model", bound=BaseModel)


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, of the same suffix; renamed to it when the block ends well, removed when it does
    not."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}-{os.getpid()}-{time.monotonic_ns()}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path`, renamed to it when the block ends well, removed when it does not. Raises
    ConfigError where `path` is there."""
    if path.exists():
        raise ConfigError(f"{path} is there already: name a new folder, or remove it")
    temporary = path.with_name(f".{path.name}-{os.getpid()}-{time.monotonic_ns()}")
    temporary.mkdir(parents=True)
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def share_file(source: Path, target: Path) -> None:
    """Let a file be found under another path too: a hard link, or a copy where there can be none. A file that is
    already there stays."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:  # it is there, or on another file system, or on one that has no hard links
        if not target.exists():
            with atomic_path(target) as temporary:
                shutil.copyfile(source, temporary)


def remove_unfinished(folder: Path, pid: int) -> None:
    """Remove the temporary files that a process that was killed left of `atomic_path` in a folder and those below."""
    for temporary in folder.rglob(f".*-{pid}-*"):
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, the same bytes on every system."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically, indented, keys in the order given; NaN is refused."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read JSON. Raises DataError where the file is missing or is no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise DataError(f"{path} is not JSON: {error}") from None


def read_model(path: Path, model: type[_Model]) -> _Model:
    """Read JSON as an instance of a pydantic model. Raises DataError, in one line, on whatever does not fit."""
    content = read_json(path)
    if not isinstance(content, Mapping):
        raise DataError(f"{path} holds {type(content).__name__}, expected an object")
    try:
        return validate(model, content, f"{path}:")
    except ConfigError as error:
        raise DataError(str(error)) from None


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write named arrays to a compressed .npz, atomically."""
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]  # numpy's stub takes no mapping here


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read named arrays from .npz, never unpickling. Raises DataError."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return dict(archive)
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        raise DataError(f"{path} is not an array archive: {error}") from None


def file_sha256(path: Path) -> str:
    """Sha256 (hex) of a file, remembered until the file changes."""
    status = path.stat()
    return _hash(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=4096)
def _hash(path: Path, size: int, modified_ns: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
