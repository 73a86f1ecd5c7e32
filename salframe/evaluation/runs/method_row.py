"""The line of a method in the table of a task, and its JSON."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from typing import Any, Self, get_args, get_type_hints

from salframe.evaluation.runs.inputs import ESTIMATED_RANGE
from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.runs.run_folder import MethodStatus
from salframe.evaluation.statistics import Estimate
from salframe.framework.files.reading import check_as


@dataclass(frozen=True, kw_only=True)
class MethodRow(ABC):
    """A method's line in the table of a task; numbers are None where there is nothing to measure.

    given: which parts of panoramas it was given, with the errors put into them, ESTIMATED_RANGE among them where it
    was; available: whether it can run here; ended: how its work ended; reason: why it was not measured, or a warning;
    status: how often each status occurred; errors: the first message of each status that has one; by_part: its first
    figure on each data set, where it was asked on several.
    """

    method: str
    given: tuple[str, ...] = ()
    available: bool = True
    ended: MethodStatus = MethodStatus.DONE
    reason: str | None = None
    status: Mapping[str, int] = field(default_factory=dict)
    errors: Mapping[str, str] = field(default_factory=dict)
    by_part: tuple[float, ...] = ()

    @classmethod
    def from_json(cls, content: Mapping[str, Any], where: object = "a row") -> Self:
        """Return the row of its JSON. Unknown keys are ignored, and missing ones have their default: files may be of
        other versions. Raises DataError."""
        known = {field.name: content[field.name] for field in fields(cls) if field.name in content}
        for name in estimates_of(cls):
            bounds = {bound: content.get(f"{name}_{bound}") for bound in ("low", "high")}
            known[name] = None if known.get(name) is None else {"value": known[name], **bounds}
        row: Self = check_as(known, cls, where)
        return row

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON: an estimate NAME is the keys NAME, NAME_low and NAME_high."""
        content: dict[str, Any] = {}
        for name, value in asdict(self).items():
            if name in estimates_of(type(self)):
                value, low, high = (None, None, None) if value is None else value.values()
                content |= {name: value, f"{name}_low": low, f"{name}_high": high}
            else:
                content[name] = value
        return content

    @property
    @abstractmethod
    def measured(self) -> bool:
        """Whether the method has numbers."""

    @property
    def remark(self) -> str | None:
        """What must be said beside its numbers: what it was given that was not measured, and why it was not measured
        itself, or a warning."""
        marks = [f"given {', '.join(self.given).replace('rgb', 'colour')}"] if ESTIMATED_RANGE in self.given else []
        return "; ".join([*marks, *([self.reason] if self.reason else [])]) or None

    @property
    def crashed(self) -> bool:
        """Whether the method raised or died, on a piece or altogether."""
        return self.ended is MethodStatus.CRASHED or PieceStatus.CRASHED in self.status


@cache
def estimates_of(row: type[MethodRow]) -> frozenset[str]:
    """Return the names of the fields that hold an Estimate."""
    return frozenset(name for name, kind in get_type_hints(row).items() if Estimate in (kind, *get_args(kind)))
