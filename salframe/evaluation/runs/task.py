"""What methods can be asked to do: a task yields independent pieces, and turns what was made of them into a table."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from salframe.evaluation.runs.rows import PieceRow
from salframe.evaluation.runs.run_folder import ROWS, MethodStatus, Outcome, PieceStatus, Row, Run
from salframe.framework.auto import needs_of, why_unfit
from salframe.framework.component import Component
from salframe.framework.config import components_in
from salframe.framework.errors import InputMissing
from salframe.framework.registry import registry
from salframe.graphs.detector import Detector
from salframe.localization.describing import estimates_range, required_parts
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.range_model import RangeModel

Piece = TypeVar("Piece")
Surveyed = TypeVar("Surveyed", bound="Survey[Any]")

ORDER = ("annotations", "rgb", "range")
"""In which the parts of panoramas are named."""
ESTIMATED_RANGE = "estimated range"
"""What a method is given whose range model estimates the range that a data set lacks."""


@dataclass(frozen=True, eq=False)
class Survey(Generic[Piece]):
    """A task on a data set: its pieces in the order of the table, and what must be said of those left out."""

    dataset: Dataset
    pieces: Sequence[Piece]
    notes: tuple[str, ...] = ()


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


@dataclass(frozen=True, eq=False)
class Record:
    """What a run holds of a method: how it ended, its rows in the order of the pieces (None: none yet), its folder."""

    label: str
    outcome: Outcome
    rows: tuple[Row | None, ...]
    folder: Path

    @property
    def done(self) -> bool:
        """Whether all of its work is done."""
        return self.outcome.status is MethodStatus.DONE


Part = tuple[Surveyed, Sequence[Record]]
"""A task on a data set, and what each method made of it, in the order of the table."""


def by_method(parts: Sequence[Part[Any]]) -> list[list[Record]]:
    """The records of each method on every data set, in the order of the table."""
    return [list(records) for records in zip(*(records for _, records in parts), strict=True)]


def in_common(records: Sequence[Record]) -> dict[str, Any]:
    """The fields of MethodRow, of what a method made of one data set or several."""
    worst = max((record.outcome for record in records), key=lambda outcome: list(MethodStatus).index(outcome.status))
    errors: dict[str, str] = {}
    statuses: list[str] = []
    for record in records:
        for row in record.rows:
            if row is not None and row.get("error"):
                errors.setdefault(row["status"], row["error"])
        if record.outcome.status in (MethodStatus.DONE, MethodStatus.CRASHED):
            statuses += [PieceStatus.CRASHED if row is None else row["status"] for row in record.rows]
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


class Worker(ABC, Generic[Piece]):
    """A method at work on pieces of a task, in a process of its own."""

    def prepare(self, piece: Piece) -> None:
        """Do what a piece needs and others share, a map: it counts in no limit of the piece. Nothing unless overridden.
        Whatever it raises costs the method its row."""
        return None

    @abstractmethod
    def work(self, piece: Piece) -> Row:
        """What the method makes of a piece, without what it is known by. Whatever it raises costs the piece, and
        MethodFailed the method its row.
        """

    @property
    def warning(self) -> str | None:
        """What the user must know of the work done, None where there is nothing."""
        return None

    def close(self) -> None:
        """Release what is held."""
        return None

    def __enter__(self) -> Worker[Piece]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Task(ABC, Generic[Piece, Surveyed]):
    """Something that methods are measured by. An instance says what is asked, and can be pickled.

    `name` is known in run folders; `version` changes whenever rows of the same answers do; `role`: what its methods
    are; `prefix`: of run folders without a name of their own; `counts`: what its pieces are called; `key_fields`: what
    a piece is known by in rows; `row`: what must stand in one; `counted`: files whose lines tell how far a method is.
    """

    name: ClassVar[str]
    version: ClassVar[str] = "1"
    role: ClassVar[str] = "localizer"
    prefix: ClassVar[str] = ""
    row: ClassVar[type[PieceRow]] = PieceRow
    counts: ClassVar[str]
    key_fields: ClassVar[tuple[str, ...]]
    counted: ClassVar[tuple[str, ...]] = (ROWS,)
    maps: ClassVar[bool] = False

    def asks(self) -> dict[str, Any]:
        """What the task asks beyond the data set's own pieces, as JSON that `from_run` reads."""
        return {}

    def identity(self) -> dict[str, Any]:
        """What answers depend on of what the task asks: all of it, with the identities of components in it."""
        return self.asks()

    @classmethod
    @abstractmethod
    def from_run(cls, run: Run) -> Task[Piece, Surveyed]:
        """The task of a run folder."""

    @abstractmethod
    def survey(self, dataset: Dataset) -> Surveyed:
        """The task on an opened data set. Raises DataError or InputMissing where that is none to ask."""

    @abstractmethod
    def key(self, piece: Piece) -> tuple[Any, ...]:
        """What a piece is known by, a value for each of `key_fields`."""

    def total(self, survey: Surveyed) -> int:
        """How many lines the files `counted` have in the end."""
        return len(survey.pieces)

    def mode(self, label: str) -> str:
        """What in a method's label changes how it is asked: part of its identity; none of it unless overridden."""
        return ""

    def given(self, label: str, method: Any, dataset: Dataset) -> tuple[str, ...]:
        """Which parts of a data set's panoramas a built method is given: see `parts_given`."""
        return parts_given(method, dataset)

    @abstractmethod
    def open(self, label: str, method: Any, survey: Surveyed, todo: Sequence[Piece], folder: Path) -> Worker[Piece]:
        """A built method at work on the pieces `todo`; `folder`: where it may keep more than rows."""

    def failed(self, piece: Piece) -> Row:
        """The fields of a row, besides status and error, where a piece came to nothing."""
        return {}

    @abstractmethod
    def summarize(self, parts: Sequence[Part[Surveyed]], seed: int) -> Sequence[MethodRow]:
        """A line of the table for each method, in order: over one data set, or over several of one kind at once."""

    def view(self, result: Any, records: Sequence[Record], survey: Surveyed) -> Any:
        """What a page shows of a Result, a RunView; None where the task has no page."""
        return None

    def write_files(self, run: Run, survey: Surveyed, records: Sequence[Record]) -> None:
        """Write what a run folder of this task holds beside rows, metrics and page."""
        return None


