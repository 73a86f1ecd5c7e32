"""Rows of named arrays as packed columns: one .npy file a name, read by mapping it into memory."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

import numpy as np
from pydantic import Field, model_validator

from salframe.framework.array_files import LONGEST_AXIS, ArrayKind, map_array
from salframe.framework.config import Settings
from salframe.framework.errors import DataError
from salframe.framework.files import read_model, reading, write_text

TABLE, SHAPES = "columns.json", "shapes.npy"

Row = Mapping[str, np.ndarray]


class _Column(Settings):
    """A name in columns.json: the shape of its arrays, None along an axis where rows differ, see shapes.npy; the words
    that the numbers of a column of strings stand for; the rows that have no such array."""

    name: str
    shape: tuple[Annotated[int, Field(ge=0)] | None, ...]
    words: tuple[str, ...] | None
    absent: tuple[Annotated[int, Field(ge=0)], ...]


class _Table(Settings):
    rows: int = Field(ge=0, le=1 << 24)
    columns: tuple[_Column, ...]

    @model_validator(mode="after")
    def _check(self) -> _Table:
        names = [column.name for column in self.columns]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"the column {twice[0]!r} stands in it twice")
        for column in self.columns:
            if len(set(column.absent)) < len(column.absent) or max(column.absent, default=-1) >= self.rows:
                raise ValueError(f"{column.name} is absent in rows that there are not, or twice in one")
        return self


def write_columns(folder: Path, rows: Sequence[Row]) -> None:
    """Write named arrays to a new folder: columns.json, the values of each name in NAME.npy, one row after the other,
    and the lengths along axes where rows differ in shapes.npy, (rows, axes).

    Strings are stored as numbers of words. Raises DataError on arrays of one name that differ in dimensions.
    """
    folder.mkdir()
    columns, lengths = [], []
    for name in dict.fromkeys(name for row in rows for name in row):
        arrays = _complete(name, [row.get(name) for row in rows])
        shapes = np.array([array.shape for array in arrays], np.int64)
        fixed = (shapes == shapes[0]).all(0)
        lengths.append(shapes[:, ~fixed])
        values, words = _number(np.concatenate([array.ravel() for array in arrays]))
        with _path(folder, name).open("xb") as file:  # no file system takes two names for one in silence
            np.save(file, values, allow_pickle=False)
        columns.append(
            {
                "name": name,
                "shape": [int(n) if same else None for n, same in zip(shapes[0], fixed, strict=True)],
                "words": words,
                "absent": [i for i, row in enumerate(rows) if name not in row],
            }
        )
    ragged = np.concatenate(lengths, 1) if lengths else np.zeros((len(rows), 0), np.int64)
    if ragged.size:
        np.save(folder / SHAPES, ragged.astype(np.min_scalar_type(ragged.max())), allow_pickle=False)
    write_text(folder / TABLE, json.dumps({"rows": len(rows), "columns": columns}, separators=(",", ":")) + "\n")


def read_columns(folder: Path, expected: Mapping[str, ArrayKind] | None = None) -> list[dict[str, np.ndarray]]:
    """The rows that `write_columns` wrote. Arrays of numbers are read-only views of the files, mapped into memory.

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
    rows: list[dict[str, np.ndarray]] = [{} for _ in range(table.rows)]
    for column in table.columns:
        path = _path(folder, column.name)
        with reading(path, "an array of numpy"):
            values = np.asarray(map_array(path))
        shapes = np.empty((table.rows, len(column.shape)), np.int64)
        for axis, length in enumerate(column.shape):
            shapes[:, axis] = next(lengths) if length is None else min(length, LONGEST_AXIS)
        if values.ndim != 1 or shapes.prod(1, dtype=float).sum() != len(values):
            raise DataError(f"{path} has values {values.shape}, expected as many as {folder / TABLE} says")
        if expected is not None and column.words is None:
            _check_values(path, values, expected[column.name])
        if column.words is not None:
            values = _spell(path, values, column.words)
        ends = shapes.prod(1).cumsum().tolist()
        for row, start, end, shape in zip(rows, [0, *ends], ends, shapes.tolist(), strict=False):
            row[column.name] = values[start:end].reshape(shape)
        for i in column.absent:
            del rows[i][column.name]
    return rows


def _read_lengths(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """(axes, rows) the lengths along axes where rows differ."""
    with reading(path, "an array of numpy"):
        lengths = np.asarray(map_array(path))
    if lengths.shape != shape or lengths.dtype.kind != "u" or lengths.max(initial=0) > LONGEST_AXIS:
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


def _spell(path: Path, numbers: np.ndarray, words: tuple[str, ...]) -> np.ndarray:
    """The words that numbers stand for."""
    if numbers.dtype.kind != "u" or numbers.max(initial=0) >= max(len(words), 1):
        raise DataError(f"{path} holds {numbers.dtype}, expected the numbers of {len(words)} words")
    return np.array(words, np.str_)[numbers] if len(numbers) else np.array([], np.str_)


def _path(folder: Path, name: str) -> Path:
    return folder / f"{quote(name, safe=' ')}.npy"


def _complete(name: str, values: Sequence[np.ndarray | None]) -> list[np.ndarray]:
    """The arrays of a name, an empty one where a row has none."""
    known = [np.asarray(value) for value in values if value is not None]
    dimensions = sorted({array.ndim for array in known})
    if len(dimensions) > 1:
        raise DataError(f"arrays of the name {name!r} have {dimensions} dimensions, expected the same number in all")
    empty = known[0][:0] if dimensions[0] else np.zeros_like(known[0])
    return [empty if value is None else np.asarray(value) for value in values]


def _number(values: np.ndarray) -> tuple[np.ndarray, list[str] | None]:
    """Strings as numbers of the words that they are, in the smallest type; other values as they are."""
    if values.dtype.kind != "U":
        return values, None
    words, number = np.unique(values, return_inverse=True)
    return number.astype(np.min_scalar_type(max(len(words) - 1, 0))), words.tolist()
