"""What was computed once: named arrays by the content of their key."""

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
from salframe.framework.files.hashes import digest
from salframe.framework.files.writing import write_bytes

LIMIT, DEFAULT_LIMIT_GB = "SALFRAME_CACHE_GB", 20.0
"""The environment variable that limits the cache, and what it is without, in gigabytes (1e9 bytes)."""
ROOM = 0.9
"""A cache that is full is emptied to this share of its limit, so that it is not looked through at every entry."""
_SHA256_BYTES = 32


def cache_home() -> Path:
    """Where salframe keeps what it can make again: $SALFRAME_CACHE, else the user's cache folder."""
    if "SALFRAME_CACHE" in os.environ:
        return Path(os.environ["SALFRAME_CACHE"])
    from platformdirs import user_cache_path

    return user_cache_path("salframe", appauthor=False)


@dataclass(frozen=True)
class CacheState:
    """How full a cache is: its folder, its entries, their bytes, and how many they may have."""

    directory: Path
    entries: int
    size_bytes: int
    limit_bytes: int


class Cache:
    """Named arrays by the content of their key; the seconds that computing took stay with them.

    An entry that is damaged, by its checksum, is computed again and replaced. Where entries take more than
    `limit_bytes` ($SALFRAME_CACHE_GB unless given, else 20 GB), the least recently used go first.
    """

    def __init__(self, directory: Path | None = None, limit_bytes: int | None = None) -> None:
        """Raises ConfigError on a limit in the environment that is no number."""
        self.directory = cache_home() / "descriptions" if directory is None else directory
        self.limit_bytes = _limit_bytes() if limit_bytes is None else limit_bytes
        self._size_bytes: int | None = None

    def _path(self, key: Any) -> Path:
        name = digest(key)
        return self.directory / name[:2] / f"{name}.npz"

    def get(self, key: Any) -> tuple[dict[str, np.ndarray], float] | None:
        """The arrays of `key` (JSON-serialisable) and the seconds it took to compute them when they were, or None."""
        path = self._path(key)
        try:
            content = read_bytes(path, MAX_BYTES)
            whole, checksum = content[:-_SHA256_BYTES], content[-_SHA256_BYTES:]
            if hashlib.sha256(whole).digest() != checksum:
                return None
            arrays = parse_arrays(whole)
            seconds = float(arrays.pop("_seconds"))
        except (OSError, ValueError, KeyError):
            return None
        with suppress(OSError):  # it may be read-only, or gone by now
            os.utime(path)
        return arrays, seconds

    def put(self, key: Any, arrays: Mapping[str, np.ndarray], seconds: float) -> None:
        """Keep arrays and the seconds they took, in the place of what was there; nothing where the folder is read-only
        or the disk full."""
        content = pack_arrays({**arrays, "_seconds": np.array(seconds)})
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
        """How full it is."""
        sizes = [size for _, _, size in self._entries()]
        return CacheState(self.directory, len(sizes), sum(sizes), self.limit_bytes)

    def clear(self) -> CacheState:
        """Remove all entries; how full it was."""
        before = self.state()
        for path, _, _ in self._entries():
            path.unlink(missing_ok=True)
        self._size_bytes = 0
        return before

    def _make_room(self) -> None:
        entries = sorted(self._entries(), key=lambda entry: entry[1])
        size = sum(bytes_ for _, _, bytes_ in entries)
        for path, _, bytes_ in entries:
            if size <= ROOM * self.limit_bytes:
                break
            path.unlink(missing_ok=True)
            size -= bytes_
        self._size_bytes = size

    def _entries(self) -> list[tuple[Path, int, int]]:
        """Each entry, when it was last used (ns), and its bytes. Other processes may remove some meanwhile."""
        entries = []
        for path in self.directory.glob("??/[!.]*.npz"):
            try:
                status = path.stat()
            except FileNotFoundError:
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
        raise ConfigError(f"received {LIMIT}={text!r}, expected gigabytes, a number of at least 0")
    return limit_bytes
