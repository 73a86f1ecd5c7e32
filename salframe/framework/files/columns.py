"""Rows of named arrays as packed columns: one .npy file a name, read by mapping it into memory."""

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

from salframe.framework.errors import DataError
from salframe.framework.files.array_files import MAX_AXIS, ArrayKind, map_array
from salframe.framework.files.reading import read_model, reading
from salframe.framework.files.writing import write_text
from salframe.framework.validation import Settings

TABLE, SHAPES = "columns.json", "shapes.npy"
_CHUNK = 1024
"""So many rows of a stream are held at once."""

Row = Mapping[str, np.ndarray]


class _Declared(Settings):
    """A name in columns.json: the shape of its arrays, None along an axis where rows differ, see shapes.npy; the words
    that the numbers of a column of strings stand for; the rows that have no such array."""

    name: str
    shape: tuple[Annotated[int, Field(ge=0)] | None, ...]
    words: tuple[str, ...] | None
    absent: tuple[Annotated[int, Field(ge=0)], ...]


class _Table(Settings):
    rows: int = Field(ge=0, le=1 << 24)
    columns: tuple[_Declared, ...]

    @model_validator(mode="after")
    def _check(self) -> _Table:
        names = [column.name for column in self.columns]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"the column {twice[0]!r} stands in it twice")
        for column in self.columns:
            if len(set(column.absent)) < len(column.absent) or max(column.absent, default=-1) >= self.rows:
                raise ValueError(f"{column.name} is absent in rows that there are not, or twice in one")
        return self


class PackedColumn:
    """The arrays of one name in R rows, their values mapped into memory, one row's after the other's.

    values (V,), read-only, numbers of `words` where the arrays are of strings; words: None where they are not; absent:
    the rows that have no such array.
    """

    def __init__(self, values: np.ndarray, words: tuple[str, ...] | None, absent: Iterable[int], shapes: np.ndarray):
        """shapes (R, axes): of the array in each row."""
        self.values, self.words, self.absent = values, words, frozenset(absent)
        self._shapes = shapes

    @cached_property
    def start(self) -> np.ndarray:
        """(R + 1,) int64: where each row's values begin, and where the last row's end."""
        sizes = self._shapes.prod(1, dtype=np.int64)
        return np.concatenate([[0], sizes.cumsum()])

    def __getitem__(self, row: int) -> np.ndarray:
        """The array of a row: of numbers a view, of strings a new one."""
        values = self.values[self.start[row] : self.start[row + 1]]
        if self.words is not None:
            values = np.array([self.words[number] for number in values.tolist()], np.str_)
        return values.reshape(self._shapes[row])


