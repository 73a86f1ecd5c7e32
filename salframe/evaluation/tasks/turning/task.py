"""The task `turning`: does the turn that an answer suggests help to localize a camera?"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Survey, by_method
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.task import Task, Worker
from salframe.evaluation.tasks.turning.measures import summarize_turns
from salframe.evaluation.tasks.turning.rows import TurnRow
from salframe.evaluation.tasks.turning.table import COLUMNS, DEFAULT_COLUMNS, TurnsRow
from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, InputMissing
from salframe.framework.files.cache import Cache
from salframe.framework.files.hashes import digest
from salframe.localization.answers import Localization
from salframe.localization.described_query import DescribedView, describe_view
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.next_view import NextView
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_motion import OdometryErrors

TURNS_DEG = (30.0, -30.0, 60.0, -60.0, 90.0, -90.0, 120.0, -120.0, 150.0, -150.0, 180.0)
"""Turns in degrees, positive to the left. The random turn, a control for the suggested turn, is one of them."""


@dataclass(frozen=True, eq=False)
class NarrowQuery:
    """A query of one view, with its true place and pose T_world_pano (4, 4)."""

    frame: QueryFrame
    place: str
    T_world_pano: np.ndarray


@dataclass(frozen=True)
class TurningTask(Task[NarrowQuery, Survey[NarrowQuery], TurnRow, TurnsRow]):
    """The task `turning`: do more views, taken during a turn on the spot, help?

    A query whose answer is not accepted is localized again, together with the views of the turn that the answer
    suggests. For comparison, it is localized together with only the last of these views, and with the views of a random
    turn. In the suggested and in the random turn, successive views are at most the field of view apart.
    """

    name = "turning"
    version = "2"
    prefix = "turning-"
    counts = "queries"
    key_fields = ("query",)
    row = TurnRow
    line = TurnsRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS
    maps = True

    def survey(self, dataset: Dataset) -> Survey[NarrowQuery]:
        if type(dataset).observe is Dataset.observe:
            raise InputMissing(
                f"the task 'turning' needs panoramas at other headings, which the dataset {dataset.name} cannot "
                "render: choose another dataset, such as house-12"
            )
        queries = []
        for query in (query for fold in dataset.folds() for query in fold.queries):
            truth = dataset.truth(query.id)
            if truth.T_world_pano is None:
                raise DataError(
                    f"the true pose of the query {query.id} is missing, expected a true pose for every query"
                )
            queries.append(NarrowQuery(query, truth.place, truth.T_world_pano))
        return Survey(dataset, queries)

    def key(self, piece: NarrowQuery) -> tuple[str]:
        return (piece.frame.id,)

    def open(
        self, label: str, method: Localizer, survey: Survey[NarrowQuery], todo: Sequence[NarrowQuery], folder: Path
    ) -> Worker[NarrowQuery]:
        check_needs(method, survey.dataset)
        return _Turning(method.config, survey.dataset)

    def failed(self, piece: NarrowQuery) -> Row:
        return {"place": piece.place}

    def summarize(self, parts: Sequence[Part[Survey[NarrowQuery], TurnRow]], seed: int) -> tuple[TurnsRow, ...]:
        return tuple(summarize_turns(records) for records in by_method(parts))


class _Turning(Worker[NarrowQuery]):
    """Localizes queries, and the same camera after a turn."""

    def __init__(self, method: ComponentConfig, dataset: Dataset) -> None:
        self._method, self._dataset, self._cache = method, dataset, Cache()
        self._maps: list[LocalizationMap] = []

    def prepare(self, piece: NarrowQuery) -> None:
        if self._maps:
            return
        localizer: Localizer = registry().build(Localizer.role, self._method)
        frames, floors = reference_frames(self._dataset), self._dataset.floors()
        built = LocalizationMap.build(localizer, frames, self._cache, self._dataset.content_key, floors=floors)
        self._maps.append(built)

    def work(self, piece: NarrowQuery) -> Row:
        (map,) = self._maps
        view = describe_view(map.localizer, piece.frame, self._cache, self._dataset.content_key)
        answer = map.answer_query(map.describe_query([view]))
        row: Row = {"place": piece.place, "first": _line(answer, piece.place, 0.0), "status": PieceStatus.OK}
        if answer.accepted is not True:
            rng = np.random.default_rng(zlib.crc32(piece.frame.id.encode()))
            drawn_deg, error = float(rng.choice(TURNS_DEG)), float(rng.standard_normal())
            if (suggestion := answer.next_view) is not None:
                turns = {
                    "suggested": suggestion,
                    "last_view": NextView(suggestion.turn_deg),
                    "random": NextView(drawn_deg, suggestion.max_step_deg),
                }
                row |= {name: self._turn(map, piece, view, turn, error) for name, turn in turns.items()}
        return {**row, "error": None}

    def _turn(
        self, map: LocalizationMap, piece: NarrowQuery, first: DescribedView, turn: NextView, error: float
    ) -> Row:
        """Return the answer to the view `first` and the views of a turn, which are localized together.

        The measured angle of the turn has an error of `error` standard deviations, which grows evenly during the turn.
        Objects have the same simulated errors in all views.
        """
        views = [first, *(self._view(map, piece, angle_deg) for angle_deg in turn.views_deg)]
        drift_deg = error * OdometryErrors().heading_drift_deg
        angles_deg = np.array([0.0, *turn.views_deg]) + np.linspace(0.0, drift_deg, len(views))
        T_last_view = np.stack([pose_2d(0, 0, np.radians(angle_deg - angles_deg[-1])) for angle_deg in angles_deg])
        answer = map.answer_query(map.describe_query(views, T_last_view))
        return _line(answer, piece.place, turn.turn_deg)

    def _view(self, map: LocalizationMap, piece: NarrowQuery, angle_deg: float) -> DescribedView:
        """Return the view of the camera of a query after a turn by an angle."""

        def load() -> Panorama:
            panorama = self._dataset.observe(piece.T_world_pano @ pose_2d(0, 0, np.radians(angle_deg)))
            if panorama.annotations is None:
                return panorama
            return replace(panorama, annotations=replace(panorama.annotations, error_id=piece.frame.id))

        content = digest([self._dataset.content_key, piece.frame.id, "turned", angle_deg])
        frame = QueryFrame(f"{piece.frame.id}/{angle_deg:g}", load, content)
        return describe_view(map.localizer, frame, self._cache)


def _line(answer: Localization, place: str, turn_deg: float) -> Row:
    """Return the fields of TurnLine for an answer."""
    is_right = bool(answer.places) and answer.places[0].place == place
    return {"accepted": answer.accepted is True, "right": is_right, "turn_deg": turn_deg}
