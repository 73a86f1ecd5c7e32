"""What a run holds: the pieces of a task on a data set, and the rows of each method."""

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
    """A task on a data set: its pieces in the order of the table, and what must be said of those left out."""

    dataset: Dataset
    pieces: Sequence[Piece]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Record(Generic[PieceRowT]):
    """What a run holds of a method: how it ended, its rows in the order of the pieces (None: none yet), its folder."""

    label: str
    outcome: Outcome
    rows: tuple[PieceRowT | None, ...]
    folder: Path

    @property
    def done(self) -> bool:
        """Whether all of its work is done."""
        return self.outcome.status is MethodStatus.DONE


Part = tuple[Surveyed, Sequence[Record[PieceRowT]]]
"""A task on a data set, and what each method made of it, in the order of the table."""


def by_method(parts: Sequence[Part[Any, PieceRowT]]) -> list[list[Record[PieceRowT]]]:
    """The records of each method on every data set, in the order of the table."""
    return [list(records) for records in zip(*(records for _, records in parts), strict=True)]


def in_common(records: Sequence[Record[Any]]) -> dict[str, Any]:
    """The fields of MethodRow, of what a method made of one data set or several."""
    worst = max((record.outcome for record in records), key=lambda outcome: list(MethodStatus).index(outcome.status))
    errors: dict[str, str] = {}
    statuses: list[str] = []
    for record in records:
        for row in record.rows:
            if row is not None and row.error:
                errors.setdefault(row.status, row.error)
        if record.outcome.status in (MethodStatus.DONE, MethodStatus.CRASHED):
            statuses += [PieceStatus.CRASHED if row is None else row.status for row in record.rows]
    reasons = dict.fromkeys(record.outcome.reason for record in records if record.outcome.reason)
    return {
        "method": records[0].label,
        "given": worst.given,
        "available": worst.status is not MethodStatus.UNAVAILABLE,
        "ended": worst.status,
        "reason": "; ".join(reasons) or None,
        "status": count_statuses(statuses),
        "errors": errors,
    }


def count_statuses(statuses: Iterable[str]) -> dict[str, int]:
    """How often each status occurred, "ok" first, then by frequency."""
    counts = Counter(map(str, statuses))
    return dict(sorted(counts.items(), key=lambda entry: (entry[0] != PieceStatus.OK, -entry[1], entry[0])))
