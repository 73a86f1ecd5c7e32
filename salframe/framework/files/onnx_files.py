"""The files that an ONNX file points to. It may store tensors in other files, at locations relative to its folder.

Only the fields of onnx.proto3 that lead to tensors are followed. All others are skipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath

from salframe.framework.errors import WeightsError
from salframe.framework.files.reading import read_network

SUFFIX = ".onnx"
"""Suffix of the files that may point to other files."""
_MODEL, _GRAPH, _NODE, _ATTRIBUTE, _SPARSE, _FUNCTION, _TRAINING, _TENSOR, _ENTRY = range(9)
_CHILDREN = {
    _MODEL: {7: _GRAPH, 20: _TRAINING, 25: _FUNCTION},
    _GRAPH: {1: _NODE, 5: _TENSOR, 15: _SPARSE},
    _NODE: {5: _ATTRIBUTE},
    _ATTRIBUTE: {5: _TENSOR, 6: _GRAPH, 10: _TENSOR, 11: _GRAPH, 22: _SPARSE, 23: _SPARSE},
    _SPARSE: {1: _TENSOR, 2: _TENSOR},
    _FUNCTION: {7: _NODE},
    _TRAINING: {1: _GRAPH, 2: _GRAPH},
    _TENSOR: {13: _ENTRY},
}
"""Message type of each followed field, by message type and field number."""
_KEY, _VALUE = 1, 2
"""Fields of an entry of `external_data`."""
_MAX_DEPTH = 64
_VARINT, _FIXED_64, _BYTES, _FIXED_32 = 0, 1, 2, 5
"""Wire types of protobuf."""


def external_files(path: Path) -> tuple[Path, ...]:
    """Return the files with tensors that an ONNX file points to, each once, in the order of their names.

    The result is empty if the file is not valid protobuf. onnxruntime reports this error when it loads the file.

    Raises:
        WeightsError: The file cannot be read, a file is missing, or a location leaves the folder of the ONNX file.
    """
    content = memoryview(read_network(path))
    try:
        locations = sorted(set(_locations(content, _MODEL, 0)))
    except (IndexError, ValueError):
        return ()
    return tuple(_resolve(path, location) for location in locations)


def _resolve(path: Path, location: str) -> Path:
    """Return the path of an external file. Raises WeightsError if it is missing or outside the folder."""
    windows = PureWindowsPath(location)
    is_absolute = PurePosixPath(location).is_absolute() or bool(windows.anchor)
    file = path.parent / location
    if is_absolute or ".." in windows.parts or not file.resolve().is_relative_to(path.parent.resolve()):
        raise WeightsError(
            f"the network {path} stores weights in {location!r}, outside the folder of the network, expected all files "
            "in one folder: save the network again"
        )
    if not file.is_file():
        raise WeightsError(
            f"the network {path} stores weights in {location!r}, but this file is missing: copy it to {file}"
        )
    return file


def _locations(message: memoryview, kind: int, depth: int) -> Iterator[str]:
    """Yield the locations in a message. Raises ValueError or IndexError if it is not valid protobuf."""
    if depth > _MAX_DEPTH:
        raise ValueError(f"the network file has {depth} levels of nested messages, expected at most {_MAX_DEPTH}")
    children = _CHILDREN[kind]
    for number, content in _fields(message):
        child = children.get(number)
        if child == _ENTRY:
            entry = dict(_fields(content))
            if bytes(entry.get(_KEY, b"")) == b"location":
                yield bytes(entry[_VALUE]).decode()
        elif child is not None:
            yield from _locations(content, child, depth + 1)


def _fields(message: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield the number and content of each length-delimited field of a message."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind = key & 7
        if kind == _VARINT:
            _, at = _varint(message, at)
        elif kind in (_FIXED_64, _FIXED_32):
            at += 8 if kind == _FIXED_64 else 4
        elif kind == _BYTES:
            length, at = _varint(message, at)
            if at + length > len(message):
                raise ValueError(
                    "a protobuf field is longer than its message, so the file is damaged or has another format"
                )
            yield key >> 3, message[at : at + length]
            at += length
        else:
            raise ValueError(
                f"it contains the protobuf wire type {kind}, expected 0, 1, 2 or 5; it is damaged or has another format"
            )


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """Return a variable-length integer and the index after it."""
    value = 0
    for shift in range(0, 70, 7):
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("it contains an integer of more than 64 bits, so it is damaged or has another format")
