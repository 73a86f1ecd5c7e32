"""Reading within bounds: regular files of a limited size, JSON and YAML of limited nesting, size and kind.

A FIFO would hang, a device fill the memory, deep nesting exhaust the stack, and YAML's aliases multiply: each is
refused before it costs anything, by a ValueError that says what was received and what was expected.
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
"""Of a JSON, YAML or text file, a table or an image."""
DEEPEST = 64
"""Levels of lists and mappings in one another."""
MAX_NODES = 1_000_000
"""Values in a YAML document, each counted as often as its aliases repeat it."""
_SAFE: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # that of libyaml is six times as fast on our presets
_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)
_NO_BRACKET = bytes(sorted({*range(256)} - {*b"[]{}"}))
_OPENING = b"[{"
_MIN_INTEGER, _END_INTEGER = -(1 << 63), 1 << 64


def why(error: OSError | ValueError) -> str:
    """Why a file could not be read, in a few words."""
    return (error.strerror if isinstance(error, OSError) else None) or one_line(error)


def check_regular(path: Path, max_bytes: int = MAX_BYTES) -> int:
    """The bytes of a regular file of limited size. Raises OSError, and ValueError on anything else."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, socket or device"
        raise ValueError(f"it is {kind}, expected a regular file")
    if status.st_size > max_bytes:
        raise ValueError(f"it has {status.st_size} bytes, expected at most {max_bytes}")
    return status.st_size


def read_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a regular file of limited size. Raises OSError, and ValueError on anything else."""
    check_regular(path, max_bytes)
    with path.open("rb") as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:  # files of /proc say that they are empty
        raise ValueError(f"it has more than {max_bytes} bytes, expected at most as many")
    return content


def read_start(path: Path, max_bytes: int) -> bytes:
    """What a regular file of any size begins with. Raises OSError, and ValueError on anything else."""
    check_regular(path, sys.maxsize)
    with path.open("rb") as file:
        return file.read(max_bytes)


def parse_json(content: bytes) -> Any:
    """The value of a JSON text in UTF-8, its numbers finite and its integers of 64 bits. Raises ValueError."""
    if sum(map(content.count, (b"[", b"{"))) > DEEPEST:
        brackets = _STRING.sub(b"", content).translate(None, _NO_BRACKET)
        _check_depth(max(accumulate(1 if bracket in _OPENING else -1 for bracket in brackets), default=0))
    value = json.loads(content.decode(), parse_int=_integer, parse_float=_finite, parse_constant=_finite)
    if b"\\ud" in content or b"\\uD" in content:
        json.dumps(value, ensure_ascii=False).encode()  # half a character, which no file or terminal takes
    return value


def parse_yaml(content: bytes | str) -> Any:
    """The value of a YAML document without tags: what JSON has, and keys that are integers. Raises ValueError."""
    try:
        _check_events(content)
        value = yaml.load(content, Loader=_SAFE)
    except yaml.YAMLError as error:
        raise ValueError(one_line(error)) from None
    _check_plain(value)
    return value


def _check_depth(depth: int) -> None:
    if depth > DEEPEST:
        raise ValueError(f"{depth} levels of lists and mappings in one another, expected at most {DEEPEST}")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {shorten(text, 40)}, expected a finite one")
    return value


def _integer(text: str) -> int:
    if len(text) > 20 or not _MIN_INTEGER <= (value := int(text)) < _END_INTEGER:
        raise ValueError(f"the integer {shorten(text, 40)}, expected one of 64 bits")
    return value


def _check_events(content: bytes | str) -> None:
    """Raises ValueError on a document that has tags, is too deep, holds itself, or whose aliases make too much of it.
    Looks at no more than the parser's events: what composes them recurses."""
    counts: dict[str | None, int | None] = {}
    open_: list[tuple[str | None, int]] = []
    nodes = 0
    for event in yaml.parse(content, Loader=_SAFE):
        anchor = getattr(event, "anchor", None)
        if tag := getattr(event, "tag", None):
            raise ValueError(f"the tag {shorten(tag, 40)}, expected none")
        if isinstance(event, yaml.AliasEvent):
            repeated = counts.get(anchor, 0)
            if repeated is None:
                raise ValueError(f"*{anchor} stands inside &{anchor}, expected no value that holds itself")
            nodes += repeated
        elif isinstance(event, yaml.ScalarEvent):
            nodes += 1
            if anchor:
                counts[anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            open_.append((anchor, nodes))
            nodes += 1
            _check_depth(len(open_))
            if anchor:
                counts[anchor] = None
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_.pop()
            if anchor:
                counts[anchor] = nodes - before
        if nodes > MAX_NODES:
            raise ValueError(f"more than {MAX_NODES} values, those that aliases repeat among them")


def _check_plain(value: Any) -> None:
    """Raises ValueError on what JSON has not: dates, numbers that are not finite, integers of more than 64 bits."""
    if isinstance(value, dict):
        for key, part in value.items():
            if isinstance(key, bool) or not isinstance(key, str | int):
                raise ValueError(f"the key {key!r}, expected text or an integer")
            _check_plain(key)
            _check_plain(part)
    elif isinstance(value, list):
        for part in value:
            _check_plain(part)
    elif isinstance(value, str):
        value.encode()  # no half of a character
    elif isinstance(value, int):
        if not _MIN_INTEGER <= value < _END_INTEGER:
            raise ValueError("an integer of more than 64 bits")
    elif isinstance(value, float):
        _finite(str(value))
    elif value is not None:
        raise ValueError(f"the {type(value).__name__} {value}, expected text: put it in quotes")