class Columns(Sequence[dict[str, np.ndarray]]):
    """The rows that `write_columns` wrote to `folder`, each made when it is asked for; columns: by their names."""

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
    """Write a stream of named arrays to a new folder: columns.json, the values of each name in NAME.npy, one row after
    the other, and the lengths along axes where rows differ in shapes.npy, (rows, axes).

    Strings are stored as numbers of words. Memory holds the words, and the shapes of all rows. Raises DataError on
    arrays of one name that differ in dimensions, hold strings and numbers, or Python objects.
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
        fixed = (shapes == shapes[0]).all(0)
        lengths.append(shapes[:, ~fixed])
        shape = [int(n) if same else None for n, same in zip(shapes[0], fixed, strict=True)]
        columns.append({"name": name, "shape": shape, "words": words, "absent": spool.absent})
    ragged = np.concatenate(lengths, 1)
    if ragged.size:
        np.save(folder / SHAPES, ragged.astype(np.min_scalar_type(ragged.max())), allow_pickle=False)
    write_text(folder / TABLE, json.dumps({"rows": count, "columns": columns}, separators=(",", ":")) + "\n")


class _Spool:
    """The values of one name on their way into its file: of which type they are together is known at the end."""

    def __init__(self, path: Path, name: str, first: np.ndarray) -> None:
        """first: one of its arrays."""
        self.absent: list[int] = []
        self._path, self._name = path, name
        self._spooled = path.with_suffix(".spool")
        self._spooled.touch()
        self._empty = first[:0] if first.ndim else np.zeros_like(first)
        self._shapes: list[np.ndarray] = []
        self._parts: list[tuple[np.dtype, int]] = []
        self._contents: set[str] = set()
        self._numbers: dict[str, int] = {}
        self._rows = 0

    def append(self, arrays: Sequence[np.ndarray | None]) -> None:
        """Take the arrays of the next rows, None where a row has none."""
        complete = [self._empty if array is None else np.asarray(array) for array in arrays]
        dimensions = sorted({self._empty.ndim, *(array.ndim for array in complete)})
        if len(dimensions) > 1:
            raise DataError(
                f"arrays of the name {self._name!r} have {dimensions} dimensions, expected the same number in all"
            )
        self._shapes.append(np.array([array.shape for array in complete], np.int64).reshape(len(arrays), *dimensions))
        self.absent += [self._rows + i for i, array in enumerate(arrays) if array is None]
        self._rows += len(arrays)
        if held := [array.ravel() for array in complete if array.size]:
            self._contents |= {_content(array) for array in held}
            if len(self._contents) > 1 or "Python objects" in self._contents:
                received = " and ".join(sorted(self._contents))
                raise DataError(f"arrays of the name {self._name!r} hold {received}, expected numbers or strings")
            self._write(np.concatenate(held))

    def _write(self, values: np.ndarray) -> None:
        """Spool values, of strings the numbers of words, in the order in which these came."""
        if self._contents == {"strings"}:
            words, place = np.unique(values, return_inverse=True)
            numbers = [self._numbers.setdefault(word, len(self._numbers)) for word in words.tolist()]
            values = np.array(numbers, np.uint32)[place]
        self._parts.append((values.dtype, len(values)))
        with self._spooled.open("ab") as file:
            values.tofile(file)

    def finish(self) -> tuple[np.ndarray, list[str] | None]:
        """Write the file; the shapes (R, axes) int64 of all rows' arrays, of empty ones where there was none, and the
        words that strings are the numbers of, in order."""
        dtype, words = np.result_type(*(part for part, _ in self._parts or [(self._empty.dtype, 0)])), None
        if self._contents == {"strings"} or dtype.kind == "U":
            words = sorted(self._numbers)
            rank = {word: i for i, word in enumerate(words)}
            order = np.array([rank[word] for word in self._numbers], np.int64)
            dtype = np.min_scalar_type(max(len(words) - 1, 0))
        shape = (sum(length for _, length in self._parts),)
        with self._path.open("xb") as file, self._spooled.open("rb") as spooled:
            header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(file, header)
            for part, length in self._parts:
                values = np.fromfile(spooled, part, length)
                (values if words is None else order[values]).astype(dtype).tofile(file)
        self._spooled.unlink()
        return np.concatenate(self._shapes), words


def _content(array: np.ndarray) -> str:
    if array.dtype.hasobject:
        return "Python objects"
    return "strings" if array.dtype.kind == "U" else "numbers"


def read_columns(folder: Path, expected: Mapping[str, ArrayKind] | None = None) -> Columns:
    """The rows that `write_columns` wrote, mapped into memory.

    expected: the columns that all rows must have, and no others; None: any. Raises DataError on whatever is damaged or
    not as expected.
    """
    table = read_model(folder / TABLE, _Table)
    if expected is not None and table.rows:
        _check_columns(folder / TABLE, table, expected)
    varying = sum(column.shape.count(None) for column in table.columns)
    lengths = iter(
        _read_lengths(folder / SHAPES, (table.rows, varying)) if table.rows and varying else np.zeros((varying, 0))
    )
    columns = {}
    for column in table.columns:
        path = _path(folder, column.name)
        with reading(path, "an array of numpy"):
            values = np.asarray(map_array(path))
        shapes = np.empty((table.rows, len(column.shape)), np.int64)
        for axis, length in enumerate(column.shape):
            shapes[:, axis] = next(lengths) if length is None else min(length, MAX_AXIS)
        if values.ndim != 1 or shapes.prod(1, dtype=float).sum() != len(values):
            raise DataError(f"{path} has values {values.shape}, expected as many as {folder / TABLE} says")
        if expected is not None and column.words is None:
            _check_values(path, values, expected[column.name])
        if column.words is not None:
            _check_words(path, values, column.words)
        columns[column.name] = PackedColumn(values, column.words, column.absent, shapes)
    return Columns(folder, table.rows, columns)


def _read_lengths(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """(axes, rows) the lengths along axes where rows differ."""
    with reading(path, "an array of numpy"):
        lengths = np.asarray(map_array(path))
    if lengths.shape != shape or lengths.dtype.kind != "u" or lengths.max(initial=0) > MAX_AXIS:
        raise DataError(f"{path} is {lengths.dtype} {lengths.shape}, expected lengths {shape}")
    return lengths.T


def _check_columns(path: Path, table: _Table, expected: Mapping[str, ArrayKind]) -> None:
    names = {column.name for column in table.columns}
    if names != expected.keys():
        raise DataError(f"{path} has the columns {', '.join(sorted(names))}, expected {', '.join(expected)}")
    for column in table.columns:
        kind = expected[column.name]
        if column.absent or not kind.fits("U" if column.words is not None else kind.kinds[0], column.shape):
            raise DataError(
                f"{path}: {column.name} has arrays {column.shape}, absent in {len(column.absent)} rows, expected {kind}"
            )


def _check_values(path: Path, values: np.ndarray, kind: ArrayKind) -> None:
    if values.dtype.kind not in kind.kinds:
        raise DataError(f"{path} holds {values.dtype}, expected {kind}")
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise DataError(f"{path} holds a number that is not finite")


def _check_words(path: Path, numbers: np.ndarray, words: Sequence[str]) -> None:
    if numbers.dtype.kind != "u" or (len(numbers) and numbers.max() >= len(words)):
        raise DataError(f"{path} holds {numbers.dtype}, expected the numbers of {len(words)} words")


def _path(folder: Path, name: str) -> Path:
    return folder / f"{quote(name, safe=' ')}.npy"
