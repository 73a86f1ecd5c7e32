"""Writing files: each file appears whole or not at all."""

from __future__ import annotations

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
"""What every PNG begins with."""


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let what the system says against writing to `path` name it: where the disk is full it names nothing."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, of the same suffix; renamed to it when the block ends well, removed when it does
    not."""
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
    """A temporary folder beside `path`, renamed to it when the block ends well, removed when it does not. Raises
    ConfigError where `path` is there."""
    if path.exists():
        raise ConfigError(f"{path} is there already: name a new folder, or remove it")
    temporary = path.with_name(f".{path.name}-{os.getpid()}-{time.monotonic_ns()}")
    temporary.mkdir(parents=True)
    try:
        with naming(path):
            yield temporary
            os.replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def alone(folder: Path, instead: str) -> Iterator[None]:
    """Hold a folder's lock, which the system gives back when the process ends; nothing where it has no such locks.

    Raises ConfigError where another process holds it; `instead`: what the user could do but wait.
    """
    try:
        import fcntl
    except ImportError:  # Windows has none
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(f"another process writes to {folder}: wait for it, or {instead}") from None
        except OSError:  # some network file systems have none
            pass
        yield
    finally:
        os.close(descriptor)


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


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, the same bytes on every system."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically, indented, keys in the order given; NaN is refused."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write named arrays to a compressed .npz, atomically."""
    write_bytes(path, pack_arrays(arrays))


def check_picture_output(path: Path) -> None:
    """Raises ConfigError where a PNG would replace something else than a PNG."""
    if path.exists() and not (path.is_file() and read_start(path, len(PNG)) == PNG):
        raise ConfigError(f"{path} is there and is no PNG, expected the name of a new file or of a picture to replace")
