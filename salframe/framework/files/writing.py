"""Atomic writing of files: a file is written completely or not at all."""

from __future__ import annotations

import errno
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.errors import ConfigError
from salframe.framework.files.array_files import pack_arrays
from salframe.framework.files.bounded import read_start

PNG = b"\x89PNG\r\n\x1a\n"
"""The first bytes of every PNG file."""


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add `path` to an OSError of the `with` block that has no file name, such as the error of a full disk.

    numpy raises an OSError without an errno if it can write only a part of an array. It is replaced by ENOSPC (disk
    full).
    """
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)} ({error})", str(path)) from error
        if error.filename is None:
            error.filename = str(path)
        raise


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`, with the same suffix.

    The temporary file is renamed to `path` if the block succeeds and removed if it fails.

    Raises:
        ConfigError: `path` has no file name.
    """
    if not path.name:
        raise ConfigError(f"the output path is {str(path)!r}, expected a path that ends in a file name")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}-{os.getpid()}-{time.monotonic_ns()}{path.suffix}")
    try:
        with naming(path):
            yield temporary
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder next to `path`.

    The temporary folder is renamed to `path` if the block succeeds and removed if it fails.

    Raises:
        ConfigError: `path` exists.
    """
    if path.exists():
        raise ConfigError(f"the output {path} already exists, expected a new path: remove it, or choose another folder")
    temporary = path.with_name(f".{path.name}-{os.getpid()}-{time.monotonic_ns()}")
    temporary.mkdir(parents=True)
    try:
        with naming(path):
            yield temporary
            os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def lock_folder(folder: Path, instead: str) -> Iterator[None]:
    """Lock a folder during the `with` block. The system releases the lock if the process ends.

    Does nothing on systems without such locks.

    Args:
        folder: The folder.
        instead: What the user can do instead of waiting, for the message.

    Raises:
        ConfigError: Another process has locked the folder.
    """
    try:
        import fcntl
    except ImportError:  # Windows has no fcntl
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(
                f"another process writes to the folder {folder}: wait until that process ends, or {instead}"
            ) from None
        except OSError:  # some network file systems have no locks
            pass
        yield
    finally:
        os.close(descriptor)


def share_file(source: Path, target: Path) -> None:
    """Make a file available at a second path, by a hard link or, if this is not possible, a copy.

    An existing `target` is not replaced.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:  # the target exists, or the file system does not support this link
        if not target.exists():
            with atomic_path(target) as temporary:
                shutil.copyfile(source, temporary)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, with the same bytes on every system."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: Path, value: Any) -> None:
    """Write indented JSON atomically, with keys in their original order. Raises ValueError on NaN."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write named arrays to a compressed .npz file atomically."""
    write_bytes(path, pack_arrays(arrays))


def check_picture_output(path: Path) -> None:
    """Raise ConfigError if `path` exists and is not a PNG."""
    if path.exists() and not (path.is_file() and read_start(path, len(PNG)) == PNG):
        raise ConfigError(f"the output file {path} exists and is not a PNG image: choose a new file name")
