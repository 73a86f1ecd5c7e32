"""Detection accuracy: which of the annotated objects a detector finds, and which of its objects are there."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.compare import Progress
from salframe.evaluation.predict import describe_error
from salframe.framework.config import ComponentConfig, parse_override
from salframe.framework.errors import ConfigError, InputMissing, RequirementMissing, WeightsMissing
from salframe.framework.presets import configure, nest_for, settings
from salframe.framework.registry import registry
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Frame
from salframe.panoramas.opening import dataset_settings, open_dataset

NEAR_M = 0.3
"""A detection is right where an annotated object of its label has its centroid this near."""


@dataclass(frozen=True)
class Counts:
    """How many objects are annotated, how many were found, and how many of these are right."""

    annotated: int
    found: int
    right: int

    @property
    def precision(self) -> float | None:
        """Right ones among those found; None where none was found."""
        return self.right / self.found if self.found else None

    @property
    def recall(self) -> float | None:
        """Right ones among those annotated; None where there is none."""
        return self.right / self.annotated if self.annotated else None

    def to_json(self) -> dict[str, Any]:
        """The counts and what follows from them."""
        return {
            "annotated": self.annotated,
            "found": self.found,
            "right": self.right,
            "precision": self.precision,
            "recall": self.recall,
        }


@dataclass(frozen=True)
class DetectorResult:
    """What a detector reached on all panoramas: overall and by class (classes annotated or found, by name), median ms a
    panorama, or why not."""

    detector: str
    overall: Counts | None
    classes: dict[str, Counts]
    ms: float | None
    reason: str | None = None

    def to_json(self) -> dict[str, Any]:
        """All of it, by name."""
        overall = self.overall.to_json() if self.overall else None
        classes = {label: counts.to_json() for label, counts in self.classes.items()}
        return {"detector": self.detector, "overall": overall, "ms": self.ms, "reason": self.reason, "classes": classes}


def measure_detection(
    detectors: Sequence[str],
    data: str = "house-12",
    *,
    data_dir: Path | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
) -> list[DetectorResult]:
    """Run detectors on the query panoramas of a dataset and count what is right (`count_right`).

    The truth is what the detector `annotations` finds without error. overrides: "data.key=value", "DETECTOR.key=value".
    Raises SalframeError on names and settings that are wrong; a detector that cannot run keeps its place with the
    reason.
    """
    if not detectors:
        raise ConfigError("received no detector, expected at least one")
    given = nest_for(map(parse_override, overrides), ("data", *detectors))
    configs = {name: configure("detector", name, settings("detector", name), given[name]) for name in detectors}
    data_name, content = dataset_settings(data, data_dir)
    dataset = open_dataset(
        configure("dataset", data_name, content, given["data"]), progress and partial(progress, data_name)
    )
    return [
        measure_detector(name, config, dataset, progress and partial(progress, name))
        for name, config in configs.items()
    ]


def measure_detector(
    name: str, config: ComponentConfig, dataset: Dataset, progress: Callable[[int, int], None] | None = None
) -> DetectorResult:
    """One detector on all query panoramas; the first panorama is detected twice, so that no first call is timed."""
    annotations: Detector = registry().build("detector", configure("detector", "annotations", {"noise": "none"}))
    frames = list({frame.id: frame for fold in dataset.folds() for frame in fold.queries}.values())
    annotated, found, right, ms = Counter[str](), Counter[str](), Counter[str](), []
    try:
        detector: Detector = registry().build("detector", config)
        absent = sorted((detector.needs | annotations.needs) - dataset.provides)
        if absent:
            raise InputMissing(f"needs {' and '.join(absent)}, which {dataset.name} does not have")
        for number, frame in enumerate(frames):
            truth, seen, seconds = _look(frame, annotations, detector, warm=number > 0)
            annotated.update(truth.labels)
            found.update(seen.labels)
            right.update(count_right(seen, truth))
            ms.append(seconds * 1e3)
            if progress:
                progress(number + 1, len(frames))
    except (RequirementMissing, WeightsMissing, InputMissing) as error:
        return DetectorResult(name, None, {}, None, describe_error(error))
    labels = sorted({*annotated, *found})
    classes = {label: Counts(annotated[label], found[label], right[label]) for label in labels}
    return DetectorResult(
        name, Counts(annotated.total(), found.total(), right.total()), classes, float(np.median(ms)) if ms else None
    )


def _look(frame: Frame, annotations: Detector, detector: Detector, warm: bool) -> tuple[Detections, Detections, float]:
    panorama = frame.load()
    if not warm:
        detector.detect(panorama)
    start = time.perf_counter()
    seen = detector.detect(panorama)
    seconds = time.perf_counter() - start
    return annotations.detect(panorama), seen, seconds


def count_right(found: Detections, truth: Detections) -> Counter[str]:
    """How many detections of each label are right: one to one with annotated objects of the label whose centroid lies
    within NEAR_M, as many as can be."""
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    right = Counter[str]()
    for label in set(found.labels) & set(truth.labels):
        own, annotated = ([i for i, name in enumerate(side.labels) if name == label] for side in (found, truth))
        near = (
            cdist(found.centroid_m[own], truth.centroid_m[annotated]) <= NEAR_M
        )  # an unknown centroid is near nothing
        right[label] = int(near[linear_sum_assignment(near, maximize=True)].sum())
    return right