def count_statuses(statuses: Iterable[str]) -> dict[str, int]:
    """How often each status occurred, "ok" first, then by frequency."""
    counts = Counter(map(str, statuses))
    return dict(sorted(counts.items(), key=lambda entry: (entry[0] != PieceStatus.OK, -entry[1], entry[0])))


def parts_needed(method: Any, dataset: Dataset) -> frozenset[str]:
    """What a method, a localizer or another component with `needs`, needs of the panoramas of a data set."""
    return required_parts(method, dataset.provides) if isinstance(method, Localizer) else method.needs


def parts_given(method: Component, dataset: Dataset) -> tuple[str, ...]:
    """Which parts of a data set's panoramas a method is given: what it needs or uses, with the errors that a detector
    puts into it, and range where it is estimated."""
    used = method.uses & dataset.provides if isinstance(method, Localizer) else frozenset[str]()
    parts = sorted(parts_needed(method, dataset) | used, key=ORDER.index)
    for _, inner in components_in(method.config):
        if issubclass(inner.component, Detector):
            noise = inner.component.noise_in(inner, dataset.rendered)
            parts = [f"{part} + {noise} noise" if noise and part in inner.component.needs else part for part in parts]
    estimates = isinstance(method, Localizer) and estimates_range(method, dataset.provides)
    return (*parts, *([ESTIMATED_RANGE] if estimates else []))


def check_needs(method: Component, dataset: Dataset) -> None:
    """Raises InputMissing where a data set lacks what a method needs: whose need it is, and what would do without."""
    absent = parts_needed(method, dataset) - dataset.provides
    if not absent:
        return
    words = " and ".join(sorted(absent))
    models = registry().names(RangeModel.role) if getattr(method.config, "range", method) is None else []
    estimate = " or ".join(f"--set range.kind={name}" for name in models) if absent == {"range"} else ""
    for slot, inner in components_in(method.config):
        role = inner.component.role
        if absent & needs_of(inner):
            able = [n for n in registry().names(role) if why_unfit(registry().get(role, n), dataset.provides) is None]
            hint = " or ".join(f"--set {slot}.kind={name}" for name in able)
            advice = f"what can do without: {hint}" if able else f"no {role} at hand can do without"
            advice += f"; what can estimate it: {estimate}" if estimate else ""
            raise InputMissing(f"its {role} {inner.kind!r} needs {words}, which {dataset.name} does not have; {advice}")
    raise InputMissing(f"needs {words}, which {dataset.name} does not have")
