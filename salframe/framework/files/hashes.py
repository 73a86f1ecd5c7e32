"""Hashes of files and values."""

from __future__ import annotations

import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from salframe.framework.files.bounded import check_regular
from salframe.framework.files.reading import reading

_MAX_HASHED = 1 << 40
"""Maximum size of a hashed file, in bytes."""


def file_sha256(path: Path) -> str:
    """Return the sha256 (hex) of a regular file, cached until the file changes. Raises DataError."""
    with reading(path, "a regular file"):
        check_regular(path, _MAX_HASHED)
        status = path.stat()
        return _hash(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=4096)
def _hash(path: Path, size: int, modified_ns: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest(value: Any) -> str:
    """Return the sha256 (hex) of a JSON-serializable value. Equal values have equal digests."""
    return hashlib.sha256(canonical_json(value)).hexdigest()


def canonical_json(value: Any) -> bytes:
    """Return a JSON-serializable value as JSON. Equal values have equal bytes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()
