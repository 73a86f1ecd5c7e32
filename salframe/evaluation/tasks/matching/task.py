"""The task `matching`: the accuracy of the points or objects that a method matches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Survey, by_method
from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.runs.task import Result, Task, Worker
from salframe.evaluation.tables.table import Table
from salframe.evaluation.tasks.matching.judging import check_matches
from salframe.evaluation.tasks.matching.measures import summarize_pairs
from salframe.evaluation.tasks.matching.rows import PairRow
from salframe.evaluation.tasks.matching.table import COLUMNS, DEFAULT_COLUMNS, MatchingRow, tables_by_kind
from salframe.evaluation.true_places import places_notes
from salframe.framework.errors import DataError, InputMissing, InvalidAnswer, MethodUnavailable
from salframe.framework.files.cache import Cache
from salframe.localization.answers import NodeMatches, PointMatches
from salframe.localization.describing import describe_frame
from salframe.localization.level_frames import correspond
from salframe.localization.localizer import Localizer
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import invert_pose
from salframe.panoramas.opening import Progress


@dataclass(frozen=True, eq=False)
class FramePair:
    """A query of a fold (a map and its queries), a reference frame of the same place in the map, and the true pose
    T_reference_query (4, 4) of the query in the axes of the reference frame.
    """

    fold: str
    query: QueryFrame
    reference: ReferenceFrame
    T_reference_query: np.ndarray


def measure_matching(request: Request, *, progress: Progress | None = None) -> Result[MatchingRow]:
    """Match each query with the nearest scene frame (reference frame in a room) of its place, and count the correct
    matches. An interrupted run is resumed.

    Raises:
        SalframeError: A name or a setting is wrong, or the dataset has no ranges or poses.
    """
    return run_task(MatchingTask(), request, resolve(request), progress=progress)


@dataclass(frozen=True)
class MatchingTask(Task[FramePair, Survey[FramePair], PairRow, MatchingRow]):
    """The task `matching`: which points or objects are the same in a query and in the nearest frame of its place?"""

    name = "matching"
    prefix = "matching-"
    counts = "pairs"
    key_fields = ("fold", "query")
    row = PairRow
    line = MatchingRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS

    def survey(self, dataset: Dataset) -> Survey[FramePair]:
        if "range" not in dataset.provides:
            raise InputMissing(
                f"the task 'matching' needs range images, which the dataset {dataset.name} does not have: choose "
                "another dataset"
            )
        pairs = choose_pairs(dataset)
        total = sum(len(fold.queries) for fold in dataset.folds())
        left_out = total - len(pairs)
        note = (
            f"{left_out} of {total} queries are left out: the map has no panorama of the kind `scene` (in a room) of "
            "their place"
        )
        return Survey(dataset, pairs, (note, *places_notes(dataset)) if left_out else ())

    def key(self, piece: FramePair) -> tuple[str, str]:
        return piece.fold, piece.query.id

    def open(
        self, label: str, method: Localizer, survey: Survey[FramePair], todo: Sequence[FramePair], folder: Path
    ) -> Worker[FramePair]:
        check_needs(method, survey.dataset)
        return _Matching(method, survey.dataset.content_key)

    def summarize(self, parts: Sequence[Part[Survey[FramePair], PairRow]], seed: int) -> tuple[MatchingRow, ...]:
        places = [f"{part}: {pair.reference.place}" for part, (survey, _) in enumerate(parts) for pair in survey.pieces]
        return tuple(summarize_pairs(records, places, seed) for records in by_method(parts))

    @classmethod
    def tables(
        cls,
        rows: Sequence[MatchingRow],
        columns: Sequence[str] = (),
        leading: Mapping[str, Sequence[str]] | None = None,
    ) -> list[Table]:
        return super().tables(rows, columns, leading) if columns else tables_by_kind(rows, leading)


class _Matching(Worker[FramePair]):
    """Runs a localizer on pairs of panoramas."""

    def __init__(self, localizer: Localizer, dataset: str) -> None:
        self._localizer, self._dataset, self._cache = localizer, dataset, Cache()
        self._kind: type[PointMatches | NodeMatches] | None = None

    def work(self, piece: FramePair) -> Row:
        query, reference = (
            describe_frame(self._localizer, frame, self._cache, self._dataset)[0]
            for frame in (piece.query, piece.reference)
        )
        matches = correspond(self._localizer, query, reference)
        if matches is None:
            raise MethodUnavailable(
                "the method does not return matches of points or objects, which the task 'matching' measures: choose "
                "another method, such as 'proposed'"
            )
        if not isinstance(matches, PointMatches | NodeMatches):
            raise InvalidAnswer(
                f"the function `correspond` of the method returned {type(matches).__name__}, expected PointMatches, "
                "NodeMatches or None"
            )
        if self._kind not in (None, type(matches)):
            raise InvalidAnswer(
                f"the function `correspond` of the method returned {type(matches).__name__}, but {self._kind.__name__} "
                "for earlier pairs of panoramas, expected the same type for all pairs"
            )
        self._kind = type(matches)
        row = check_matches(matches, piece.query.load(), piece.reference.load(), piece.T_reference_query)
        return {"reference": piece.reference.id, **row, "status": PieceStatus.OK, "error": None}


def choose_pairs(dataset: Dataset) -> list[FramePair]:
    """Return each query with the nearest scene frame (reference frame in a room) of its place.

    Raises DataError if there is no such pair, or the true pose of a query is unknown.
    """
    pairs = []
    for fold in dataset.folds():
        scenes: dict[str, list[ReferenceFrame]] = {}
        for frame in fold.references:
            if frame.kind is FrameKind.SCENE:
                scenes.setdefault(frame.place, []).append(frame)
        for query in fold.queries:
            truth = dataset.truth(query.id)
            if truth.T_world_pano is None:
                raise DataError(
                    f"the true pose of the query {query.id} is missing, expected a true pose for every query"
                )
            if truth.place in scenes:
                at_m, near = truth.T_world_pano[:3, 3], scenes[truth.place]
                distances_m = [float(np.linalg.norm(frame.T_world_pano[:3, 3] - at_m)) for frame in near]
                reference = near[int(np.argmin(distances_m))]
                T_reference_query = invert_pose(reference.T_world_pano) @ truth.T_world_pano
                pairs.append(FramePair(fold.id, query, reference, T_reference_query))
    if not pairs:
        reason = (
            f"the dataset {dataset.name} has no query in a place with a panorama of the map that has the kind "
            "scene (in a room), expected at least one"
        )
        raise DataError("; ".join([reason, *places_notes(dataset)]))
    return pairs
