"""Detectors that each break one rule, and the message of the conformance suite about each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ConfigDict, field_validator
from salframe_annotations.detector import AnnotationDetector

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import DataError
from salframe.framework.validation import Settings
from salframe.graphs.detections import Detections
from salframe.testing.rooms import HEIGHT_PX


def columns(detections: Detections) -> np.ndarray:
    """Return the (N,) columns of the centroids in the suite's panoramas."""
    return (np.pi - np.arctan2(detections.centroid_m[:, 1], detections.centroid_m[:, 0])) * HEIGHT_PX / np.pi


class Described(AnnotationDetector):
    """Base class of detectors that break one rule."""

    name = "broken"


class Shouting(Described):
    """Broken."""

    name = "My Detector"


class Silent(Described):
    pass


class Lenient(Described):
    """Broken."""

    class Config(ComponentConfig):
        model_config = ConfigDict(extra="ignore")


class Undecided(Described):
    """Broken."""

    class Config(ComponentConfig):
        threshold: float


class Clearing(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        panorama.annotations.labels.clear()
        return detections


class Overwriting(Described):
    """Broken."""

    def detect(self, panorama):
        panorama.range_m[np.isnan(panorama.range_m)] = 0
        return super().detect(panorama)


class Restless(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        return replace(detections, scores=np.random.default_rng().random(len(detections)))


class Moody(Described):
    """Broken."""

    def __init__(self, config=None):
        super().__init__(config)
        self.score = np.random.default_rng().random()

    def detect(self, panorama):
        detections = super().detect(panorama)
        return replace(detections, scores=np.full(len(detections), self.score))


class Flat(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        return replace(detections, centroid_m=detections.centroid_m[:, :2])


class Listing(Described):
    """Broken."""

    def detect(self, panorama):
        return list(super().detect(panorama).labels)


class Certain(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        return replace(detections, scores=np.full(len(detections), 100.0))


class Seamed(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        return detections.take(
            [
                i
                for i in range(len(detections))
                if (detections.points_m[i][:, 1] > 0).all() or detections.points_m[i][:, 0].max() > 0
            ]
        )


class Offset(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        return replace(detections, centroid_m=detections.centroid_m + np.array([0.05, 0, 0]))


class AxisAligned(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        sizes = [np.maximum(np.ptp(points, axis=0), 0.05) for points in detections.points_m]
        return replace(detections, size_m=np.reshape(sizes, (-1, 3)), yaw_rad=np.zeros(len(detections)))


class Strided(Described):
    """Broken."""

    column_step = 4

    def detect(self, panorama):
        detections = super().detect(panorama)
        return detections.take(np.flatnonzero(np.round(columns(detections)) % 4))


class Unturned(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        return replace(detections, yaw_rad=np.zeros(len(detections)))


class Distracted(Described):
    """Broken."""

    class Config(AnnotationDetector.Config):
        steady: Literal["yes", "no"] = match_only("yes")

    def detect(self, panorama):
        detections = super().detect(panorama)
        return detections if self.config.steady == "yes" else detections.take([])


class Haunted(Described):
    """Broken."""

    def detect(self, panorama):
        return (
            super().detect(panorama)
            if panorama.annotations.labels
            else Detections(("ghost",), [1.0], [[1.0, 0, 0]], [[1.0, 1, 1]], [0.0])
        )


class Stretched(Described):
    """Broken."""

    def detect(self, panorama):
        detections = super().detect(panorama)
        return (
            detections
            if len(detections) and np.isfinite(detections.centroid_m).all()
            else replace(detections, bearing=2 * detections.bearing)
        )


class Refusing(AnnotationDetector):
    """Broken."""

    name = "broken"

    class Config(AnnotationDetector.Config):
        table: UserFile | None = None

        @field_validator("table")
        @classmethod
        def _plain(cls, value):
            return None if value is None else Path(value)

    def __init__(self, config=None):
        super().__init__(config)
        if self.config.table is not None:
            raise DataError("the file holds no table")


class Tables(Settings):
    files: tuple[UserFile, ...] = ()

    @field_validator("files")
    @classmethod
    def _plain(cls, value):
        return tuple(map(str, value))


class Nested(Described):
    """Broken."""

    class Config(AnnotationDetector.Config):
        tables: Tables = Tables()


class Pathed(Described):
    """Broken."""

    class Config(AnnotationDetector.Config):
        table: tuple[Path, ...] | None = None


BROKEN_DETECTORS = [
    (Shouting, "Shouting.name is 'My Detector', expected words of lower-case letters"),
    (Silent, "docstring of Silent: received none"),
    (Lenient, "Config: received no error for an unknown key"),
    (Undecided, "Undecided.Config has no default for threshold"),
    (Clearing, "detect in the bedroom: received a changed input"),
    (Overwriting, "detect in the bedroom: received ValueError: .*read-only"),
    (Restless, "detect in the bedroom: received two different answers to the same input"),
    (Moody, "by another instance: received different detections"),
    (Flat, r"received InvalidAnswer: the field Detections.centroid_m has shape \(\d, 2\), expected \(\d, 3\)"),
    (Listing, "received list, expected Detections"),
    (Certain, r"received InvalidAnswer: Detections.scores contains 100.0, expected numbers from 0 to 1"),
    (Seamed, r"detect in the \w+ rolled by \d+ columns: received \["),
    (Offset, r"rolled by 1 columns: received an object '\w+' that moved 0\.0\d+ m"),
    (Strided, r"not multiples of column_step = 4: received \d+ of \d+ objects within 2 deg, expected at least 95%"),
    (AxisAligned, r"rolled by \d+ columns: received an object '\w+' that changed its size by"),
    (Unturned, r"received an object '\w+' that turned \d.* deg relative to the room"),
    (
        Distracted,
        "identity with another steady: received another description, expected the same description: .* match_only",
    ),
    (Haunted, "detect in a blank panorama: received 1 objects, expected Detections.empty"),
    (Stretched, r"detect with annotations alone: received bearings of length \[2.0"),
    (Refusing, "identity with another content of the file table: received the same value, expected another"),
    (Nested, "identity with another content of the file tables.files: received the same value, expected another"),
    (Pathed, "setting table: received a plain Path, expected a UserFile"),
]
