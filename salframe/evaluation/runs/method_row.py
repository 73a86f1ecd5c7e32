"""The row of a method in the table of a task, and its JSON."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from typing import Any, Self, get_args, get_type_hints

from salframe.evaluation.runs.changes import with_changes
from salframe.evaluation.runs.inputs import ESTIMATED_RANGE
from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.runs.run_folder import MethodStatus
from salframe.evaluation.statistics import Estimate
from salframe.framework.files.reading import check_as


@dataclass(frozen=True, kw_only=True)
class MethodRow(ABC):
    """The row of a method in the table of a task. Numbers are None if there is nothing to measure.

    Attributes:
        method: Label of the method.
        changes: Settings of the method that differ from the preset or component of its name, "key=value" each.
        substitution: The requested method that this method replaces, because it cannot run on this machine, such as
            "for loftr".
        input: Parts of panoramas that the method received, with the noise added to them. Includes ESTIMATED_RANGE if
            the method estimated the range.
        available: Whether the method can run on this machine and on the data.
        ended: How the work of the method ended.
        reason: Why the method was not measured, or a warning.
        status: Number of pieces of work, such as queries, with each status.
        errors: First message of each status that has a message.
        by_part: The main measure of the row (such as the accuracy) on each data set alone. Empty for a single data set.
    """

    method: str
    changes: tuple[str, ...] = ()
    substitution: str | None = None
    input: tuple[str, ...] = ()
    available: bool = True
    ended: MethodStatus = MethodStatus.DONE
    reason: str | None = None
    status: Mapping[str, int] = field(default_factory=dict)
    errors: Mapping[str, str] = field(default_factory=dict)
    by_part: tuple[float, ...] = ()

    @classmethod
    def from_json(cls, content: Mapping[str, Any], where: object = "a row") -> Self:
        """Return the row from its JSON. Raises DataError.

        Unknown keys are ignored and missing keys take their default, since another version may have written the row.
        """
        values = {field.name: content[field.name] for field in fields(cls) if field.name in content}
        for name in estimates_of(cls):
            bounds = {bound: content.get(f"{name}_{bound}") for bound in ("low", "high")}
            values[name] = None if values.get(name) is None else {"value": values[name], **bounds}
        row: Self = check_as(values, cls, where)
        return row

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON. An estimate NAME has the keys NAME, NAME_low and NAME_high."""
        content: dict[str, Any] = {}
        for name, value in asdict(self).items():
            if name in estimates_of(type(self)):
                value, low, high = (None, None, None) if value is None else value.values()
                content |= {name: value, f"{name}_low": low, f"{name}_high": high}
            else:
                content[name] = value
        return content

    @property
    def settings(self) -> Mapping[str, str]:
        """The settings that distinguish the row from other rows of the same method; empty by default."""
        return {}

    @property
    @abstractmethod
    def measured(self) -> bool:
        """Whether the method was measured, so that the row has numbers."""

    @property
    def title(self) -> str:
        """The label of the method with the settings that differ from its preset and the method that it replaces, for
        tables."""
        return with_changes(self.method, self.changes, self.substitution)

    @property
    def remark(self) -> str | None:
        """Note beside the numbers; None if there is nothing to note.

        It states the input if the range was estimated, followed by `reason`.
        """
        marks = [f"input {', '.join(self.input).replace('rgb', 'colour')}"] if ESTIMATED_RANGE in self.input else []
        return "; ".join([*marks, *([self.reason] if self.reason else [])]) or None

    @property
    def crashed(self) -> bool:
        """Whether an exception or the death of a process ended one piece of the method's work, or all of it."""
        return self.ended is MethodStatus.CRASHED or PieceStatus.CRASHED in self.status


@cache
def estimates_of(row: type[MethodRow]) -> frozenset[str]:
    """Return the names of the fields that hold an Estimate."""
    return frozenset(name for name, kind in get_type_hints(row).items() if Estimate in (kind, *get_args(kind)))
