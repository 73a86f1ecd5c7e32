"""What methods can be asked to do: a task yields independent pieces, and turns what was made of them into a table."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from salframe.evaluation.runs.inputs import parts_given
from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.records import Part, Piece, PieceRowT, Record, Surveyed
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.rows import PieceRow, Row
from salframe.evaluation.runs.run_folder import ROWS, Run
from salframe.evaluation.tables.columns import SEEDS, Column
from salframe.evaluation.tables.reported import Reported
from salframe.evaluation.tables.table import Table, draw_table
from salframe.framework.validation import Settings
from salframe.panoramas.dataset import Dataset

LineT = TypeVar("LineT", bound=MethodRow)
RESULT_FORMAT = 1
"""Version of the layout of `to_json`: it changes whenever a key is renamed or has another meaning."""


class TaskOptions(Settings):
    """What a study sets of a task besides methods and data."""

    @property
    def in_data_folder(self) -> bool:
        """Whether they name files in the folder of the data."""
        return False


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


class Task(ABC, Generic[Piece, Surveyed, PieceRowT, LineT]):
    """Something that methods are measured by. An instance says what is measured, and can be pickled.

    Attributes:
        name: Name in run folders.
        version: Changes whenever the rows of the same answers do.
        role: Role of the methods.
        prefix: Start of the names of run folders that have no name of their own.
        counts: Word for its pieces.
        key_fields: Fields of a row that identify its piece.
        row: Type of the rows of rows.jsonl.
        line: Type of a method's line in the table.
        columns: Columns of the table by name.
        usual: Names of the columns that are shown by default.
        Options: Type of the options that studies set.
        counted: Files whose numbers of lines are the progress of a method.
        maps: Whether methods index the maps of the dataset's folds.
    """

    name: ClassVar[str]
    version: ClassVar[str] = "1"
    role: ClassVar[str] = "localizer"
    prefix: ClassVar[str] = ""
    counts: ClassVar[str]
    key_fields: ClassVar[tuple[str, ...]]
    row: ClassVar[type[PieceRow]]
    line: ClassVar[type[MethodRow]]
    columns: ClassVar[Mapping[str, Column[Any]]]
    usual: ClassVar[tuple[str, ...]]
    Options: ClassVar[type[TaskOptions]] = TaskOptions
    counted: ClassVar[tuple[str, ...]] = (ROWS,)
    maps: ClassVar[bool] = False

    @classmethod
    def vary(cls, options: TaskOptions) -> list[tuple[dict[str, Any], TaskOptions]]:
        """Return the options of each row of a study, with the settings that name the row; one row by default."""
        return [({}, options)]

    @classmethod
    def plan(cls, request: Request, options: TaskOptions) -> tuple[Task[Any, Any, Any, Any], Resolved]:
        """Return the task and the methods of a request. Raises SalframeError on wrong names and settings."""
        return cls(), resolve(request, cls.role)

    @classmethod
    def tables(
        cls, rows: Sequence[LineT], columns: Sequence[str] = (), leading: Mapping[str, Sequence[str]] | None = None
    ) -> list[Table]:
        """Return the tables of methods.

        Args:
            rows: A line for each method.
            columns: Names of the columns; by default the usual ones, without per-seed ranges where there are none.
            leading: Text of each row by heading, left of the columns; the method's label by default.
        """
        return [draw_table(cls.select_columns(rows, columns), rows, leading)]

    @classmethod
    def select_columns(cls, rows: Sequence[LineT], names: Sequence[str] = ()) -> list[Column[Any]]:
        """Return the columns of these names; by default the usual ones."""
        selected = [cls.columns[name] for name in names or cls.usual]
        spread = bool(names) or any(row.by_part for row in rows)
        return [column for column in selected if spread or column is not SEEDS]

    @classmethod
    def details(cls, rows: Sequence[LineT]) -> list[Table]:
        """Return more tables, which are shown on request; none by default."""
        return []

    @classmethod
    def legend(cls, rows: Sequence[LineT]) -> list[str]:
        """Return notes on the columns of a table, one line each; none by default."""
        return []

    def asks(self) -> dict[str, Any]:
        """What the task asks beyond the data set's own pieces, as JSON that `from_run` reads."""
        return {}

    def identity(self) -> dict[str, Any]:
        """What answers depend on of what the task asks: all of it, with the identities of components in it."""
        return self.asks()

    @classmethod
    @abstractmethod
    def from_run(cls, run: Run) -> Self:
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
    def summarize(self, parts: Sequence[Part[Surveyed, PieceRowT]], seed: int) -> Sequence[LineT]:
        """A line of the table for each method, in order: over one data set, or over several of one kind at once."""

    def write_page(self, result: Result[LineT], records: Sequence[Record[PieceRowT]], survey: Surveyed) -> Path | None:
        """Write the page of a run into its folder and return its path; None, the default: the task has no page."""
        return None

    def write_files(self, run: Run, survey: Surveyed, records: Sequence[Record[PieceRowT]]) -> None:
        """Write what a run folder of this task holds beside rows, metrics and page."""
        return None


AnyTask = Task[Any, Any, Any, Any]
"""A task of any pieces and rows."""


class Rows:
    """Rows of methods, and whether they came to anything."""

    rows: tuple[Any, ...]

    @property
    def measured(self) -> bool:
        """Whether some method was measured."""
        return any(row.measured for row in self.rows)

    @property
    def crashed(self) -> bool:
        """Whether some method raised or died, on a piece or altogether."""
        return any(row.crashed for row in self.rows)


@dataclass(frozen=True, eq=False)
class Result(Rows, Generic[LineT]):
    """A run and its table, a row a method.

    kind: its task; request: what was asked, as the run folder keeps it; environment: the data's fingerprint, versions,
    machine; report: the page to look at, None where the task draws none; notes: which method ran instead of another,
    what was left out, a line each; reported: what papers report beside it.
    """

    kind: type[AnyTask]
    run: Path
    request: Mapping[str, Any]
    environment: Mapping[str, Any]
    rows: tuple[LineT, ...]
    report: Path | None = None
    notes: tuple[str, ...] = ()
    reported: tuple[Reported, ...] = ()

    @property
    def task(self) -> str:
        """The name of the task."""
        return self.kind.name

    @property
    def where(self) -> str:
        """Where to look on."""
        return f"run: {self.run}" if self.report is None else f"report: {self.report}"

    def tables(self) -> list[Table]:
        """The rows as tables."""
        return self.kind.tables(self.rows)

    def row(self, method: str) -> LineT:
        """The row of a method by its label. Raises KeyError."""
        return {row.method: row for row in self.rows}[method]

    def to_json(self) -> dict[str, Any]:
        """All of it; "format" numbers the layout."""
        content: dict[str, Any] = {
            "format": RESULT_FORMAT,
            "task": self.task,
            "run": str(self.run),
            "report": None if self.report is None else str(self.report),
            "request": dict(self.request),
            "data_fingerprint": self.environment["dataset_fingerprint"],
            "versions": {name: self.environment[name] for name in ("python", "packages", "plugins")},
            "rows": [row.to_json() for row in self.rows],
            "notes": list(self.notes),
        }
        if self.reported:
            content["reported"] = [paper.model_dump(mode="json") for paper in self.reported]
        return content
