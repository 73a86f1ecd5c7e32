"""Rows of named arrays as packed columns: one .npy file a name, read by mapping it into memory."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from salframe.framework.config import Settings
from salframe.framework.errors import DataError
from salframe.framework.files import read_model, write_text

TABLE, SHAPES = "columns.json", "shapes.npy"

Row = Mapping[str, np.ndarray]


class _Column(Settings):
    """A name in columns.json: the shape of its arrays, None along an axis where rows differ, see shapes.npy; the words
    that the numbers of a column of strings stand for; the rows that have no such array."""

    name: str
    shape: tuple[int | None, ...]
    words: tuple[str, ...] | None
    absent: tuple[int, ...]


class _Table(Settings):
    rows: int
    columns: tuple[_Column, ...]


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


def read_columns(folder: Path) -> list[dict[str, np.ndarray]]:
    """The rows that `write_columns` wrote. Arrays of numbers are read-only views of the files, mapped into memory."""
    table = read_model(folder / TABLE, _Table)
    rows: list[dict[str, np.ndarray]] = [{} for _ in range(table.rows)]
    lengths = iter(np.load(folder / SHAPES, allow_pickle=False).T if (folder / SHAPES).exists() else ())
    for column in table.columns:
        values = np.asarray(np.load(_path(folder, column.name), mmap_mode="r", allow_pickle=False))
        if column.words is not None:
            values = np.array(column.words, np.str_)[values]
        shapes = np.empty((table.rows, len(column.shape)), np.int64)
        for axis, length in enumerate(column.shape):
            shapes[:, axis] = next(lengths) if length is None else length
        ends = shapes.prod(1).cumsum().tolist()
        for row, start, end, shape in zip(rows, [0, *ends], ends, shapes.tolist(), strict=False):
            row[column.name] = values[start:end].reshape(shape)
        for i in column.absent:
            del rows[i][column.name]
    return rows


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
