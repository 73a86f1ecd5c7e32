"""Validated reading of files of limited size.

Every reader raises DataError with one line: the file, the location in it, the received and the expected value. Settings
in YAML are read by `salframe.framework.config`. The limits are in `salframe.framework.files.bounded`.
"""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from salframe.framework.errors import ConfigError, DataError, WeightsError, content_type, one_line
from salframe.framework.files.array_files import MAX_BYTES, parse_arrays
from salframe.framework.files.bounded import check_regular, parse_json, read_bytes, why
from salframe.framework.validation import describe_faults, validate

_Model = TypeVar("_Model", bound=BaseModel)

_MAX_LOG, _MAX_NETWORK = 1 << 30, 1 << 31
"""Maximum sizes of a .jsonl file and of a network, in bytes."""
_MAX_ROWS = 1 << 20
"""Maximum number of rows of a table."""


@contextmanager
def reading(path: Path, expected: str) -> Iterator[None]:
    """Replace an OSError or ValueError of the `with` block by a DataError with the file and the expected content."""
    try:
        yield
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or one_line(error)}, expected {expected}") from None
    except ValueError as error:
        raise DataError(f"{path} is not {expected}: {one_line(error)}") from None


def read_text(path: Path, expected: str = "a text file") -> str:
    """Read text in UTF-8. Raises DataError if the file cannot be read. Its message names the `expected` content."""
    with reading(path, expected):
        return read_bytes(path).decode("utf-8-sig")


def read_json(path: Path) -> Any:
    """Read JSON. Raises DataError if the file cannot be read or is not JSON."""
    with reading(path, "JSON"):
        return parse_json(read_bytes(path))


def read_as(path: Path, kind: Any) -> Any:
    """Read JSON and validate it as a type that pydantic supports. Raises DataError if it is invalid."""
    return check_as(read_json(path), kind, path)


def check_as(content: Any, kind: Any, where: object) -> Any:
    """Validate a value as a type that pydantic supports.

    Args:
        content: The value.
        kind: The type.
        where: The location of the value, for messages.

    Returns:
        The validated value.

    Raises:
        DataError: The value is invalid.
    """
    try:
        return _adapter(kind).validate_python(content)
    except ValidationError as error:
        raise DataError(describe_faults(error, f"{where}:")) from None


_adapter = lru_cache(maxsize=64)(TypeAdapter)


def read_model(path: Path, model: type[_Model]) -> _Model:
    """Read JSON as an instance of a pydantic model. Raises DataError if it is invalid."""
    content = read_json(path)
    if not isinstance(content, Mapping):
        raise DataError(f"{path} contains {content_type(content)}, expected a JSON object")
    try:
        return validate(model, content, f"{path}:")
    except ConfigError as error:
        raise DataError(str(error)) from None


def read_lines(path: Path) -> Iterator[Any]:
    """Yield the values of a .jsonl file, one per line.

    Text after the last newline is skipped: it is the incomplete line of a process that was killed.

    Raises:
        DataError: The file cannot be read, or a line is not JSON.
    """
    with reading(path, "a file of JSON lines"):
        lines = read_bytes(path, _MAX_LOG).split(b"\n")[:-1]
    for number, line in enumerate(lines, 1):
        try:
            yield parse_json(line)
        except ValueError:
            raise DataError(
                f"{path}, line {number}, is not valid JSON: remove this line; the next run computes its result again"
            ) from None


def whole_lines_bytes(path: Path) -> int:
    """Return the total size of the complete lines of a .jsonl file, in bytes. Raises DataError."""
    with reading(path, "a file of JSON lines"):
        return read_bytes(path, _MAX_LOG).rfind(b"\n") + 1


def copy_log(path: Path, target: Path) -> None:
    """Copy a .jsonl or JSON file. Raises DataError if it is too large or not a regular file."""
    with reading(path, "a file of JSON"):
        check_regular(path, _MAX_LOG)
        shutil.copyfile(path, target)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read named arrays from a .npz file without unpickling. Raises DataError."""
    with reading(path, "an array archive"):
        return parse_arrays(read_bytes(path, MAX_BYTES))


def read_table(path: Path, row: type[_Model]) -> list[_Model]:
    """Read the rows of a Parquet table.

    Args:
        path: The file.
        row: The model of a row. Only the columns in its fields are read.

    Raises:
        DataError: The file is not a Parquet table, a column is missing, or a value is invalid.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with reading(path, "a Parquet table"):
            table = pq.ParquetFile(pa.BufferReader(read_bytes(path)), page_checksum_verification=True)
            names = set(table.schema_arrow.names)
            absent = row.model_fields.keys() - names
            if absent:
                raise DataError(
                    f"{path} has no column {' and no column '.join(sorted(absent))}, expected the columns "
                    f"{', '.join(row.model_fields)}"
                )
            if table.metadata.num_rows > _MAX_ROWS:
                raise ValueError(f"the file has {table.metadata.num_rows} rows, expected at most {_MAX_ROWS}")
            rows = table.read(columns=list(row.model_fields), use_threads=False).to_pylist()
    except (pa.ArrowException, MemoryError, KeyError) as error:
        raise DataError(f"{path} is not a Parquet table: {one_line(error)}") from None
    validated: list[_Model] = check_as(rows, list[row], path)  # type: ignore[valid-type]
    return validated


def read_csv_numbers(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> np.ndarray:
    """Read columns of numbers from a CSV file with a header, (N, C) float64. Other columns are ignored.

    Columns in `optional` follow the others. They are NaN where the file does not have them.

    Raises:
        DataError: The file is not a CSV table, a column is missing, or a value is not a finite number.
    """
    texts = read_csv_texts(path, columns, optional)
    names = [*columns, *optional]
    numbers = np.full((len(texts[names[0]]), len(names)), np.nan)
    for place, name in enumerate(names):
        for number, text in enumerate(texts.get(name, ())):
            try:
                numbers[number, place] = float(text)
            except ValueError:
                numbers[number, place] = np.nan
            if not np.isfinite(numbers[number, place]):
                raise DataError(f"{path}: the column {name} is {text!r} in row {number + 1}, expected a finite number")
    return numbers


def read_csv_texts(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> dict[str, list[str]]:
    """Read columns of a CSV file with a header as text, by name. Other columns are ignored.

    Columns in `optional` are left out where the file does not have them.

    Raises:
        DataError: The file is not a CSV table, or a column is missing.
    """
    reader = csv.reader(io.StringIO(read_text(path, "a CSV table")), skipinitialspace=True)
    try:
        rows = [row for row in reader if row]
    except csv.Error as error:
        raise DataError(f"{path} is not a CSV table: {one_line(error)}") from None
    header = [name.strip() for name in rows[0]] if rows else []
    if absent := [name for name in columns if name not in header]:
        raise DataError(f"{path} has no column {absent[0]}, expected the columns {','.join(columns)}")
    if len(rows) - 1 > _MAX_ROWS:
        raise DataError(f"{path} has {len(rows) - 1} rows, expected at most {_MAX_ROWS}")
    indices = {name: header.index(name) for name in (*columns, *optional) if name in header}
    return {name: [row[index] if index < len(row) else "" for row in rows[1:]] for name, index in indices.items()}


def read_network(path: Path) -> bytes:
    """Read the file of a network as bytes. Raises WeightsError if it cannot be read or is too large."""
    try:
        return read_bytes(path, _MAX_NETWORK)
    except (OSError, ValueError) as error:
        raise WeightsError(f"cannot read {path}: {why(error)}") from None
