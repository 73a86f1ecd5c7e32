"""The task `localization`: accuracy, pose error and cost of methods over all queries of a dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.paged_task import Islands, PagedTask
from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Record
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.rows import Row
from salframe.evaluation.runs.run_folder import DESCRIPTIONS, REQUEST, ROWS, Run
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.runs.task import Result, TaskOptions, Worker
from salframe.evaluation.tables.reported import read_reported
from salframe.evaluation.tables.table import Table
from salframe.evaluation.tasks.localization.answering import Answering, answer_row
from salframe.evaluation.tasks.localization.measures import judge_records, summarize_methods
from salframe.evaluation.tasks.localization.page import make_islands_of_views, make_part, write_accuracy
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.survey import LocalizationSurvey, Query
from salframe.evaluation.tasks.localization.table import (
    ABOUT,
    COLUMNS,
    DEFAULT_COLUMNS,
    LocalizationRow,
    describe_times_note,
    out_of_map_tables,
)
from salframe.evaluation.tasks.localization.view import LocalizationView, Queries
from salframe.evaluation.true_places import places_notes
from salframe.framework.errors import DataError
from salframe.framework.files.reading import check_as
from salframe.localization.fusing import Fusion
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import Progress


def compare(request: Request, *, reported: bool = False, progress: Progress | None = None) -> Result[LocalizationRow]:
    """Run methods on the queries of a dataset and measure them. An interrupted run is resumed.

    Args:
        request: The request.
        reported: Whether to add figures that papers report to the result.
        progress: Reports the progress.

    Raises:
        SalframeError: A name or a setting is wrong. No method has run.
    """
    papers = read_reported() if reported else ()
    return run_task(LocalizationTask(), request, resolve(request), progress=progress, reported=papers)


class LocalizationOptions(TaskOptions):
    """Options of a localization study."""

    views: tuple[Fusion, ...] = Field(
        (),
        description="list of ways to compute one answer from several views of a query. joined: the objects of all "
        "views are joined; product: the probabilities of the answers to the single views are multiplied; surest: the "
        "most probable answer to a single view. Each entry is a row of the table",
    )


@dataclass(frozen=True)
class LocalizationTask(PagedTask[Query, LocalizationSurvey, AnswerRow, LocalizationRow]):
    """The task `localization`: in which place and at which pose was each query taken?"""

    name = "localization"
    counts = "queries"
    key_fields = ("fold", "query")
    row = AnswerRow
    line = LocalizationRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS
    about = ABOUT
    counted = (ROWS, DESCRIPTIONS)
    maps = True
    Options = LocalizationOptions
    fusion: Fusion = Fusion.JOINED

    @classmethod
    def vary(cls, options: TaskOptions) -> list[tuple[dict[str, Any], TaskOptions]]:
        fusions = options.views if isinstance(options, LocalizationOptions) else ()
        return [({"views": fusion}, LocalizationOptions(views=(fusion,))) for fusion in fusions] or [({}, options)]

    @classmethod
    def plan(cls, request: Request, options: TaskOptions) -> tuple[LocalizationTask, Resolved]:
        fusions = options.views if isinstance(options, LocalizationOptions) else ()
        return cls(*fusions), resolve(request, cls.role)

    def parameters(self) -> dict[str, Any]:
        return {} if self.fusion is Fusion.JOINED else {"views": self.fusion.value}

    @classmethod
    def from_run(cls, run: Run) -> LocalizationTask:
        return cls(check_as(run.task.get("views", Fusion.JOINED), Fusion, f"{run.directory / REQUEST}: task.views"))

    def survey(self, dataset: Dataset) -> LocalizationSurvey:
        queries = [Query(fold, frame) for fold in dataset.folds() for frame in fold.queries]
        if not queries:
            raise DataError(f"the dataset {dataset.name} has no query (panorama to localize), expected at least one")
        survey = LocalizationSurvey(dataset, queries)
        absent = int((~survey.present()).sum())
        note = f"the place of {absent} of {len(queries)} queries is not in the map, so the correct answer is out-of-map"
        return replace(survey, notes=(note, *places_notes(dataset))) if absent else survey

    def key(self, piece: Query) -> tuple[str, str]:
        return piece.fold.id, piece.frame.id

    def total(self, survey: LocalizationSurvey) -> int:
        folds = survey.dataset.folds()
        mapped = {frame.id for fold in folds for frame in fold.references}
        views = {view.id for fold in folds for query in fold.queries for view in query.views}
        return len(mapped | views) + len(survey.pieces)

    def input(self, label: str, method: Any, dataset: Dataset) -> tuple[str, ...]:
        counts = sorted({len(query.views) for fold in dataset.folds() for query in fold.queries})
        parts = super().input(label, method, dataset)
        if counts[-1:] in ([], [1]):
            return parts
        joins = self.fusion is Fusion.JOINED and type(method).join is not Localizer.join
        number = f"{counts[-1]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
        return (*parts, f"{number} views {'joined' if joins else 'fused'}")

    def open(
        self, label: str, method: Localizer, survey: LocalizationSurvey, todo: Sequence[Query], folder: Path
    ) -> Worker[Query]:
        check_needs(method, survey.dataset)
        return Answering(method, survey.dataset, todo, folder, self.fusion)

    def failed(self, piece: Query) -> Row:
        return answer_row(None)

    def summarize(self, parts: Sequence[Part[LocalizationSurvey, AnswerRow]], seed: int) -> tuple[LocalizationRow, ...]:
        return summarize_methods(parts, seed)

    @classmethod
    def tables(
        cls,
        rows: Sequence[LocalizationRow],
        columns: Sequence[str] = (),
        leading: Mapping[str, Sequence[str]] | None = None,
    ) -> list[Table]:
        return [*super().tables(rows, columns, leading), *([] if columns else out_of_map_tables(rows, leading))]

    @classmethod
    def legend(cls, rows: Sequence[LocalizationRow]) -> list[str]:
        return describe_times_note(rows)

    def view(
        self, result: Result[LocalizationRow], records: Sequence[Record[AnswerRow]], survey: LocalizationSurvey
    ) -> LocalizationView:
        ids = [piece.frame.id for piece in survey.pieces]
        queries = Queries(ids, survey.truths(), survey.dataset.floors())
        return LocalizationView(result, records, survey, queries, judge_records(survey, records))

    @classmethod
    def part(cls, views: Sequence[LocalizationView], arms: Sequence[Arm]) -> dict[str, Any]:
        return make_part(views, arms)

    @classmethod
    def islands(
        cls, views: Sequence[LocalizationView], arms: Sequence[Arm], full: bool, progress: Progress | None = None
    ) -> Islands:
        return make_islands_of_views(views, arms, full, progress)

    def write_page(
        self, result: Result[LocalizationRow], records: Sequence[Record[AnswerRow]], survey: LocalizationSurvey
    ) -> Path:
        path = super().write_page(result, records, survey)
        write_accuracy(path.parent, result.rows)
        return path
