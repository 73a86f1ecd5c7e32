"""Arrays in .npy and .npz files. The sizes in a header are checked against the size of the file."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.bounded import check_regular, read_bytes

MAX_BYTES = 1 << 29
"""Maximum size of the arrays in a .npz file, in bytes."""
MAX_READ_BYTES = 1 << 26
"""Minimum size in bytes of a .npy file to be memory-mapped. Smaller files are read into memory."""
MAX_AXIS = 1 << 24
"""Maximum axis length of an array without elements. The size of the file cannot confirm its shape."""


_KIND_WORDS = {"b": "booleans", "i": "integers", "u": "unsigned integers", "f": "floats", "U": "text"}
"""The word for each `dtype.kind` of a saved array."""


def spell_shape(shape: tuple[int | None, ...]) -> str:
    """Return a shape as text, with `*` for an axis of any length."""
    return f"({', '.join('*' if length is None else str(length) for length in shape)})"


class ArrayKind(NamedTuple):
    """The expected kind and shape of a named array.

    Attributes:
        kinds: The allowed values of `dtype.kind`, as one string.
        shape: The length of each axis, None for any length.
    """

    kinds: str
    shape: tuple[int | None, ...]

    def __str__(self) -> str:
        words = " or ".join(_KIND_WORDS[kind] for kind in self.kinds)
        legend = " (*: any length)" if None in self.shape else ""
        return f"{words} of shape {spell_shape(self.shape)}{legend}"

    def fits(self, kind: str, shape: tuple[int | None, ...]) -> bool:
        """Return whether an array of this `dtype.kind` and shape fits. None stands for an axis of varying length."""
        return (
            kind in self.kinds
            and len(shape) == len(self.shape)
            and all(want in (None, got) for want, got in zip(self.shape, shape, strict=True))
        )


def check_arrays(arrays: Mapping[str, np.ndarray], expected: Mapping[str, ArrayKind], where: object) -> None:
    """Check that the named arrays are exactly the expected ones, with finite values.

    Args:
        arrays: The arrays by name.
        expected: The expected kind of each array.
        where: The location of the arrays, for messages.

    Raises:
        DataError: An array is missing, unexpected, of the wrong kind or shape, or not finite.
    """
    if arrays.keys() != expected.keys():
        lacking, unexpected = sorted(expected.keys() - arrays.keys())[:3], sorted(arrays.keys() - expected.keys())[:3]
        received = [f"no array {' and no array '.join(lacking)}"] if lacking else []
        received += [f"the unexpected array {' and the unexpected array '.join(unexpected)}"] if unexpected else []
        raise DataError(f"{where} has {' and '.join(received)}, expected the arrays {', '.join(expected)}")
    for name, array in arrays.items():
        if not expected[name].fits(array.dtype.kind, array.shape):
            raise DataError(
                f"{where}: the array {name} has dtype {array.dtype} and shape {array.shape}, expected {expected[name]}"
            )
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise DataError(f"{where}: the array {name} contains NaN or infinity, expected finite numbers")


def parse_arrays(content: bytes) -> dict[str, np.ndarray]:
    """Return the named arrays of a .npz file without unpickling. Raises ValueError if they are invalid."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            num_bytes = sum(member.file_size for member in members)
            if num_bytes > MAX_BYTES:
                raise ValueError(f"the arrays in the file have {num_bytes} bytes, expected at most {MAX_BYTES}")
            arrays = {member.filename.removesuffix(".npy"): _parse(archive.read(member)) for member in members}
    except ValueError:
        raise
    except Exception as error:  # zipfile and zlib raise many types of exceptions
        raise ValueError(f"the .npz archive is damaged ({error})") from None
    if len(arrays) < len(members):
        raise ValueError("the file has two arrays with the same name, expected different names")
    return arrays


def pack_arrays(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return the content of a compressed .npz file with named arrays."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]  # the type stub of numpy does not allow a mapping here
    return file.getvalue()


def map_array(path: Path) -> np.ndarray:
    """Return the array of a .npy file: in memory if the file is smaller than MAX_READ_BYTES, else as a memory map.

    If another program changes the file later, an array in memory stays the same. A memory map changes with the file. If
    the file is truncated, access to the memory map crashes the process. Code that uses a memory map must therefore
    check the `FileStamp` of the file before each use.

    Returns:
        The array, read-only.

    Raises:
        OSError: The file cannot be read.
        ValueError: The file holds no valid array.
    """
    size = check_regular(path, 1 << 40)
    if size < MAX_READ_BYTES:
        content = read_bytes(path, MAX_READ_BYTES)
        header = io.BytesIO(content)
        dtype, shape, order = _header(header, len(content))
        return np.ndarray(shape, dtype, content, header.tell(), order=order)
    with path.open("rb") as file:
        dtype, shape, order = _header(file, size)
        start = file.tell()
    return np.memmap(path, dtype, "r", start, shape, order)


class FileStamp(NamedTuple):
    """Size and modification time of a file, to detect changes."""

    path: Path
    size: int
    modified_ns: int

    @classmethod
    def of(cls, path: Path) -> FileStamp:
        """Return the stamp of a file now. Raises OSError."""
        status = path.stat()
        return cls(path, status.st_size, status.st_mtime_ns)

    def is_current(self) -> bool:
        """Return whether the file still has this size and modification time."""
        try:
            return FileStamp.of(self.path) == self
        except OSError:
            return False


def _parse(content: bytes) -> np.ndarray:
    file = io.BytesIO(content)
    dtype, shape, order = _header(file, len(content))
    return np.ndarray(shape, dtype, bytearray(content), file.tell(), order=order)


def _header(file: BinaryIO, size: int) -> tuple[np.dtype[Any], tuple[int, ...], Literal["C", "F"]]:
    """Read the header of a .npy file. Afterwards the file position is at the first value.

    Args:
        file: The file, at its beginning.
        size: The size of the file in bytes.

    Returns:
        The dtype, shape and memory order of the array.

    Raises:
        ValueError: The header is invalid, the size of the file contradicts it, or values are Python objects.
    """
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, by_columns, dtype = read(file)
    except Exception as error:  # numpy raises many types of exceptions
        raise ValueError(f"the header of the .npy array is invalid: {' '.join(str(error).split())[:100]}") from None
    if dtype.hasobject or dtype.kind in "mM":
        content = "Python objects" if dtype.hasobject else dtype
        raise ValueError(f"the file has an array of {content}, expected numbers or text")
    count, num_bytes = 1, size - file.tell()
    for length in shape:
        count *= length
    if min(shape, default=0) < 0 or (not num_bytes and max(shape, default=0) > MAX_AXIS):
        raise ValueError(f"the file has an array of shape {shape}, expected axis lengths from 0 to {MAX_AXIS}")
    if count * dtype.itemsize != num_bytes:
        raise ValueError(
            f"the file has {num_bytes} bytes of values, expected {count * dtype.itemsize} for dtype {dtype} and "
            f"shape {shape}"
        )
    return dtype, shape, "F" if by_columns else "C"
