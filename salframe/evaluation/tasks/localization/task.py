"""The task `localization`: every query of a data set asked of every method; accuracy, pose error and cost."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.report.view import LocalizationView, Queries
from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.result import Result
from salframe.evaluation.runs.rows import AnswerRow, DescriptionLine, Line, MapLine
from salframe.evaluation.runs.run_folder import DESCRIPTIONS, MAPS, ROWS, Row, Run, read_rows
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.runs.task import (
    MethodRow,
    Part,
    Record,
    Survey,
    Task,
    Worker,
    by_method,
    check_needs,
    in_common,
)
from salframe.evaluation.statistics import (
    Judged,
    accepted_though_absent,
    average_precision,
    holm,
    judge,
    macro_averages,
    median,
    paired_test,
    pose_recalls,
    precision_at,
    proportion_interval,
    reliability,
    resampled_interval,
    roc_area,
)
from salframe.evaluation.tables.reported import read_reported
from salframe.evaluation.tasks.localization.answering import Answering, Query, answer_row
from salframe.framework.errors import DataError
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import FrameKind, Truth
from salframe.panoramas.opening import Progress


@dataclass(frozen=True, kw_only=True)
class LocalizationRow(MethodRow):
    """A method's line: shares of all queries, a failure among them; medians of pose errors over what was localized.

    accuracy with its 95 % interval, of queries clustered by place; scene_accuracy: had nobody answered with a doorway;
    macro_precision, macro_recall: means over places; room_type_accuracy: of the queries whose room type the data set
    tells, the share whose first place is of that type; recall_at_2, recall_at_5; median_translation_m,
    median_rotation_deg; median_heading_deg, of what has a heading and no pose too; recall of poses at the bounds of
    metrics.RECALLS; bytes_per_scene, of the saved maps without index by their frames; describe_ms a panorama,
    query_ms a query, medians; peak_memory_mb; p_value of the exact paired test against the first measured method,
    clustered by place; p_adjusted, as by Holm over all that are tested so.

    Where some queries are asked of a map without their place: absent_queries, how many; present_accuracy, of the
    others, and present_scene_accuracy, had nobody answered with a doorway; denied_absent, the share of them whose
    answer denies the map; precision_at, of right places among answers above a bound, at the recalls
    metrics.AT_RECALLS; average_precision, the area below precision against recall; roc_area of telling the two apart
    by the probability of being in the map, or the best score; accepted_absent, the share of them that passes the bound
    on it which 90 % of the right answers pass. calibration_error: the expected one, where the method has
    probabilities. `_low` and `_high`: 95 % intervals, of queries clustered by place.
    """

    queries: int
    absent_queries: int = 0
    present_accuracy: float | None = None
    present_accuracy_low: float | None = None
    present_accuracy_high: float | None = None
    present_scene_accuracy: float | None = None
    denied_absent: float | None = None
    denied_absent_low: float | None = None
    denied_absent_high: float | None = None
    precision_at: tuple[float | None, ...] = ()
    average_precision: float | None = None
    average_precision_low: float | None = None
    average_precision_high: float | None = None
    roc_area: float | None = None
    roc_area_low: float | None = None
    roc_area_high: float | None = None
    accepted_absent: float | None = None
    calibration_error: float | None = None
    accuracy: float | None = None
    accuracy_low: float | None = None
    accuracy_high: float | None = None
    scene_accuracy: float | None = None
    macro_precision: float | None = None
    macro_recall: float | None = None
    room_type_accuracy: float | None = None
    room_type_accuracy_low: float | None = None
    room_type_accuracy_high: float | None = None
    recall_at_2: float | None = None
    recall_at_5: float | None = None
    median_translation_m: float | None = None
    median_rotation_deg: float | None = None
    median_heading_deg: float | None = None
    recall_025m_2deg: float | None = None
    recall_05m_5deg: float | None = None
    recall_1m_10deg: float | None = None
    bytes_per_scene: float | None = None
    describe_ms: float | None = None
    query_ms: float | None = None
    peak_memory_mb: float | None = None
    p_value: float | None = None
    p_adjusted: float | None = None

    @property
    def measured(self) -> bool:
        return self.accuracy is not None


@dataclass(frozen=True, eq=False)
class LocalizationSurvey(Survey[Query]):
    """The queries of a data set."""

    def truths(self) -> tuple[Truth, ...]:
        """What is true of each query, in order. Only who measures asks."""
        return tuple(self.dataset.truth(piece.frame.id) for piece in self.pieces)

    def doorways(self) -> frozenset[str]:
        """The places of the maps that are no scene."""
        folds = {piece.fold.id: piece.fold for piece in self.pieces}.values()
        frames = [frame for fold in folds for frame in fold.mapping]
        scenes = {frame.place for frame in frames if frame.kind is FrameKind.SCENE}
        return frozenset(frame.place for frame in frames) - scenes

    def present(self) -> np.ndarray:
        """(Q,) bool: whether the map that a query is asked of has its place."""
        folds = {piece.fold.id: piece.fold for piece in self.pieces}
        places = {id: {frame.place for frame in fold.mapping} for id, fold in folds.items()}
        paired = zip(self.pieces, self.truths(), strict=True)
        return np.array([truth.place in places[piece.fold.id] for piece, truth in paired], bool)


def compare(request: Request, *, reported: bool = False, progress: Progress | None = None) -> Result[LocalizationRow]:
    """Run methods on the queries of a data set and measure them; a run that was begun is resumed.

    `reported` adds what papers report beside the rows. Raises SalframeError on names and settings that are wrong,
    before anything runs.
    """
    papers = read_reported() if reported else ()
    return run_task(LocalizationTask(), request, resolve(request), progress=progress, reported=papers)


@dataclass(frozen=True)
class LocalizationTask(Task[Query, LocalizationSurvey]):
    """Where was each query taken?"""

    name = "localization"
    counts = "queries"
    key_fields = ("fold", "query")
    row = AnswerRow
    counted = (ROWS, DESCRIPTIONS)
    maps = True

    @classmethod
    def from_run(cls, run: Run) -> LocalizationTask:
        return cls()

    def survey(self, dataset: Dataset) -> LocalizationSurvey:
        queries = [Query(fold, frame) for fold in dataset.folds() for frame in fold.queries]
        if not queries:
            raise DataError(f"{dataset.name} has no query, expected at least one")
        found = LocalizationSurvey(dataset, queries)
        absent = int((~found.present()).sum())
        note = f"{absent} of {len(queries)} queries are asked of a map without their place, where not-here is right"
        return replace(found, notes=(note,)) if absent else found

    def key(self, piece: Query) -> tuple[str, str]:
        return piece.fold.id, piece.frame.id

    def total(self, survey: LocalizationSurvey) -> int:
        folds = survey.dataset.folds()
        mapped = {frame.id for fold in folds for frame in fold.mapping}
        return len(mapped | {frame.id for fold in folds for frame in fold.queries}) + len(survey.pieces)

    def open(
        self, label: str, method: Localizer, survey: LocalizationSurvey, todo: Sequence[Query], folder: Path
    ) -> Worker[Query]:
        check_needs(method, survey.dataset)
        return Answering(method, survey.dataset, todo, folder)

    def failed(self, piece: Query) -> Row:
        return answer_row(None)

    def summarize(self, parts: Sequence[Part[LocalizationSurvey]], seed: int) -> tuple[LocalizationRow, ...]:
        queries = sum(len(survey.pieces) for survey, _ in parts)
        judged = zip(*(judge_records(*part) for part in parts), strict=True)
        lines: list[LocalizationRow] = []
        first: Judged | None = None
        for records, found_in in zip(by_method(parts), judged, strict=True):
            line = LocalizationRow(**in_common(records), queries=queries)
            if all(record.done for record in records):
                found = Judged.join(found_in)
                line = replace(line, **_reached(found), **_known_worth(found, seed), **_costs(records))
                if len(parts) > 1:
                    line = replace(line, by_part=tuple(float(part.correct.mean()) for part in found_in))
                if first is not None:
                    line = replace(line, p_value=paired_test(first.correct, found.correct, found.true_place))
                first = first or found
            lines.append(line)
        adjusted = holm([line.p_value for line in lines])
        return tuple(replace(line, p_adjusted=p) for line, p in zip(lines, adjusted, strict=True))

    def view(
        self, result: Result[LocalizationRow], records: Sequence[Record], survey: LocalizationSurvey
    ) -> LocalizationView:
        ids = [piece.frame.id for piece in survey.pieces]
        queries = Queries(ids, survey.truths(), survey.dataset.floors())
        return LocalizationView(result, records, queries, judge_records(survey, records))


def judge_records(survey: LocalizationSurvey, records: Sequence[Record]) -> list[Judged]:
    """The answers of each method against the truth."""
    known = survey.truths(), survey.present(), survey.doorways(), survey.dataset.room_types()
    return [judge(record.rows, *known) for record in records]


def _reached(found: Judged) -> dict[str, Any]:
    asked = np.flatnonzero(found.present)
    precision, recall = macro_averages([found.first_place[i] for i in asked], [found.true_place[i] for i in asked])
    typed = found.present & np.isfinite(found.right_type)
    located = found.correct & np.isfinite(found.translation_m)
    return {
        **_rate("accuracy", found.correct, found),
        "scene_accuracy": float(found.correct_scene.mean()),
        "macro_precision": precision,
        "macro_recall": recall,
        **_rate("room_type_accuracy", found.right_type, found, typed),
        "recall_at_2": float(found.in_top_2.mean()),
        "recall_at_5": float(found.in_top_5.mean()),
        "median_translation_m": median(found.translation_m[located]),
        "median_rotation_deg": median(found.rotation_deg[located]),
        "median_heading_deg": median(found.heading_deg[found.correct & np.isfinite(found.heading_deg)]),
        **pose_recalls(found),
    }


def _rate(name: str, right: np.ndarray, found: Judged, of: np.ndarray | None = None) -> dict[str, Any]:
    """The share of the queries `of` (Q,) bool, all unless given, that are right, and its interval; nothing of none."""
    chosen = np.arange(len(right)) if of is None else np.flatnonzero(of)
    if not len(chosen):
        return {}
    low, high = proportion_interval(right[chosen], [found.true_place[i] for i in chosen])
    return {name: float(right[chosen].mean()), f"{name}_low": low, f"{name}_high": high}


def _known_worth(found: Judged, seed: int) -> dict[str, Any]:
    """What answers know of their own worth: whether the query is in the map at all, and how probable they are."""
    calibration = reliability(found)
    known: dict[str, Any] = {"calibration_error": None if calibration is None else calibration.expected_error}
    absent = ~found.present
    if absent.any():
        right, present = found.present & found.best_place, int(found.present.sum())
        known |= {
            "absent_queries": int(absent.sum()),
            **_rate("present_accuracy", found.correct, found, found.present),
            "present_scene_accuracy": float(found.correct_scene[found.present].mean()) if present else None,
            **_rate("denied_absent", found.correct, found, absent),
            "precision_at": precision_at(found.evidence, right, present),
            "accepted_absent": accepted_though_absent(found.evidence[right], found.evidence[absent]),
        }
        areas = {"average_precision": _average_precision, "roc_area": _roc_area}
        for name, area in areas.items():
            if present:
                known[name] = area(found, np.arange(len(absent)))
                known[f"{name}_low"], known[f"{name}_high"] = resampled_interval(
                    partial(area, found), found.true_place, seed
                )
    return known


def _average_precision(found: Judged, chosen: np.ndarray) -> float | None:
    """Of queries (N,), given by their indices."""
    present = found.present[chosen]
    return average_precision(found.evidence[chosen], present & found.best_place[chosen], int(present.sum()))


def _roc_area(found: Judged, chosen: np.ndarray) -> float | None:
    """Of queries (N,), given by their indices."""
    present, evidence = found.present[chosen], found.evidence[chosen]
    return roc_area(evidence[present], evidence[~present])


def _costs(records: Sequence[Record]) -> dict[str, Any]:
    """What a method cost on every data set."""
    described = [row["ms"] for record in records for row in _last(record, DESCRIPTIONS, DescriptionLine, "frame")]
    maps = [row for record in records for row in _last(record, MAPS, MapLine, "fold")]
    rows = [row for record in records for row in record.rows if row is not None]
    peaks = [row["peak_memory_mb"] for row in rows if row["peak_memory_mb"] is not None]
    return {
        "bytes_per_scene": sum(row["bytes"] for row in maps) / sum(row["frames"] for row in maps) if maps else None,
        "describe_ms": median(described),
        "query_ms": median([row["query_ms"] for row in rows if row["query_ms"] is not None]),
        "peak_memory_mb": max(peaks, default=None),
    }


def _last(record: Record, file: str, kind: type[Line], key: str) -> Collection[Row]:
    """The rows of a file in a method's folder, of those with one key the last."""
    return {row[key]: row for row in read_rows(record.folder / file, kind)}.values()
