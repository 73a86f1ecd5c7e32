"""Arrays in .npy and .npz files: whatever a header claims is held against the bytes that are there."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.bounded import check_regular

MAX_BYTES = 1 << 29
"""Of the arrays of one .npz."""
MAX_AXIS = 1 << 24
"""Of an array without elements, whose axes no byte vouches for."""


class ArrayKind(NamedTuple):
    """What is expected of a named array: numpy's letters of its kind, any of them, and its shape, None for any
    length."""

    kinds: str
    shape: tuple[int | None, ...]

    def fits(self, kind: str, shape: tuple[int | None, ...]) -> bool:
        """Whether an array of this kind, whose lengths are known or vary (None), is as expected."""
        return (
            kind in self.kinds
            and len(shape) == len(self.shape)
            and all(want in (None, got) for want, got in zip(self.shape, shape, strict=True))
        )


def check_arrays(arrays: Mapping[str, np.ndarray], expected: Mapping[str, ArrayKind], where: object) -> None:
    """Raises DataError where the named arrays found at a place are not exactly those expected."""
    if arrays.keys() != expected.keys():
        wrong = ", ".join(sorted(arrays.keys() ^ expected.keys())[:3])
        raise DataError(f"{where} lacks arrays or has others ({wrong}), expected {', '.join(expected)}")
    for name, array in arrays.items():
        if not expected[name].fits(array.dtype.kind, array.shape):
            raise DataError(f"{where}: {name} is {array.dtype} {array.shape}, expected {expected[name]}")
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise DataError(f"{where}: {name} holds a number that is not finite")


def parse_arrays(content: bytes) -> dict[str, np.ndarray]:
    """The named arrays of a .npz, never unpickled. Raises ValueError."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            claimed = sum(member.file_size for member in members)
            if claimed > MAX_BYTES:
                raise ValueError(f"arrays of {claimed} bytes, expected at most {MAX_BYTES}")
            arrays = {member.filename.removesuffix(".npy"): _parse(archive.read(member)) for member in members}
    except ValueError:
        raise
    except Exception as error:  # zipfile and zlib raise whatever they stumble over
        raise ValueError(f"{type(error).__name__}: {error}") from None
    if len(arrays) < len(members):
        raise ValueError("two arrays of one name")
    return arrays


def pack_arrays(arrays: Mapping[str, np.ndarray]) -> bytes:
    """The content of a compressed .npz of named arrays."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]  # numpy's stub takes no mapping here
    return file.getvalue()


def map_array(path: Path) -> np.ndarray:
    """The array of a .npy file, mapped into memory, read-only. Raises OSError, ValueError."""
    size = check_regular(path, 1 << 40)
    with path.open("rb") as file:
        dtype, shape, order = _header(file, size)
        start = file.tell()
    if 0 in shape:  # nothing to map
        return np.zeros(shape, dtype, order)
    return np.memmap(path, dtype, "r", start, shape, order)


def _parse(content: bytes) -> np.ndarray:
    file = io.BytesIO(content)
    dtype, shape, order = _header(file, len(content))
    return np.ndarray(shape, dtype, bytearray(content), file.tell(), order=order)


def _header(file: BinaryIO, size: int) -> tuple[np.dtype[Any], tuple[int, ...], Literal["C", "F"]]:
    """The dtype, shape and order of a .npy file of this size, opened at its beginning; leaves it at the values. Raises
    ValueError where these are not as many as the header says, or Python objects."""
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, by_columns, dtype = read(file)
    except Exception as error:  # numpy raises whatever Python's parser stumbles over
        raise ValueError(f"no array of numpy: {' '.join(str(error).split())[:100]}") from None
    if dtype.hasobject:
        raise ValueError("an array of Python objects, expected numbers or text")
    count, held = 1, size - file.tell()
    for length in shape:
        count *= length
    if min(shape, default=0) < 0 or count * dtype.itemsize != held or (not held and max(shape, default=0) > MAX_AXIS):
        raise ValueError(f"{held} bytes of values, expected {count * dtype.itemsize} of {dtype} {shape}")
    return dtype, shape, "F" if by_columns else "C"
