"""A task from outside the package: rows, table, JSON and its part of a page, by the one runner."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.paged_task import PagedTask
from salframe.evaluation.report.view import RunView
from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.records import Part, Record, Survey, by_method, in_common
from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.rows import PieceRow, PieceStatus, Row
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.runs.runner import conclude, run_task
from salframe.evaluation.runs.task import Result, Worker
from salframe.evaluation.statistics import Estimate, estimate_proportion
from salframe.evaluation.tables.columns import INPUT, Column, rate_column
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.opening import open_dataset


class SizeRow(PieceRow):
    """How many arrays the description of a query has."""

    query: str
    arrays: int | None = None


@dataclass(frozen=True, kw_only=True)
class SizeLine(MethodRow):
    """The share of queries whose description is small."""

    small: Estimate | None = None

    @property
    def measured(self) -> bool:
        return self.small is not None


COLUMNS: dict[str, Column[SizeLine]] = {
    "input": INPUT,
    "small": rate_column("small %\n(95 % CI)", lambda line: line.small),
}


class Describing(Worker[QueryFrame]):
    def __init__(self, localizer: Any) -> None:
        self._localizer = localizer

    def work(self, piece: QueryFrame) -> Row:
        arrays = len(self._localizer.describe(piece.load()))
        return {"arrays": arrays, "status": PieceStatus.OK, "error": None}


@dataclass(frozen=True)
class SizeTask(PagedTask[QueryFrame, Survey[QueryFrame], SizeRow, SizeLine]):
    """How small are descriptions?"""

    name = "size"
    prefix = "size-"
    counts = "queries"
    key_fields = ("query",)
    row = SizeRow
    line = SizeLine
    columns = COLUMNS
    default_columns = tuple(COLUMNS)
    about = "A description of one array is small."

    def survey(self, dataset: Dataset) -> Survey[QueryFrame]:
        return Survey(dataset, [frame for fold in dataset.folds() for frame in fold.queries])

    def key(self, piece: QueryFrame) -> tuple[str]:
        return (piece.id,)

    def open(self, label: str, method: Any, survey: Any, todo: Sequence[QueryFrame], folder: Path) -> Describing:
        return Describing(method)

    def summarize(self, parts: Sequence[Part[Survey[QueryFrame], SizeRow]], seed: int) -> list[SizeLine]:
        lines = []
        for records in by_method(parts):
            rows = [row for record in records for row in record.rows if row is not None]
            small = estimate_proportion(np.array([row.arrays == 1 for row in rows]), [row.query for row in rows])
            lines.append(SizeLine(**in_common(records), small=small))
        return lines

    def view(
        self, result: Result[SizeLine], records: Sequence[Record[SizeRow]], survey: Survey[QueryFrame]
    ) -> RunView[SizeRow, SizeLine]:
        return RunView(result, records)

    @classmethod
    def part(cls, views: Sequence[RunView[SizeRow, SizeLine]], arms: Sequence[Arm]) -> dict[str, Any]:
        traces = [
            {"arm": number, "y": [row.arrays for row in views[entry.run].records[entry.method].rows if row is not None]}
            for number, arm in enumerate(arms)
            for entry in arm.entries
        ]
        return {"figures": [{"title": "Arrays", "data": traces, "layout": {}}]}


@pytest.fixture
def result(fakes) -> Result[SizeLine]:
    request = Request(("reader",), "rooms", settings=("data.rooms=3",), engine="inline")
    return run_task(SizeTask(), request, resolve(request))


def test_it_has_rows_and_a_line(result):
    rows = Run.load(result.run).rows("reader", SizeRow)
    assert result.run.name.startswith("size-rooms-")
    assert [row.arrays for row in rows] == [1] * 6
    (line,) = result.rows
    assert (line.small.value, line.status) == (1.0, {"ok": 6})


def test_it_has_a_table_and_json(result):
    (table,) = result.tables()
    assert table.headings == ("method", "input", "small %\n(95 % CI)")
    assert table.rows[0][0] == "reader"
    assert table.rows[0][2].startswith("100.0 (")
    (row,) = result.to_json()["rows"]
    assert (row["small"], row["small_high"]) == (1.0, 1.0)
    kept: Mapping[str, Any] = json.loads((result.run / "methods" / "reader" / "metrics.json").read_text())
    assert SizeLine.from_json(kept) == result.rows[0]


def test_it_writes_its_part_of_the_page(result, read):
    content, islands = read(result.report)
    assert content["task"] == "size"
    assert content["tables"]["about"] == ["A description of one array is small."]
    assert content["figures"] == [{"title": "Arrays", "data": [{"arm": 0, "y": [1] * 6}], "layout": {}}]
    assert not islands


def test_it_is_measured_again(result):
    run = Run.load(result.run)
    again = conclude(SizeTask(), run, SizeTask().survey(open_dataset(run.data())))
    assert again.rows == result.rows
