"""The task `detection`: which of the annotated objects a detector finds, and which of its objects are there."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.result import Result
from salframe.evaluation.runs.rows import PanoramaRow
from salframe.evaluation.runs.run_folder import PieceStatus, Row, Run
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
from salframe.evaluation.statistics import bootstrap_interval, median
from salframe.framework.errors import FRAME_ERRORS, DataError, InputMissing, InvalidAnswer
from salframe.graphs.annotated import annotated_detections
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.vocabulary import common_label
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import MapFrame, QueryFrame
from salframe.panoramas.opening import Progress

NEAR_M = 0.3
"""A detection is right where an annotated object of its label has its centroid this near."""


@dataclass(frozen=True)
class Counts:
    """How many objects are annotated, how many were found, and how many of these are right.

    precision: right ones among those found; recall: among those annotated; None where there is none.
    """

    annotated: int
    found: int
    right: int
    precision: float | None = None
    recall: float | None = None

    @classmethod
    def of(cls, annotated: int, found: int, right: int) -> Counts:
        """The counts and what follows from them."""
        precision, recall = right / found if found else None, right / annotated if annotated else None
        return cls(annotated, found, right, precision, recall)


@dataclass(frozen=True, kw_only=True)
class DetectionRow(MethodRow):
    """A detector's line: overall and by class (classes annotated or found, by common name), and median ms a panorama.

    joined: the common name of each label, annotated or found, that is another word for it. `_low` and `_high`: 95 %
    intervals of the overall shares, of panoramas clustered by place where it is known.
    """

    panoramas: int
    overall: Counts | None = None
    precision_low: float | None = None
    precision_high: float | None = None
    recall_low: float | None = None
    recall_high: float | None = None
    classes: dict[str, Counts] = field(default_factory=dict)
    joined: dict[str, str] = field(default_factory=dict)
    ms: float | None = None

    @property
    def measured(self) -> bool:
        return self.overall is not None


def measure_detection(request: Request, *, progress: Progress | None = None) -> Result[DetectionRow]:
    """Run detectors, the request's methods, on the query panoramas of a data set, and count what is right.

    Labels are compared in the vocabulary that detectors share (`common_label`), for each has its own words. The truth
    are the annotated objects (`count_right`). Raises SalframeError on names and settings that are wrong.
    """
    return run_task(DetectionTask(), request, resolve(request, "detector"), progress=progress)


@dataclass(frozen=True)
class DetectionTask(Task[QueryFrame, Survey[QueryFrame]]):
    """What is there in each query panorama?"""

    name = "detection"
    version = "2"
    role = "detector"
    prefix = "detection-"
    counts = "panoramas"
    key_fields = ("query",)
    row = PanoramaRow

    @classmethod
    def from_run(cls, run: Run) -> DetectionTask:
        return cls()

    def survey(self, dataset: Dataset) -> Survey[QueryFrame]:
        if "annotations" not in dataset.provides:
            raise InputMissing(f"detection is measured by annotations, which {dataset.name} does not have")
        frames = {frame.id: frame for fold in dataset.folds() for frame in fold.queries}
        if not frames:
            raise DataError(f"{dataset.name} has no query, expected at least one")
        return Survey(dataset, list(frames.values()))

    def key(self, piece: QueryFrame) -> tuple[str]:
        return (piece.id,)

    def open(
        self, label: str, method: Detector, survey: Survey[QueryFrame], todo: Sequence[QueryFrame], folder: Path
    ) -> Worker[QueryFrame]:
        check_needs(method, survey.dataset)
        return _Detecting(method)

    def failed(self, piece: QueryFrame) -> Row:
        """What there was to find, where the panorama can be read at all."""
        try:
            truth = annotated_detections(piece.load())
        except FRAME_ERRORS:
            return {}
        annotated = Counter(in_common_words(truth).labels)
        return {"annotated": annotated, "found": {}, "right": {}, "joined": joined_labels(truth), "ms": None}

    def summarize(self, parts: Sequence[Part[Survey[QueryFrame]]], seed: int) -> tuple[DetectionRow, ...]:
        panoramas = sum(len(survey.pieces) for survey, _ in parts)
        places = [
            f"{number}: {place_of(survey.dataset, piece)}"
            for number, (survey, _) in enumerate(parts)
            for piece in survey.pieces
        ]
        return tuple(_summarize(records, panoramas, places, seed) for records in by_method(parts))


def place_of(dataset: Dataset, frame: MapFrame | QueryFrame) -> str:
    """The place of a panorama, or what it is called itself where that is not known."""
    if isinstance(frame, MapFrame):
        return frame.place
    try:
        return dataset.truth(frame.id).place
    except DataError:
        return frame.id


class _Detecting(Worker[QueryFrame]):
    """A detector that looks at panoramas; the first is looked at twice, so that no first call is timed."""

    def __init__(self, detector: Detector) -> None:
        self._detector, self._warm = detector, False

    def work(self, piece: QueryFrame) -> Row:
        panorama = piece.load()
        if not self._warm:
            self._detector.detect(panorama)
            self._warm = True
        start = time.perf_counter()
        found = self._detector.detect(panorama)
        ms = (time.perf_counter() - start) * 1e3
        if not isinstance(found, Detections):
            raise InvalidAnswer(f"detect gave {type(found).__name__}, expected Detections")
        truth = annotated_detections(panorama)
        joined = joined_labels(truth) | joined_labels(found)
        truth, found = in_common_words(truth), in_common_words(found)
        counted = {"annotated": Counter(truth.labels), "found": Counter(found.labels)}
        counted["right"] = count_right(found, truth)
        return {**counted, "joined": joined, "ms": ms, "status": PieceStatus.OK, "error": None}


def in_common_words(detections: Detections) -> Detections:
    """The detections with labels of the vocabulary that detectors share."""
    return replace(detections, labels=tuple(map(common_label, detections.labels)))


def joined_labels(detections: Detections) -> dict[str, str]:
    """The common name of each label that is another word for it."""
    return {label: name for label in detections.labels if (name := common_label(label)) != label}


def count_right(found: Detections, truth: Detections) -> Counter[str]:
    """How many detections of each label are right: one to one with annotated objects of the label whose centroid lies
    within NEAR_M, as many as can be.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    right = Counter[str]()
    for label in set(found.labels) & set(truth.labels):
        own, annotated = ([i for i, name in enumerate(side.labels) if name == label] for side in (found, truth))
        # An unknown centroid is near nothing.
        near = cdist(found.centroid_m[own], truth.centroid_m[annotated]) <= NEAR_M
        right[label] = int(near[linear_sum_assignment(near, maximize=True)].sum())
    return right


