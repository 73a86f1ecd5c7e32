"""The task `asking`: does a description in words find its room?"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Record, Survey, by_method, in_common
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.run_folder import REQUEST, Run
from salframe.evaluation.runs.task import Task, TaskOptions, Worker
from salframe.evaluation.statistics import Estimate, estimate_proportion
from salframe.evaluation.tasks.asking.describing import describe_in_words
from salframe.evaluation.tasks.asking.rows import DescriptionRow
from salframe.evaluation.tasks.asking.table import COLUMNS, DEFAULT_COLUMNS, TOP, AskingRow
from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing
from salframe.framework.files.cache import Cache
from salframe.framework.validation import Settings, validate
from salframe.graphs.annotated import annotated_detections
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.text_places import MapWords
from salframe.localization.text_query import read_text
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.opening import reference_frames

NumLabels = Annotated[int, Field(ge=1, le=20)]
"""Number of labels of a description."""


class AskingOptions(TaskOptions):
    """Options of a study that finds rooms by descriptions in words."""

    labels: tuple[NumLabels, ...] = Field(
        (3,),
        min_length=1,
        description="list of numbers of object labels in a description; each number is a row of the table",
    )
    wrong_share: float = Field(
        0.1, ge=0, le=1, description="probability (0 to 1) that a label is replaced by a random label"
    )


class _SavedAsking(Settings):
    """The parameters of the task in a run folder. The runner adds other keys."""

    model_config = ConfigDict(extra="ignore")
    options: AskingOptions


@dataclass(frozen=True, eq=False)
class DescribedRoom:
    """A query whose objects are described in words, with its true place."""

    frame: QueryFrame
    place: str


@dataclass(frozen=True)
class AskingTask(Task[DescribedRoom, Survey[DescribedRoom], DescriptionRow, AskingRow]):
    """The task `asking`. A description names random objects that the annotations of a query show."""

    options: AskingOptions

    name = "asking"
    prefix = "asking-"
    counts = "descriptions"
    key_fields = ("query",)
    row = DescriptionRow
    line = AskingRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS
    Options = AskingOptions
    maps = True

    @classmethod
    def vary(cls, options: TaskOptions) -> list[tuple[dict[str, Any], TaskOptions]]:
        options = _checked(options)
        return [({"labels": count}, options.model_copy(update={"labels": (count,)})) for count in options.labels]

    @classmethod
    def plan(cls, request: Request, options: TaskOptions) -> tuple[AskingTask, Resolved]:
        return cls(_checked(options)), resolve(request, cls.role)

    def parameters(self) -> dict[str, Any]:
        return {"options": self.options.model_dump(mode="json")}

    @classmethod
    def from_run(cls, run: Run) -> AskingTask:
        saved: _SavedAsking = validate(_SavedAsking, run.task, f"{run.directory / REQUEST}: task")
        return cls(saved.options)

    def survey(self, dataset: Dataset) -> Survey[DescribedRoom]:
        if "annotations" not in dataset.provides:
            raise InputMissing(
                f"the task 'asking' needs annotations, which the dataset {dataset.name} does not have: choose another "
                "dataset"
            )
        queries = [query for fold in dataset.folds() for query in fold.queries]
        return Survey(dataset, [DescribedRoom(query, dataset.truth(query.id).place) for query in queries])

    def key(self, piece: DescribedRoom) -> tuple[str]:
        return (piece.frame.id,)

    def open(
        self, label: str, method: Localizer, survey: Survey[DescribedRoom], todo: Sequence[DescribedRoom], folder: Path
    ) -> Worker[DescribedRoom]:
        check_needs(method, survey.dataset)
        return _Asking(method.config, survey.dataset, self.options.labels[0], self.options.wrong_share)

    def failed(self, piece: DescribedRoom) -> Row:
        return {"place": piece.place}

    def summarize(
        self, parts: Sequence[Part[Survey[DescribedRoom], DescriptionRow]], seed: int
    ) -> tuple[AskingRow, ...]:
        return tuple(_summarize(records) for records in by_method(parts))


class _Asking(Worker[DescribedRoom]):
    """Describes rooms in words, and searches the map for each description."""

    def __init__(self, method: ComponentConfig, dataset: Dataset, num_labels: int, wrong_share: float) -> None:
        self._method, self._dataset = method, dataset
        self._num_labels, self._wrong_share = num_labels, wrong_share
        self._words: list[MapWords] = []

    def prepare(self, piece: DescribedRoom) -> None:
        if not self._words:
            localizer: Localizer = registry().build(Localizer.role, self._method)
            frames, content = reference_frames(self._dataset), self._dataset.content_key
            self._words.append(MapWords(LocalizationMap.build(localizer, frames, Cache(), content, calibrate=False)))

    def work(self, piece: DescribedRoom) -> Row:
        (words,) = self._words
        row: Row = {"place": piece.place, "status": PieceStatus.OK, "error": None}
        rng = np.random.default_rng(zlib.crc32(f"{piece.frame.id}/{self._num_labels}".encode()))
        objects = annotated_detections(piece.frame.load())
        text = describe_in_words(objects, words.labels, self._num_labels, self._wrong_share, rng)
        if text is None:
            return row
        query = read_text(text, words.labels)
        unordered = replace(query, relations=())
        plain = replace(unordered, mentions=tuple(replace(mention, count=None) for mention in query.mentions))
        answers = [words.answer(one) for one in (query, unordered, plain)]
        ranks = [1 + [place.place for place in answer.places].index(piece.place) for answer in answers]
        row |= dict(zip(("rank", "rank_counts", "rank_labels"), ranks, strict=True))
        return {**row, "text": text, "places": len(words.places), "probability": answers[0].places[0].probability}


def _summarize(records: Sequence[Record[DescriptionRow]]) -> AskingRow:
    """Return the row of a method, over one data set or several."""
    rows = [(f"{part}/{row.place}", row) for part, record in enumerate(records) for row in record.rows if row]
    described = [(cluster, row) for cluster, row in rows if row.text is not None or row.error is not None]
    line = AskingRow(**in_common(records), descriptions=len(described))
    answered = [row for _, row in described if row.text is not None]
    if not answered or not all(record.done for record in records):
        return line
    clusters = [cluster for cluster, _ in described]

    def share(ranks: Sequence[int | None], top: int) -> Estimate:
        return estimate_proportion(np.array([rank is not None and rank <= top for rank in ranks]), clusters)

    whole, counts, labels = zip(*((row.rank, row.rank_counts, row.rank_labels) for _, row in described), strict=True)
    places = np.array([row.places or 1 for row in answered])
    return replace(
        line,
        top1=share(whole, 1),
        top5=share(whole, TOP),
        top1_counts=share(counts, 1),
        top5_counts=share(counts, TOP),
        top1_labels=share(labels, 1),
        top5_labels=share(labels, TOP),
        chance1=float((1 / places).mean()),
        chance5=float((np.minimum(TOP, places) / places).mean()),
        probability=float(np.mean([row.probability for row in answered])),
    )


def _checked(options: TaskOptions) -> AskingOptions:
    """Return the options. Raises TypeError if they are options of another task."""
    if not isinstance(options, AskingOptions):
        raise TypeError(f"the argument options has the type {type(options).__name__}, expected AskingOptions")
    return options
