"""The task `sensor`: calibration of a sensor model of detectors against the annotations of data sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Survey, by_method
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.task import Task, Worker
from salframe.evaluation.tables.table import Table
from salframe.evaluation.tasks.detection.task import place_of
from salframe.evaluation.tasks.sensor.fitting import SensorSample
from salframe.evaluation.tasks.sensor.looks import annotated, pack_look
from salframe.evaluation.tasks.sensor.measures import summarize_detector
from salframe.evaluation.tasks.sensor.rows import LookRow
from salframe.evaluation.tasks.sensor.table import COLUMNS, DEFAULT_COLUMNS, SensorRow, alike_tables
from salframe.framework.components.auto import name_parts
from salframe.framework.errors import FRAME_ERRORS, InputMissing, InvalidAnswer
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import QueryFrame, ReferenceFrame

Frame = ReferenceFrame | QueryFrame


@dataclass(frozen=True)
class SensorTask(Task[Frame, Survey[Frame], LookRow, SensorRow]):
    """The task `sensor`: which annotated objects does a detector detect in reference frames and queries?"""

    name = "sensor"
    role = "detector"
    prefix = "sensor-"
    counts = "panoramas"
    key_fields = ("frame",)
    row = LookRow
    line = SensorRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS

    def survey(self, dataset: Dataset) -> Survey[Frame]:
        if absent := {"annotations", "range"} - dataset.provides:
            lacks = f"the dataset {dataset.name} does not have {name_parts(absent)}"
            raise InputMissing(f"the task 'sensor' needs annotations and range images, but {lacks}")
        frames: dict[str, Frame] = {}
        for fold in dataset.folds():
            frames.update((frame.id, frame) for frame in fold.references)
            frames.update((query.id, query) for query in fold.queries)
        return Survey(dataset, list(frames.values()))

    def key(self, piece: Frame) -> tuple[str]:
        return (piece.id,)

    def open(
        self, label: str, method: Detector, survey: Survey[Frame], todo: Sequence[Frame], folder: Path
    ) -> Worker[Frame]:
        check_needs(method, survey.dataset)
        return _Looking(method)

    def failed(self, piece: Frame) -> Row:
        """Return the row of a failed panorama: annotated objects without detections; empty if it cannot be read."""
        try:
            truth, visibility = annotated(piece.load())
        except FRAME_ERRORS:
            return {}
        return pack_look(SensorSample(truth, visibility, Detections.empty()))

    def summarize(self, parts: Sequence[Part[Survey[Frame], LookRow]], seed: int) -> tuple[SensorRow, ...]:
        places = [
            f"{number}: {place_of(survey.dataset, piece)}"
            for number, (survey, _) in enumerate(parts)
            for piece in survey.pieces
        ]
        return tuple(summarize_detector(records, places, seed) for records in by_method(parts))

    @classmethod
    def tables(
        cls, rows: Sequence[SensorRow], columns: Sequence[str] = (), leading: Mapping[str, Sequence[str]] | None = None
    ) -> list[Table]:
        return [*super().tables(rows, columns, leading), *alike_tables(rows, leading)]


class _Looking(Worker[Frame]):
    """Runs a detector on panoramas."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector

    def work(self, piece: Frame) -> Row:
        panorama = piece.load()
        truth, visibility = annotated(panorama)
        detections = self._detector.detect(panorama)
        if not isinstance(detections, Detections):
            raise InvalidAnswer(
                f"the function `detect` of the detector returned {type(detections).__name__}, expected Detections"
            )
        return {**pack_look(SensorSample(truth, visibility, detections)), "status": PieceStatus.OK, "error": None}
