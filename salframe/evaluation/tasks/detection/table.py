"""The table of the task `detection`: its rows and columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.tables.columns import INPUT, Column, cost_column, rate_column
from salframe.evaluation.tables.table import Table
from salframe.evaluation.tables.text import NONE, percent
from salframe.evaluation.tasks.detection.judging import NEAR_M

SHARES = ("precision", "recall")
"""Estimates whose values are in `overall` in the JSON of a row."""


@dataclass(frozen=True)
class Counts:
    """Numbers of annotated objects, of detections, and of correct detections.

    `precision` is relative to the detections and `recall` to the annotated objects; None if there are none.
    """

    annotated: int
    detections: int
    right: int
    precision: float | None = None
    recall: float | None = None

    @classmethod
    def of(cls, annotated: int, detected: int, right: int) -> Counts:
        """Return the counts with precision and recall."""
        precision, recall = right / detected if detected else None, right / annotated if annotated else None
        return cls(annotated, detected, right, precision, recall)


@dataclass(frozen=True, kw_only=True)
class DetectionRow(MethodRow):
    """The row of a detector in the table.

    Attributes:
        panoramas: Number of panoramas.
        overall: Counts over all classes.
        precision: Overall precision. If the places of the panoramas are known, with its 95 % confidence interval, in
            which panoramas are clustered by place.
        recall: Overall recall, with the same kind of interval as the precision.
        classes: Counts of each annotated or detected class, by common name.
        joined: Common name of each annotated or detected label that is a synonym.
        ms: Median time per panorama in milliseconds.
    """

    panoramas: int
    overall: Counts | None = None
    precision: Estimate | None = None
    recall: Estimate | None = None
    classes: dict[str, Counts] = field(default_factory=dict)
    joined: dict[str, str] = field(default_factory=dict)
    ms: float | None = None

    @classmethod
    def from_json(cls, content: Mapping[str, Any], where: object = "a row") -> Self:
        overall = content.get("overall") or {}
        return super().from_json({**content, **{name: overall.get(name) for name in SHARES}}, where)

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON. The values of precision and recall are in `overall` only."""
        return {name: value for name, value in super().to_json().items() if name not in SHARES}

    @property
    def measured(self) -> bool:
        return self.overall is not None


def _overall(row: DetectionRow, get: Callable[[Counts], int]) -> str:
    return NONE if row.overall is None else str(get(row.overall))


COLUMNS: dict[str, Column[DetectionRow]] = {
    "input": INPUT,
    "precision": rate_column("precision %\n(95 % CI)", lambda row: row.precision),
    "recall": rate_column("recall %\n(95 % CI)", lambda row: row.recall),
    "annotated": Column("annotated", lambda row: _overall(row, lambda counts: counts.annotated)),
    "detections": Column("detections", lambda row: _overall(row, lambda counts: counts.detections)),
    "right": Column("correct", lambda row: _overall(row, lambda counts: counts.right)),
    "ms": cost_column("ms", lambda row: row.ms, 0),
}
DEFAULT_COLUMNS = tuple(COLUMNS)


def class_tables(rows: Sequence[DetectionRow]) -> list[Table]:
    """Return a table for each measured detector, with a row for each class of objects."""
    return [
        Table(
            (row.title, "precision %", "recall %", "annotated", "detections", "correct"),
            [
                [
                    label,
                    percent(one.precision),
                    percent(one.recall),
                    *map(str, (one.annotated, one.detections, one.right)),
                ]
                for label, one in row.classes.items()
            ],
        )
        for row in rows
        if row.measured
    ]


def what_is_right(rows: Sequence[DetectionRow]) -> list[str]:
    """Return notes on when a detection is correct, and on the labels that are joined."""
    measured = [row for row in rows if row.measured]
    if not measured:
        return []
    joined = {label: name for row in measured for label, name in row.joined.items()}
    pairs = ", ".join(f"{label} = {name}" for label, name in sorted(joined.items()))
    return [
        f"correct: the centroid of an annotated object with the same label is at most {NEAR_M} m away",
        *([f"labels with one name in the shared vocabulary: {pairs}"] if joined else []),
    ]
