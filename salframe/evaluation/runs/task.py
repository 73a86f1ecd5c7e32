"""Base class of tasks. A task has independent pieces of work, such as queries, and computes a table from their rows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from salframe.evaluation.runs.inputs import input_parts
from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.records import Part, Piece, PieceRowT, Record, Surveyed
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.rows import PieceRow, Row
from salframe.evaluation.runs.run_folder import ROWS, Run, name_of
from salframe.evaluation.tables.columns import SEED_RANGE, Column
from salframe.evaluation.tables.reported import Reported
from salframe.evaluation.tables.table import Table, draw_table
from salframe.framework.errors import ConfigError, unknown
from salframe.framework.validation import Settings
from salframe.panoramas.dataset import Dataset

LineT = TypeVar("LineT", bound=MethodRow)
RESULT_FORMAT = 2
"""Version of the layout of `to_json`. It changes when a key is renamed or changes its meaning."""


class TaskOptions(Settings):
    """Options of a task that a study sets besides methods and data."""

    @property
    def in_data_folder(self) -> bool:
        """Whether the options name files in the folder of the data."""
        return False


class Worker(ABC, Generic[Piece]):
    """Runs a method on pieces of work (such as queries) of a task, in a worker process."""

    def prepare(self, piece: Piece) -> None:
        """Prepare what several pieces of work share, such as the map of several queries. Does nothing by default.

        The limits of a piece do not apply here. An exception ends the work of the method.
        """
        return None

    @abstractmethod
    def work(self, piece: Piece) -> Row:
        """Run the method on a piece of work, such as a query, and return its row without the key fields.

        An exception fails the piece. MethodFailed ends the work of the method.
        """

    @property
    def warning(self) -> str | None:
        """Warning to the user about the work that was done; None if there is none."""
        return None

    def close(self) -> None:
        """Release resources."""
        return None

    def __enter__(self) -> Worker[Piece]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Task(ABC, Generic[Piece, Surveyed, PieceRowT, LineT]):
    """A task by which methods are measured. An instance holds the parameters of the task, and can be pickled.

    Attributes:
        name: Name in run folders.
        version: Version of the rows. It changes when the same answers lead to different rows.
        role: Role of the methods.
        prefix: Start of the default name of run folders.
        counts: Name of the pieces of work in the plural, such as queries.
        key_fields: Fields of a row that identify its piece.
        row: Type of the rows of rows.jsonl.
        line: Type of a method's row in the table.
        columns: Columns of the table by name.
        default_columns: Names of the default columns.
        Options: Type of the options that studies set.
        counted: Files whose number of lines measures the progress of a method.
        maps: Whether methods index maps of the data set.
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
    default_columns: ClassVar[tuple[str, ...]]
    Options: ClassVar[type[TaskOptions]] = TaskOptions
    counted: ClassVar[tuple[str, ...]] = (ROWS,)
    maps: ClassVar[bool] = False

    @classmethod
    def vary(cls, options: TaskOptions) -> list[tuple[dict[str, Any], TaskOptions]]:
        """Return a pair for each row of a study (a table of methods with varied settings): the settings that name the
        row, and the options of the task for it. One row by default."""
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
            rows: A row for each method.
            columns: Names of the columns. Empty for the default columns, without per-seed ranges if there are none.
            leading: Headings of additional columns at the left, and their texts, one for each row. None: one column
                with the label of the method.
        """
        return [draw_table(cls.select_columns(rows, columns), rows, leading)]

    @classmethod
    def select_columns(cls, rows: Sequence[LineT], names: Sequence[str] = ()) -> list[Column[Any]]:
        """Return the columns of these names, or the default columns if there are no names. Raises ConfigError."""
        check_columns(names, [cls])
        selected = [cls.columns[name] for name in names or cls.default_columns]
        spread = bool(names) or any(row.by_part for row in rows)
        return [column for column in selected if spread or column is not SEED_RANGE]

    @classmethod
    def details(cls, rows: Sequence[LineT]) -> list[Table]:
        """Return further tables, which are shown on request; none by default."""
        return []

    @classmethod
    def legend(cls, rows: Sequence[LineT]) -> list[str]:
        """Return notes on the columns of a table, one line each; none by default."""
        return []

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the task as JSON. They are stored in the run folder, and `from_run` reads them."""
        return {}

    def identity(self) -> dict[str, Any]:
        """Return the parameters that answers depend on. Components are represented by their identities. The default
        implementation returns `parameters()`."""
        return self.parameters()

    @classmethod
    def from_run(cls, run: Run) -> Self:
        """Return the task of a run folder. Tasks with parameters override this method."""
        return cls()

    @abstractmethod
    def survey(self, dataset: Dataset) -> Surveyed:
        """Return the pieces of work, such as queries, of the task on an opened dataset. Raises DataError or
        InputMissing on unsuitable data."""

    @abstractmethod
    def key(self, piece: Piece) -> tuple[Any, ...]:
        """Return the key of a piece of work, such as a query: a value for each of `key_fields`."""

    def total(self, survey: Surveyed) -> int:
        """Return the number of lines of all files in `counted` when the work is complete."""
        return len(survey.pieces)

    def mode(self, label: str) -> str:
        """Return the part of a method's label that changes how the method runs. It is part of the cache key of answers.

        The default is "".
        """
        return ""

    def input(self, label: str, method: Any, dataset: Dataset) -> tuple[str, ...]:
        """Return the parts of a dataset's panoramas that a method receives as input, as `input_parts` does."""
        return input_parts(method, dataset)

    @abstractmethod
    def open(self, label: str, method: Any, survey: Surveyed, todo: Sequence[Piece], folder: Path) -> Worker[Piece]:
        """Return the worker that runs a method on the pieces of work `todo`. The worker may write further files into
        `folder`."""

    def failed(self, piece: Piece) -> Row:
        """Return additional fields for the row of a failed piece of work. The row always has the key, the status and
        the error. By default, there are no additional fields."""
        return {}

    @abstractmethod
    def summarize(self, parts: Sequence[Part[Surveyed, PieceRowT]], seed: int) -> Sequence[LineT]:
        """Return the rows of the results table, one for each method, for one dataset or pooled over several."""

    def write_page(self, result: Result[LineT], records: Sequence[Record[PieceRowT]], survey: Surveyed) -> Path | None:
        """Write the page of a run into the run folder, and return the path of the page; None: the task has no page."""
        return None

    def write_files(self, run: Run, survey: Surveyed, records: Sequence[Record[PieceRowT]]) -> None:
        """Write further files of a run folder, besides rows, metrics and page; none by default."""
        return None


