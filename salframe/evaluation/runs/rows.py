"""Rows of a run's .jsonl files: their common fields, and how they are read and appended."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from salframe.framework.errors import InvalidAnswer
from salframe.framework.files.reading import check_as, read_lines, whole_lines_bytes
from salframe.framework.files.writing import naming
from salframe.framework.validation import MAX_INTEGER, MAX_NUMBER

Row = dict[str, Any]
"""A row as JSON."""
Count = Annotated[int, Field(ge=0, le=MAX_INTEGER, strict=True)]
Amount = Annotated[float, Field(ge=0, le=MAX_NUMBER)]


class PieceStatus(StrEnum):
    """The outcome of one piece of work, such as a query.

    OK: the work is done. INPUT_MISSING: the panorama lacks an input that the method needs. ERROR: the panorama cannot
    be read. CRASHED: the method raised an exception, or its process died.
    """

    OK = "ok"
    INPUT_MISSING = "input-missing"
    ERROR = "error"
    CRASHED = "crashed"


class Line(BaseModel):
    """Base of the rows of .jsonl files. Undeclared keys are preserved."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)


class PieceRow(Line):
    """The row of a piece of work, such as a query, of any task."""

    status: str
    error: str | None


Content = TypeVar("Content", bound=Line | Row)


class DescriptionLine(Line):
    """Time to describe a frame (to compute the features of its panorama)."""

    frame: str
    ms: Amount


class MapLine(Line):
    """Size of the map of a fold (a map and its queries): number of reference frames, and bytes."""

    fold: str
    frames: Annotated[int, Field(gt=0)]
    bytes: Count


def read_rows(path: Path, kind: type[Content]) -> Iterator[Content]:
    """Yield the rows of a .jsonl file as `kind`. A missing file has no rows.

    Text after the last newline is the rest of an interrupted write and is left out. Raises DataError.
    """
    if not path.exists():
        return
    for number, row in enumerate(read_lines(path), 1):
        yield check_as(row, kind, f"{path}, line {number} (remove this line to compute the result again)")


class RowWriter:
    """Appends rows to a .jsonl file and flushes each row. Opening the file removes an unfinished last line."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            os.truncate(path, whole_lines_bytes(path))
        self._file = path.open("a", encoding="utf-8", newline="\n")

    def append(self, row: Row) -> None:
        """Append one row. Raises InvalidAnswer on NaN, which JSON does not have."""
        try:
            text = json.dumps(row, allow_nan=False)
        except ValueError:
            raise InvalidAnswer(
                f"the method returned an answer with NaN or infinity, expected finite numbers: {str(row)[:200]}"
            ) from None
        with naming(Path(self._file.name)):
            self._file.write(text + "\n")
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> RowWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


class LineCounter:
    """Counts the lines of files. Each call of `count` reads only bytes that were appended since the previous call."""

    def __init__(self) -> None:
        self._counts: dict[Path, tuple[int, int]] = {}

    def count(self, path: Path) -> int:
        """Return the current number of lines of a file; 0 if it is missing."""
        offset, lines = self._counts.get(path, (0, 0))
        try:
            if path.stat().st_size < offset:  # the file was replaced
                offset, lines = 0, 0
            with path.open("rb") as file:
                file.seek(offset)
                added = file.read()
        except FileNotFoundError:
            return 0
        whole = added.rfind(b"\n") + 1  # an unfinished line is read again, since resuming a run cuts it off
        self._counts[path] = offset + whole, lines + added.count(b"\n")
        return self._counts[path][1]
