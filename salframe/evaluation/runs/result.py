"""What came of a request: one type for every task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from salframe.evaluation.tables.reported import Reported
from salframe.evaluation.tables.table import Table, tables_of
from salframe.evaluation.runs.task import MethodRow

FORMAT = 1
"""Of `to_json`: it changes whenever a key is renamed or means something else."""

Line = TypeVar("Line", bound=MethodRow)


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
class Result(Rows, Generic[Line]):
    """A run and its table, a row a method.

    task: its name; request: what was asked, as the run folder keeps it; environment: the data's fingerprint, versions,
    machine; report: the page to look at, None where the task draws none; notes: which method ran instead of another,
    what was left out, a line each; reported: what papers report beside it.
    """

    task: str
    run: Path
    request: Mapping[str, Any]
    environment: Mapping[str, Any]
    rows: tuple[Line, ...]
    report: Path | None = None
    notes: tuple[str, ...] = ()
    reported: tuple[Reported, ...] = field(default=())

    @property
    def where(self) -> str:
        """Where to look on."""
        return f"run: {self.run}" if self.report is None else f"report: {self.report}"

    def tables(self) -> list[Table]:
        """The rows as tables."""
        return tables_of(self.task, self.rows)

    def row(self, method: str) -> Line:
        """The row of a method by its label. Raises KeyError."""
        return {row.method: row for row in self.rows}[method]

    def to_json(self) -> dict[str, Any]:
        """All of it; "format" numbers the layout."""
        content: dict[str, Any] = {
            "format": FORMAT,
            "task": self.task,
            "run": str(self.run),
            "report": None if self.report is None else str(self.report),
            "request": dict(self.request),
            "data_fingerprint": self.environment["dataset_fingerprint"],
            "versions": {name: self.environment[name] for name in ("python", "packages", "plugins")},
            "rows": [asdict(row) for row in self.rows],
            "notes": list(self.notes),
        }
        if self.reported:
            content["reported"] = [paper.model_dump(mode="json") for paper in self.reported]
        return content
