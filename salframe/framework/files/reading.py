"""Reading files: within bounds, and checked to be what they should be.

Every reader raises DataError, in one line: which file, where in it, what was received, what was expected. Settings in
YAML are read by `salframe.framework.config`; `salframe.framework.files.bounded` has the bounds.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from salframe.framework.errors import ConfigError, DataError, WeightsMissing, one_line
from salframe.framework.files.array_files import MAX_BYTES, parse_arrays
from salframe.framework.files.bounded import parse_json, read_bytes, why
from salframe.framework.validation import describe_faults, validate

_Model = TypeVar("_Model", bound=BaseModel)

_MAX_LOG, _MAX_NETWORK = 1 << 30, 1 << 31
"""Bytes of a .jsonl file, and of a network."""
_MAX_ROWS, _MAX_PIXELS = 1 << 20, 1 << 26
_END_OF_JPEG, _SCAN_OF_JPEG = b"\xff\xd9", b"\xff\xda"
_END_OF_PNG = b"\0\0\0\0IEND\xaeB`\x82"


@contextmanager
def reading(path: Path, expected: str) -> Iterator[None]:
    """Say in one line which file cannot be read, or is not what was expected: DataError in place of OSError,
    ValueError."""
    try:
        yield
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or one_line(error)}, expected {expected}") from None
    except ValueError as error:
        raise DataError(f"{path} is not {expected}: {one_line(error)}") from None


def read_text(path: Path, expected: str = "a text file") -> str:
    """Read text in UTF-8. Raises DataError where the file is missing or is not the text `expected`."""
    with reading(path, expected):
        return read_bytes(path).decode("utf-8-sig")


def read_json(path: Path) -> Any:
    """Read JSON. Raises DataError where the file is missing or is no JSON."""
    with reading(path, "JSON"):
        return parse_json(read_bytes(path))


def read_as(path: Path, kind: Any) -> Any:
    """Read JSON as a type that pydantic knows. Raises DataError, in one line, on whatever does not fit."""
    return check_as(read_json(path), kind, path)


def check_as(content: Any, kind: Any, where: object) -> Any:
    """A value as a type that pydantic knows. Raises DataError, in one line, on whatever does not fit."""
    try:
        return _adapter(kind).validate_python(content)
    except ValidationError as error:
        raise DataError(describe_faults(error, f"{where}:")) from None


_adapter = lru_cache(maxsize=64)(TypeAdapter)


def read_model(path: Path, model: type[_Model]) -> _Model:
    """Read JSON as an instance of a pydantic model. Raises DataError, in one line, on whatever does not fit."""
    content = read_json(path)
    if not isinstance(content, Mapping):
        raise DataError(f"{path} holds {type(content).__name__}, expected an object")
    try:
        return validate(model, content, f"{path}:")
    except ConfigError as error:
        raise DataError(str(error)) from None


def read_lines(path: Path) -> Iterator[Any]:
    """The values of a .jsonl file, one a line; what follows the last newline was cut off by a kill, and is left out.
    Raises DataError."""
    with reading(path, "a file of JSON lines"):
        lines = read_bytes(path, _MAX_LOG).split(b"\n")[:-1]
    for number, line in enumerate(lines, 1):
        try:
            yield parse_json(line)
        except ValueError:
            raise DataError(f"{path}, line {number}, is not JSON: remove the line to have it asked again") from None


def whole_lines_bytes(path: Path) -> int:
    """How many bytes of a .jsonl file are whole lines. Raises DataError."""
    with reading(path, "a file of JSON lines"):
        return read_bytes(path, _MAX_LOG).rfind(b"\n") + 1


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read named arrays from .npz, never unpickling. Raises DataError."""
    with reading(path, "an array archive"):
        return parse_arrays(read_bytes(path, MAX_BYTES))


def read_table(path: Path, row: type[_Model]) -> list[_Model]:
    """The rows of a Parquet table, of which only the columns that `row` has are read. Raises DataError on a file that
    is none, on an absent column and on values of another type, null or out of range."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with reading(path, "a Parquet table"):
            table = pq.ParquetFile(pa.BufferReader(read_bytes(path)), page_checksum_verification=True)
            names = set(table.schema_arrow.names)
            absent = row.model_fields.keys() - names
            if absent:
                raise DataError(f"{path} has no column {' and no column '.join(sorted(absent))}")
            if table.metadata.num_rows > _MAX_ROWS:
                raise ValueError(f"{table.metadata.num_rows} rows, expected at most {_MAX_ROWS}")
            rows = table.read(columns=list(row.model_fields), use_threads=False).to_pylist()
    except (pa.ArrowException, MemoryError, KeyError) as error:
        raise DataError(f"{path} is not a Parquet table: {one_line(error)}") from None
    checked: list[_Model] = check_as(rows, list[row], path)  # type: ignore[valid-type]
    return checked


def read_image(path: Path, mode: int) -> np.ndarray:
    """The pixels of a JPEG or PNG in one of OpenCV's reading modes (cv2.IMREAD_COLOR gives blue first). Raises
    DataError on a missing file, and on one that is damaged, cut off or too large."""
    import cv2
    from PIL import Image

    with reading(path, "a readable image"):
        content = read_bytes(path)
    try:
        with Image.open(io.BytesIO(content), formats=("PNG", "JPEG")) as picture:
            width, height = picture.size
            whole = content.rfind(_END_OF_JPEG) > content.rfind(_SCAN_OF_JPEG)
            if picture.format == "PNG":  # of what is wrong with its checksums, or its end, libpng would write to stderr
                whole = _END_OF_PNG in content
            picture.verify()
    except Exception:  # Pillow raises whatever it stumbles over
        whole, width, height = False, 0, 0
    if width * height > _MAX_PIXELS:
        raise DataError(f"{path} is {width} x {height}, expected at most {_MAX_PIXELS} pixels")
    image = cv2.imdecode(np.frombuffer(content, np.uint8), mode) if whole else None
    if image is None:
        raise DataError(f"{path} is no readable image ({len(content)} bytes), expected a JPEG or PNG that is whole")
    return image


def image_notes(path: Path) -> dict[str, Any]:
    """What is written into a PNG beside its pixels; nothing of a file that is none."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(read_bytes(path)), formats=("PNG",)) as picture:
            return {str(key): value for key, value in picture.info.items()}
    except Exception:  # Pillow raises whatever it stumbles over
        return {}


def read_network(path: Path) -> bytes:
    """The bytes of a network's file. Raises WeightsMissing where it is missing or too large."""
    try:
        return read_bytes(path, _MAX_NETWORK)
    except (OSError, ValueError) as error:
        raise WeightsMissing(f"cannot read {path}: {why(error)}") from None
