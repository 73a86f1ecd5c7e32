"""The content of a run: the pieces of work of a task on a data set, such as queries, and the rows of each method."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from salframe.evaluation.runs.rows import PieceRow, PieceStatus
from salframe.evaluation.runs.run_folder import MethodStatus, Outcome
from salframe.panoramas.dataset import Dataset

Piece = TypeVar("Piece")
Surveyed = TypeVar("Surveyed", bound="Survey[Any]")
PieceRowT = TypeVar("PieceRowT", bound=PieceRow)


@dataclass(frozen=True, eq=False)
class Survey(Generic[Piece]):
    """A task on a data set: its pieces of work, such as queries, in the order of the table, and notes on pieces that
    were left out."""

    dataset: Dataset
    pieces: Sequence[Piece]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Record(Generic[PieceRowT]):
    """A method in a run.

    Attributes:
        label: Label of the method.
        outcome: Outcome of the method.
        rows: Rows of the method in the order of the pieces; None for a piece that has no row yet.
        folder: Folder of the method.
        changes: Settings of the method that differ from its preset, "key=value" each.
        substitution: The method that it replaces, such as "for loftr"; None if it replaces no other method.
    """

    label: str
    outcome: Outcome
    rows: tuple[PieceRowT | None, ...]
    folder: Path
    changes: tuple[str, ...] = ()
    substitution: str | None = None

    @property
    def done(self) -> bool:
        """Whether the method has processed all pieces of work, such as queries, of the run."""
        return self.outcome.status is MethodStatus.DONE


Part = tuple[Surveyed, Sequence[Record[PieceRowT]]]
"""The `Survey` of a task (a data set and its pieces of work), and the record of each method, in the order of the
table."""


def by_method(parts: Sequence[Part[Any, PieceRowT]]) -> list[list[Record[PieceRowT]]]:
    """Return a list for each method, in the order of the table: its records on all data sets."""
    return [list(records) for records in zip(*(records for _, records in parts), strict=True)]


def in_common(records: Sequence[Record[Any]]) -> dict[str, Any]:
    """Return the fields that the table rows of all tasks share (those of MethodRow), as a dictionary, from the records
    of a method on one or several data sets."""
    worst = max((record.outcome for record in records), key=lambda outcome: list(MethodStatus).index(outcome.status))
    errors: dict[str, str] = {}
    statuses: list[str] = []
    for record in records:
        for row in record.rows:
            if row is not None and row.error:
                errors.setdefault(row.status, row.error)
        if record.outcome.status in (MethodStatus.DONE, MethodStatus.CRASHED):
            statuses += [PieceStatus.CRASHED if row is None else row.status for row in record.rows]
        elif record.outcome.status is MethodStatus.UNAVAILABLE:
            statuses += [row.status for row in record.rows if row is not None]
    reasons = dict.fromkeys(record.outcome.reason for record in records if record.outcome.reason)
    return {
        "method": records[0].label,
        "changes": records[0].changes,
        "substitution": records[0].substitution,
        "input": worst.input,
        "available": worst.status is not MethodStatus.UNAVAILABLE,
        "ended": worst.status,
        "reason": "; ".join(reasons) or None,
        "status": count_statuses(statuses),
        "errors": errors,
    }


def count_statuses(statuses: Iterable[str]) -> dict[str, int]:
    """Return the number of occurrences of each status: "ok" first, then by frequency."""
    counts = Counter(map(str, statuses))
    return dict(sorted(counts.items(), key=lambda entry: (entry[0] != PieceStatus.OK, -entry[1], entry[0])))
