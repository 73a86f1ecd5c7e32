"""The task `detection`: precision and recall of detectors against annotations."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Survey, by_method
from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.runs.task import Result, Task, Worker
from salframe.evaluation.tables.table import Table
from salframe.evaluation.tasks.detection.judging import count_right, joined_labels
from salframe.evaluation.tasks.detection.measures import summarize_detector
from salframe.evaluation.tasks.detection.rows import PanoramaRow
from salframe.evaluation.tasks.detection.table import (
    COLUMNS,
    DEFAULT_COLUMNS,
    DetectionRow,
    class_tables,
    what_is_right,
)
from salframe.framework.errors import FRAME_ERRORS, DataError, InputMissing, InvalidAnswer
from salframe.graphs.annotated import annotated_detections
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.vocabulary import with_common_labels
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.opening import Progress


def measure_detection(request: Request, *, progress: Progress | None = None) -> Result[DetectionRow]:
    """Run detectors on the query panoramas of a dataset, and count correct detections.

    The methods of the request are detectors. Labels are compared in the shared vocabulary (`common_label`), since each
    detector has a different one. The annotated objects are the ground truth (`count_right`).

    Raises:
        SalframeError: A name or a setting is wrong.
    """
    return run_task(DetectionTask(), request, resolve(request, "detector"), progress=progress)


@dataclass(frozen=True)
class DetectionTask(Task[QueryFrame, Survey[QueryFrame], PanoramaRow, DetectionRow]):
    """The task `detection`: which annotated objects does a detector detect in each query panorama?"""

    name = "detection"
    version = "2"
    role = "detector"
    prefix = "detection-"
    counts = "panoramas"
    key_fields = ("query",)
    row = PanoramaRow
    line = DetectionRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS

    def survey(self, dataset: Dataset) -> Survey[QueryFrame]:
        if "annotations" not in dataset.provides:
            raise InputMissing(
                f"the task 'detection' needs annotations, which the dataset {dataset.name} does not have: choose "
                "another dataset"
            )
        frames = {frame.id: frame for fold in dataset.folds() for frame in fold.queries}
        if not frames:
            raise DataError(f"the dataset {dataset.name} has no query (panorama to localize), expected at least one")
        return Survey(dataset, list(frames.values()))

    def key(self, piece: QueryFrame) -> tuple[str]:
        return (piece.id,)

    def open(
        self, label: str, method: Detector, survey: Survey[QueryFrame], todo: Sequence[QueryFrame], folder: Path
    ) -> Worker[QueryFrame]:
        check_needs(method, survey.dataset)
        return _Detecting(method)

    def failed(self, piece: QueryFrame) -> Row:
        """Return the row of a failed panorama: annotated objects without detections; empty if it cannot be read."""
        try:
            truth = annotated_detections(piece.load())
        except FRAME_ERRORS:
            return {}
        annotated = Counter(with_common_labels(truth).labels)
        return {"annotated": annotated, "detections": {}, "right": {}, "joined": joined_labels(truth), "ms": None}

    def summarize(self, parts: Sequence[Part[Survey[QueryFrame], PanoramaRow]], seed: int) -> tuple[DetectionRow, ...]:
        panoramas = sum(len(survey.pieces) for survey, _ in parts)
        places = [
            f"{number}: {place_of(survey.dataset, piece)}"
            for number, (survey, _) in enumerate(parts)
            for piece in survey.pieces
        ]
        return tuple(summarize_detector(records, panoramas, places, seed) for records in by_method(parts))

    @classmethod
    def details(cls, rows: Sequence[DetectionRow]) -> list[Table]:
        return class_tables(rows)

    @classmethod
    def legend(cls, rows: Sequence[DetectionRow]) -> list[str]:
        return what_is_right(rows)


def place_of(dataset: Dataset, frame: ReferenceFrame | QueryFrame) -> str:
    """Return the place of a panorama, or the id of the frame if the place is unknown."""
    if isinstance(frame, ReferenceFrame):
        return frame.place
    try:
        return dataset.truth(frame.id).place
    except DataError:
        return frame.id


class _Detecting(Worker[QueryFrame]):
    """Runs a detector on panoramas. It runs twice on the first one, so that the first call is not timed."""

    def __init__(self, detector: Detector) -> None:
        self._detector, self._warm = detector, False

    def work(self, piece: QueryFrame) -> Row:
        panorama = piece.load()
        if not self._warm:
            self._detector.detect(panorama)
            self._warm = True
        start = time.perf_counter()
        detections = self._detector.detect(panorama)
        ms = (time.perf_counter() - start) * 1e3
        if not isinstance(detections, Detections):
            raise InvalidAnswer(
                f"the function `detect` of the detector returned {type(detections).__name__}, expected Detections"
            )
        truth = annotated_detections(panorama)
        joined = joined_labels(truth) | joined_labels(detections)
        truth, detections = with_common_labels(truth), with_common_labels(detections)
        counted = {"annotated": Counter(truth.labels), "detections": Counter(detections.labels)}
        counted["right"] = count_right(detections, truth)
        return {**counted, "joined": joined, "ms": ms, "status": PieceStatus.OK, "error": None}
