"""Bounded reading: regular files of limited size, and JSON and YAML with limited nesting, size and types.

A FIFO can block, a device can fill the memory, deep nesting can exhaust the stack, and YAML aliases can grow
exponentially. All of these are rejected early with a ValueError that has the received and the expected value.
"""

from __future__ import annotations

import json
import math
import re
import stat
import sys
from itertools import accumulate
from pathlib import Path
from typing import Any

import yaml

from salframe.framework.errors import one_line, shorten

MAX_BYTES = 1 << 28
"""Maximum size of a JSON, YAML or text file, a table or an image, in bytes."""
_CHUNK = 1 << 20
"""Number of bytes that are read at once."""
MAX_DEPTH = 64
"""Maximum nesting depth of lists and mappings."""
MAX_NODES = 1_000_000
"""Maximum number of values in a YAML document, including those repeated by aliases."""
_SAFE: Any = getattr(
    yaml, "CSafeLoader", yaml.SafeLoader
)  # the libyaml loader is six times faster on the shipped presets
_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)
_NO_BRACKET = bytes(sorted({*range(256)} - {*b"[]{}"}))
_OPENING = b"[{"
_MIN_INTEGER, _END_INTEGER = -(1 << 63), 1 << 64


def why(error: OSError | ValueError) -> str:
    """Return why a file could not be read, in a few words."""
    return (error.strerror if isinstance(error, OSError) else None) or one_line(error)


def check_regular(path: Path, max_bytes: int = MAX_BYTES) -> int:
    """Return the size of a regular file in bytes. Raises OSError, or ValueError if it is too large or not regular."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, socket or device"
        raise ValueError(f"the path is {kind}, expected a regular file")
    if status.st_size > max_bytes:
        raise ValueError(f"the file has {status.st_size} bytes, expected at most {max_bytes}")
    return status.st_size


def read_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """Return the content of a regular file. Raises OSError, or ValueError if it is too large or not regular."""
    check_regular(path, max_bytes)
    chunks, size = [], 0
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):  # file.read(max_bytes) would allocate all of them for a small file
            chunks.append(chunk)
            size += len(chunk)
            if size > max_bytes:  # files in /proc report a size of 0
                raise ValueError(f"the file has more than {max_bytes} bytes, expected at most {max_bytes}")
    return b"".join(chunks)


def read_start(path: Path, max_bytes: int) -> bytes:
    """Return the first `max_bytes` bytes of a regular file. Raises OSError, or ValueError if it is not regular."""
    check_regular(path, sys.maxsize)
    with path.open("rb") as file:
        return file.read(max_bytes)


def parse_json(content: bytes) -> Any:
    """Parse JSON in UTF-8 with finite numbers and 64-bit integers. Raises ValueError if it is invalid."""
    if sum(map(content.count, (b"[", b"{"))) > MAX_DEPTH:
        brackets = _STRING.sub(b"", content).translate(None, _NO_BRACKET)
        _check_depth(max(accumulate(1 if bracket in _OPENING else -1 for bracket in brackets), default=0))
    value = json.loads(content.decode(), parse_int=_integer, parse_float=_finite, parse_constant=_finite)
    if b"\\ud" in content or b"\\uD" in content:
        json.dumps(value, ensure_ascii=False).encode()  # raises on a lone surrogate, which cannot be encoded
    return value


def parse_yaml(content: bytes | str) -> Any:
    """Parse a YAML document. It may have the types of JSON, and integer keys. Raises ValueError if it is invalid."""
    try:
        _check_events(content)
        value = yaml.load(content, Loader=_SAFE)
    except yaml.YAMLError as error:
        raise ValueError(one_line(error)) from None
    _check_plain(value)
    return value


def _check_depth(depth: int) -> None:
    if depth > MAX_DEPTH:
        raise ValueError(f"the content has {depth} levels of nested lists and mappings, expected at most {MAX_DEPTH}")


def _finite(text: str, keys: tuple[str | int, ...] = ()) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{_location(keys)}received the number {shorten(text, 40)}, expected a finite number")
    return value


def _integer(text: str) -> int:
    if len(text) > 20 or not _MIN_INTEGER <= (value := int(text)) < _END_INTEGER:
        raise ValueError(f"received the integer {shorten(text, 40)}, expected an integer of at most 64 bits")
    return value


def _check_events(content: bytes | str) -> None:
    """Raise ValueError if a document has tags, recursive aliases, or too many levels or values.

    Uses only the events of the parser, because the composer is recursive.
    """
    counts: dict[str | None, int | None] = {}
    stack: list[tuple[str | None, int]] = []
    nodes = 0
    for event in yaml.parse(content, Loader=_SAFE):
        anchor = getattr(event, "anchor", None)
        if tag := getattr(event, "tag", None):
            raise ValueError(f"received the YAML tag {shorten(tag, 40)}, expected values without tags")
        if isinstance(event, yaml.AliasEvent):
            count = counts.get(anchor, 0)
            if count is None:
                raise ValueError(
                    f"the YAML alias *{anchor} refers to a value that contains this alias, expected an alias of "
                    "another value"
                )
            nodes += count
        elif isinstance(event, yaml.ScalarEvent):
            nodes += 1
            if anchor:
                counts[anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            stack.append((anchor, nodes))
            nodes += 1
            _check_depth(len(stack))
            if anchor:
                counts[anchor] = None
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = stack.pop()
            if anchor:
                counts[anchor] = nodes - before
        if nodes > MAX_NODES:
            raise ValueError(
                f"the content has more than {MAX_NODES} values including aliases, expected at most {MAX_NODES}"
            )


def _check_plain(value: Any, keys: tuple[str | int, ...] = ()) -> None:
    """Raise ValueError on values that JSON does not have: dates, non-finite numbers, integers of over 64 bits."""
    if isinstance(value, dict):
        for key, part in value.items():
            if isinstance(key, bool) or not isinstance(key, str | int):
                raise ValueError(
                    f"{_location(keys)}received the key {key!r}, expected a key that is text or an integer"
                )
            _check_plain(key, keys)
            _check_plain(part, (*keys, key))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            _check_plain(part, (*keys, index))
    elif isinstance(value, str):
        value.encode()  # raises on a lone surrogate
    elif isinstance(value, int):
        if not _MIN_INTEGER <= value < _END_INTEGER:
            raise ValueError(f"{_location(keys)}received an integer of more than 64 bits, expected at most 64 bits")
    elif isinstance(value, float):
        _finite(str(value), keys)
    elif value is not None:
        kind = type(value).__name__
        raise ValueError(f"{_location(keys)}received the {kind} {value}, expected text: put the value in quotes")


def _location(keys: tuple[str | int, ...]) -> str:
    """Return the beginning of an error about a value: the path of its keys."""
    return f"key {shorten('.'.join(map(str, keys)))}: " if keys else ""
