"""What was computed once: named arrays by the content of their key."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files import read_arrays, write_arrays
from salframe.framework.identity import digest


def cache_home() -> Path:
    """Where salframe keeps what it can make again: $SALFRAME_CACHE, else the user's cache folder."""
    if "SALFRAME_CACHE" in os.environ:
        return Path(os.environ["SALFRAME_CACHE"])
    from platformdirs import user_cache_path

    return user_cache_path("salframe", appauthor=False)


class Cache:
    """Named arrays by the content of their key; the seconds that computing took stay with them.

    A damaged entry is computed again.
    """

    def __init__(self, directory: Path | None = None) -> None:
        self.directory = cache_home() / "descriptions" if directory is None else directory

    def _path(self, key: Any) -> Path:
        name = digest(key)
        return self.directory / name[:2] / f"{name}.npz"

    def get(self, key: Any) -> tuple[dict[str, np.ndarray], float] | None:
        """The arrays of `key` (JSON-serialisable) and the seconds it took to compute them when they were, or None."""
        path = self._path(key)
        if not path.exists():
            return None
        try:
            arrays = read_arrays(path)
            return arrays, float(arrays.pop("_seconds"))
        except (DataError, KeyError):
            path.unlink(missing_ok=True)
            return None

    def put(self, key: Any, arrays: Mapping[str, np.ndarray], seconds: float) -> None:
        """Keep arrays and the seconds they took."""
        write_arrays(self._path(key), {**arrays, "_seconds": np.array(seconds)})
