"""Rows of named arrays, stored as packed columns: one .npy file per name, memory-mapped if it is large."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import numpy as np
from pydantic import Field, model_validator

from salframe.framework.errors import DataError, counted
from salframe.framework.files.array_files import MAX_AXIS, ArrayKind, map_array, spell_shape
from salframe.framework.files.reading import read_model, reading
from salframe.framework.files.writing import write_text
from salframe.framework.validation import Settings

TABLE, SHAPES = "columns.json", "shapes.npy"
_CHUNK = 1024
"""Number of rows of a stream that are in memory at once."""

Row = Mapping[str, np.ndarray]


_KINDS = {"i": "iuf", "u": "iuf"}
"""`dtype.kind` of an array -> allowed kinds of its column. A column of integers and floats is stored as floats."""


class _Declared(Settings):
    """A column in columns.json.

    Attributes:
        name: The name of the column.
        shape: The shape of the arrays. None for an axis whose length differs between rows: shapes.npy has the lengths.
        words: The distinct strings of a column of strings. Its values are indices into them. None for numbers.
        absent: The indices of the rows without an array of this name.
    """

    name: str
    shape: tuple[Annotated[int, Field(ge=0)] | None, ...]
    words: tuple[str, ...] | None
    absent: tuple[Annotated[int, Field(ge=0)], ...]


class _TableHeader(Settings):
    rows: int = Field(ge=0, le=1 << 24)
    columns: tuple[_Declared, ...]

    @model_validator(mode="after")
    def _check(self) -> _TableHeader:
        names = [column.name for column in self.columns]
        if duplicates := [name for name in names if names.count(name) > 1]:
            raise ValueError(
                f"the list of columns has {duplicates[0]!r} twice, expected different names: build the map again"
            )
        for column in self.columns:
            if len(set(column.absent)) < len(column.absent) or max(column.absent, default=-1) >= self.rows:
                raise ValueError(
                    f"the list `absent` of the column {column.name!r} has a row number that is repeated or too large, "
                    f"expected different row numbers below {self.rows}: build the map again"
                )
        return self


class PackedColumn:
    """The arrays of one name in R rows, with concatenated values.

    Attributes:
        values: (V,) read-only values, memory-mapped if the file is large. For strings, indices into `words`.
        words: The distinct strings of a column of strings. None for a column of numbers.
        absent: The indices of the rows without an array of this name.
    """

    def __init__(self, values: np.ndarray, words: tuple[str, ...] | None, absent: Iterable[int], shapes: np.ndarray):
        """Create a column. `shapes` (R, axes) are the shapes of the arrays."""
        self.values, self.words, self.absent = values, words, frozenset(absent)
        self._shapes = shapes

    @cached_property
    def start(self) -> np.ndarray:
        """(R + 1,) int64: the index of the first value of each row, and of the end of the last row."""
        sizes = self._shapes.prod(1, dtype=np.int64)
        return np.concatenate([[0], sizes.cumsum()])

    def __getitem__(self, row: int) -> np.ndarray:
        """Return the array of a row: a view of numbers, or a new array of strings."""
        values = self.values[self.start[row] : self.start[row + 1]]
        if self.words is not None:
            values = np.array([self.words[number] for number in values.tolist()], np.str_)
        return values.reshape(self._shapes[row])


class Columns(Sequence[dict[str, np.ndarray]]):
    """The rows in a folder written by `write_columns`. Rows are created on access.

    Attributes:
        folder: The folder.
        columns: The columns by name.
    """

    def __init__(self, folder: Path, rows: int, columns: Mapping[str, PackedColumn]) -> None:
        self.folder, self.columns, self._rows = folder, columns, rows

    def __len__(self) -> int:
        return self._rows

    def __getitem__(self, row: Any) -> Any:
        if isinstance(row, slice):
            return [self[i] for i in range(self._rows)[row]]
        row = range(self._rows)[row]
        return {name: column[row] for name, column in self.columns.items() if row not in column.absent}


def write_columns(folder: Path, rows: Iterable[Row]) -> None:
    """Write a stream of rows of named arrays to a new folder.

    The file columns.json lists the columns. NAME.npy has the concatenated values of one column. shapes.npy (rows, axes)
    has the lengths of the axes whose length differs between rows. Each distinct string is stored once, and the values
    of its column are indices. Memory holds only the distinct strings, the shapes, and a few rows at a time.

    Raises:
        DataError: Arrays of one name have different numbers of dimensions, mix strings and numbers, or hold Python
            objects.
    """
    folder.mkdir()
    count, spools = 0, dict[str, _Spool]()
    stream = iter(rows)
    while chunk := list(islice(stream, _CHUNK)):
        for name in dict.fromkeys(name for row in chunk for name in row):
            if name not in spools:
                first = next(row[name] for row in chunk if name in row)
                spools[name] = _Spool(_path(folder, name), name, np.asarray(first))
                spools[name].append([None] * count)
        for name, spool in spools.items():
            spool.append([row.get(name) for row in chunk])
        count += len(chunk)
    columns, lengths = [], [np.zeros((count, 0), np.int64)]
    for name, spool in spools.items():
        shapes, words = spool.finish()
        is_fixed = (shapes == shapes[0]).all(0)
        lengths.append(shapes[:, ~is_fixed])
        shape = [int(n) if same else None for n, same in zip(shapes[0], is_fixed, strict=True)]
        columns.append({"name": name, "shape": shape, "words": words, "absent": spool.absent})
    varying_lengths = np.concatenate(lengths, 1)
    if varying_lengths.size:
        np.save(folder / SHAPES, varying_lengths.astype(np.min_scalar_type(varying_lengths.max())), allow_pickle=False)
    write_text(folder / TABLE, json.dumps({"rows": count, "columns": columns}, separators=(",", ":")) + "\n")


class _Spool:
    """Buffer file of the values of one name. Their common type is known only after the last row."""

    def __init__(self, path: Path, name: str, first: np.ndarray) -> None:
        """Create the buffer file. `first` is the first array of this name."""
        self.absent: list[int] = []
        self._path, self._name = path, name
        self._spool_path = path.with_suffix(".spool")
        self._spool_path.touch()
        self._empty = first[:0] if first.ndim else np.zeros_like(first)
        self._shapes: list[np.ndarray] = []
        self._parts: list[tuple[np.dtype, int]] = []
        self._contents: set[str] = set()
        self._numbers: dict[str, int] = {}
        self._rows = 0

    def append(self, arrays: Sequence[np.ndarray | None]) -> None:
        """Append the arrays of the next rows, None for a row without one."""
        complete = [self._empty if array is None else np.asarray(array) for array in arrays]
        dimensions = sorted({self._empty.ndim, *(array.ndim for array in complete)})
        if len(dimensions) > 1:
            raise DataError(
                f"the method computed arrays {self._name!r} with {' and '.join(map(str, dimensions))} dimensions, "
                "expected the same number of dimensions for all panoramas"
            )
        self._shapes.append(np.array([array.shape for array in complete], np.int64).reshape(len(arrays), *dimensions))
        self.absent += [self._rows + i for i, array in enumerate(arrays) if array is None]
        self._rows += len(arrays)
        if parts := [array.ravel() for array in complete if array.size]:
            self._contents |= {_content(array) for array in parts}
            if len(self._contents) > 1 or "Python objects" in self._contents:
                received = " and ".join(sorted(self._contents))
                raise DataError(
                    f"the method computed arrays {self._name!r} that contain {received}, expected either only "
                    "numbers or only strings"
                )
            self._write(np.concatenate(parts))

    def _write(self, values: np.ndarray) -> None:
        """Append values to the buffer file. Strings become indices of words, in the order of first occurrence."""
        if self._contents == {"strings"}:
            words, index = np.unique(values, return_inverse=True)
            numbers = [self._numbers.setdefault(word, len(self._numbers)) for word in words.tolist()]
            values = np.array(numbers, np.uint32)[index]
        self._parts.append((values.dtype, len(values)))
        with self._spool_path.open("ab") as file:
            values.tofile(file)

    def finish(self) -> tuple[np.ndarray, list[str] | None]:
        """Write the .npy file and remove the buffer file.

        Returns:
            The shapes (R, axes) int64 of the arrays, and the sorted words of a column of strings (None for numbers).
            A row without an array has the shape of an empty array.
        """
        dtype, words = np.result_type(*(part for part, _ in self._parts or [(self._empty.dtype, 0)])), None
        if self._contents == {"strings"} or dtype.kind == "U":
            words = sorted(self._numbers)
            rank = {word: i for i, word in enumerate(words)}
            order = np.array([rank[word] for word in self._numbers], np.int64)
            dtype = np.min_scalar_type(max(len(words) - 1, 0))
        shape = (sum(length for _, length in self._parts),)
        with self._path.open("xb") as file, self._spool_path.open("rb") as spool_file:
            header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(file, header)
            for part, length in self._parts:
                values = np.fromfile(spool_file, part, length)
                (values if words is None else order[values]).astype(dtype).tofile(file)
        self._spool_path.unlink()
        return np.concatenate(self._shapes), words


def _content(array: np.ndarray) -> str:
    """Return the type of the elements, in words."""
    if array.dtype.hasobject:
        return "Python objects"
    return "strings" if array.dtype.kind == "U" else "numbers"


def read_columns(folder: Path, expected: Mapping[str, ArrayKind] | None = None) -> Columns:
    """Open a folder written by `write_columns`. Large files are memory-mapped, small files are read.

    Args:
        folder: The folder.
        expected: The kind of each column. The folder must have exactly these columns. None: any columns.

    Raises:
        DataError: A file is damaged or a column is not as expected.
    """
    table = read_model(folder / TABLE, _TableHeader)
    if expected is not None and table.rows:
        _check_columns(folder / TABLE, table, expected)
    varying = sum(column.shape.count(None) for column in table.columns)
    lengths = iter(
        _read_lengths(folder / SHAPES, (table.rows, varying)) if table.rows and varying else np.zeros((varying, 0))
    )
    columns = {}
    for column in table.columns:
        path = _path(folder, column.name)
        with reading(path, "a numpy array"):
            values = np.asarray(map_array(path))
        shapes = np.empty((table.rows, len(column.shape)), np.int64)
        for axis, length in enumerate(column.shape):
            shapes[:, axis] = next(lengths) if length is None else min(length, MAX_AXIS)
        if values.ndim != 1 or shapes.prod(1, dtype=float).sum() != len(values):
            raise DataError(
                f"{path} has an array of shape {values.shape}, expected ({shapes.prod(1, dtype=float).sum():.0f},) "
                f"according to {folder / TABLE}: build the map again"
            )
        if expected is not None and column.words is None:
            _check_values(path, values, expected[column.name])
        if column.words is not None:
            _check_words(path, values, column.words)
        columns[column.name] = PackedColumn(values, column.words, column.absent, shapes)
    return Columns(folder, table.rows, columns)


def _read_lengths(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """Return the lengths (axes, rows) of the axes whose length differs between rows."""
    with reading(path, "a numpy array"):
        lengths = np.asarray(map_array(path))
    if lengths.shape != shape or lengths.dtype.kind != "u" or lengths.max(initial=0) > MAX_AXIS:
        raise DataError(
            f"{path} has an array of dtype {lengths.dtype} and shape {lengths.shape}, expected unsigned integers of "
            f"at most {MAX_AXIS} and shape {shape}: build the map again"
        )
    return lengths.T


def check_kinds(columns: Columns, row: Row) -> None:
    """Check that each column has the same `dtype.kind` as the array with the same name in the example `row`.

    Raises:
        DataError: The kinds differ: for example, a column contains booleans, and the array in `row` floats.
    """
    for name, array in row.items():
        column, kind = columns.columns.get(name), np.asarray(array).dtype.kind
        if column is None or not len(column.values) or not np.asarray(array).size:
            continue
        saved = "U" if column.words is not None else column.values.dtype.kind
        if saved not in _KINDS.get(kind, kind):
            path = _path(columns.folder, name)
            raise DataError(
                f"{path} contains values of dtype {column.values.dtype}, expected {np.asarray(array).dtype}: build the "
                "map again"
            )


def _check_columns(path: Path, table: _TableHeader, expected: Mapping[str, ArrayKind]) -> None:
    names = {column.name for column in table.columns}
    if names != expected.keys():
        raise DataError(
            f"{path} has the columns {', '.join(sorted(names))}, expected {', '.join(expected)}: build the map again"
        )
    for column in table.columns:
        kind = expected[column.name]
        if column.absent or not kind.fits("U" if column.words is not None else kind.kinds[0], column.shape):
            raise DataError(
                f"{path}: the column {column.name} has arrays of shape {spell_shape(column.shape)} and "
                f"{counted(len(column.absent), 'row')} without an array, expected {kind} in every row: build the map "
                "again"
            )


def _check_values(path: Path, values: np.ndarray, kind: ArrayKind) -> None:
    if values.dtype.kind not in kind.kinds:
        raise DataError(f"{path} contains values of dtype {values.dtype}, expected {kind}: build the map again")
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise DataError(f"{path} contains NaN or infinity, expected finite numbers: build the map again")


def _check_words(path: Path, numbers: np.ndarray, words: Sequence[str]) -> None:
    if numbers.dtype.kind != "u":
        raise DataError(
            f"{path} contains values of dtype {numbers.dtype}, expected unsigned integers: build the map again"
        )
    if len(numbers) and numbers.max() >= len(words):
        raise DataError(
            f"{path} contains the index {numbers.max()} into a list of {len(words)} strings, expected an index below "
            f"{len(words)}: build the map again"
        )


def _path(folder: Path, name: str) -> Path:
    return folder / f"{quote(name, safe=' ')}.npy"
