"""Cache of computed arrays on disk. The name of each file is the hash of the key of its arrays."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.errors import ConfigError
from salframe.framework.files.array_files import MAX_BYTES, pack_arrays, parse_arrays
from salframe.framework.files.bounded import read_bytes
from salframe.framework.files.hashes import canonical_json, digest
from salframe.framework.files.writing import write_bytes

LIMIT, DEFAULT_LIMIT_GB = "SALFRAME_CACHE_GB", 20.0
"""Environment variable with the maximum size of the cache, and its default, in gigabytes (1e9 bytes)."""
TARGET_FILL = 0.9
"""A full cache is reduced to this fraction of its limit, so that it is not scanned for each new entry."""
_SHA256_BYTES = 32


def cache_home() -> Path:
    """Return the cache folder of salframe: $SALFRAME_CACHE, or the cache folder of the user."""
    if "SALFRAME_CACHE" in os.environ:
        return Path(os.environ["SALFRAME_CACHE"])
    from platformdirs import user_cache_path

    return user_cache_path("salframe", appauthor=False)


@dataclass(frozen=True)
class CacheState:
    """The folder of a cache, the number and total size of its entries, and the maximum size."""

    directory: Path
    entries: int
    size_bytes: int
    limit_bytes: int


class Cache:
    """Cache of named arrays on disk. A key is any JSON-serializable value.

    Each entry holds the arrays, the time to compute them, the key and a checksum. An entry with a wrong checksum or key
    counts as missing. If the cache exceeds its maximum size, the least recently used entries are removed.

    Args:
        directory: The folder. None for the folder of panorama descriptions in the cache of salframe.
        limit_bytes: The maximum size in bytes. None for $SALFRAME_CACHE_GB, or 20 GB if it is not set.
    """

    def __init__(self, directory: Path | None = None, limit_bytes: int | None = None) -> None:
        """Open the cache. Raises ConfigError if the limit in the environment is invalid."""
        self.directory = cache_home() / "descriptions" if directory is None else directory
        self.limit_bytes = _limit_bytes() if limit_bytes is None else limit_bytes
        self._size_bytes: int | None = None

    def _path(self, key: Any) -> Path:
        name = digest(key)
        return self.directory / name[:2] / f"{name}.npz"

    def get(self, key: Any) -> tuple[dict[str, np.ndarray], float] | None:
        """Return the arrays of a key and their computation time in seconds, or None if there is no entry."""
        path = self._path(key)
        try:
            content = read_bytes(path, MAX_BYTES)
            packed, checksum = content[:-_SHA256_BYTES], content[-_SHA256_BYTES:]
            if hashlib.sha256(packed).digest() != checksum:
                return None
            arrays = parse_arrays(packed)
            seconds = float(arrays.pop("_seconds"))
            if arrays.pop("_key").tobytes() != canonical_json(key):  # a renamed entry
                return None
        except (OSError, ValueError, KeyError):
            return None
        with suppress(OSError):  # the file may be read-only, or removed by another process
            os.utime(path)
        return arrays, seconds

    def put(self, key: Any, arrays: Mapping[str, np.ndarray], seconds: float) -> None:
        """Store arrays and their computation time in seconds, replacing the entry of this key.

        Does nothing if the folder is read-only or the disk is full.
        """
        metadata = {"_seconds": np.array(seconds), "_key": np.frombuffer(canonical_json(key), np.uint8)}
        content = pack_arrays({**arrays, **metadata})
        try:
            write_bytes(self._path(key), content + hashlib.sha256(content).digest())
        except OSError:
            return
        if self._size_bytes is None:
            self._size_bytes = self.state().size_bytes
        else:
            self._size_bytes += len(content) + _SHA256_BYTES
        if self._size_bytes > self.limit_bytes:
            self._make_room()

    def state(self) -> CacheState:
        """Return the number and total size of the entries."""
        sizes = [size for _, _, size in self._entries()]
        return CacheState(self.directory, len(sizes), sum(sizes), self.limit_bytes)

    def clear(self) -> CacheState:
        """Remove all entries, except those of other users. Return the state before the removal."""
        before = self.state()
        for path, _, _ in self._entries():
            with suppress(PermissionError):  # an entry of another user, who shares the cache
                path.unlink(missing_ok=True)
        self._size_bytes = None
        return before

    def _make_room(self) -> None:
        """Remove the least recently used entries until the cache is at TARGET_FILL. Keeps entries of other users."""
        entries = sorted(self._entries(), key=lambda entry: entry[1])
        size = sum(bytes_ for _, _, bytes_ in entries)
        for path, _, bytes_ in entries:
            if size <= TARGET_FILL * self.limit_bytes:
                break
            try:
                path.unlink(missing_ok=True)
            except OSError:  # an entry of another user, who shares the cache
                continue
            size -= bytes_
        self._size_bytes = size

    def _entries(self) -> list[tuple[Path, int, int]]:
        """Return the path, time of last use (ns) and size in bytes of each entry. Skips entries that are gone."""
        entries = []
        for path in self.directory.glob("??/[!.]*.npz"):
            try:
                status = path.stat()
            except OSError:  # removed meanwhile, or in a folder of another user
                continue
            entries.append((path, status.st_mtime_ns, status.st_size))
        return entries


def _limit_bytes() -> int:
    text = os.environ.get(LIMIT, str(DEFAULT_LIMIT_GB))
    try:
        limit_bytes = int(float(text) * 1e9)
    except (ValueError, OverflowError):
        limit_bytes = -1
    if limit_bytes < 0:
        raise ConfigError(f"the environment variable {LIMIT} is {text!r}, expected a number of gigabytes, at least 0")
    return limit_bytes