def _summarize(records: Sequence[Record], panoramas: int, places: Sequence[str], seed: int) -> DetectionRow:
    """A detector's line; places (P,): where each panorama was taken."""
    line = DetectionRow(**in_common(records), panoramas=panoramas)
    if not all(record.done for record in records):
        return line
    all_rows = [row for record in records for row in record.rows]
    rows = [row for row in all_rows if row is not None]
    good = [row for row in rows if row["status"] == PieceStatus.OK]
    if len(good) < panoramas:
        first = next(iter(line.errors.values()), "no answer")
        line = replace(line, reason=f"{panoramas - len(good)} panorama(s) failed, the first: {first}")
    if not good:
        return line
    # What a failure had to find was not found; a panorama that nobody could read tells nothing.
    told = [(row, place) for row, place in zip(all_rows, places, strict=True) if row is not None and "annotated" in row]
    counted, places = [row for row, _ in told], [place for _, place in told]
    annotated, found, right = (
        sum((Counter(row[key]) for row in counted), Counter[str]()) for key in ("annotated", "found", "right")
    )
    each = {key: np.array([sum(row[key].values()) for row in counted]) for key in ("annotated", "found", "right")}
    for name, below in (("precision", "found"), ("recall", "annotated")):
        if each[below].any():
            low, high = bootstrap_interval(each["right"], places, seed, each[below])
            bounds: dict[str, Any] = {f"{name}_low": low, f"{name}_high": high}
            line = replace(line, **bounds)
    classes = {label: Counts.of(annotated[label], found[label], right[label]) for label in sorted({*annotated, *found})}
    overall = Counts.of(annotated.total(), found.total(), right.total())
    joined = {label: name for row in counted for label, name in sorted(row["joined"].items())}
    return replace(line, overall=overall, classes=classes, joined=joined, ms=median([row["ms"] for row in good]))