AnyTask = Task[Any, Any, Any, Any]
"""A task with any types of pieces and rows."""


def check_columns(names: Sequence[str], tasks: Sequence[type[AnyTask]]) -> None:
    """Raise ConfigError if one of the names is not a column of any of the tasks."""
    columns = list(dict.fromkeys(column for task in tasks for column in task.columns))
    for name in names:
        if name not in columns:
            raise ConfigError(unknown("column", name, columns))


class ResultBase:
    """Base class of results with a row for each method: whether any method was measured or crashed."""

    rows: tuple[Any, ...]

    @property
    def measured(self) -> bool:
        """Whether at least one method was measured."""
        return any(row.measured for row in self.rows)

    @property
    def crashed(self) -> bool:
        """Whether at least one method raised an exception or died, on a piece of work (such as a query) or as a
        whole."""
        return any(row.crashed for row in self.rows)


@dataclass(frozen=True, eq=False)
class Result(ResultBase, Generic[LineT]):
    """The result of a run: a table with a row for each method.

    Attributes:
        kind: The task.
        run: The run folder.
        request: The content of the run folder's request.yaml.
        environment: Fingerprint of the data, versions and the machine.
        rows: A row for each method.
        report: Path of the report; None if the task has no report.
        notes: Notes on methods that replace others and on what was left out, one line each.
        reported: Figures that papers report, to show beside the rows.
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
        """Name of the task."""
        return self.kind.name

    @property
    def where(self) -> str:
        """Path of the report, or of the run folder if there is no report."""
        return f"run: {self.run}" if self.report is None else f"report: {self.report}"

    @property
    def caption(self) -> str:
        """The task and the data in words, such as "Localization on house-12"."""
        return f"{self.task.capitalize()} on {name_of(self.run).removeprefix(self.kind.prefix)}"

    def tables(self, columns: Sequence[str] = ()) -> list[Table]:
        """Return the rows as tables, with the columns of these names. Raises ConfigError on an unknown name."""
        return self.kind.tables(self.rows, columns)

    def _repr_html_(self) -> str:
        """Return the tables, the path of the report and the notes for notebooks."""
        from salframe.framework.markup import element, table, to_html

        tables = [
            table([heading.replace("\n", " ") for heading in shown.headings], shown.rows, shown.title)
            for shown in self.tables()
        ]
        return to_html(*tables, *(element("p", line) for line in (self.where, *self.notes)))

    def row(self, method: str) -> LineT:
        """Return the row of a method by its label. Raises KeyError."""
        return {row.method: row for row in self.rows}[method]

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON. The key "format" is the version of the layout."""
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
