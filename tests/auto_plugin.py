"""Detectors by the names that `auto` takes, each of which sees one object that bears its name, and no network."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

import salframe
from salframe.framework.component import ComponentConfig
from salframe.framework.errors import WeightsError
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector

ABSENT = Path("no-weights")
"""Where this file is, `segments` has no weights."""


class Named(Detector):
    """Sees its own name a metre ahead."""

    version = "1"

    def detect(self, panorama):
        box = np.array([[1.0, 0.0, 0.0]])
        return Detections((self.name,), np.ones(1), box, np.ones((1, 3)), np.zeros(1))


class Annotations(Named):
    """Needs annotations."""

    name, needs = "annotations", frozenset({"annotations"})

    class Config(ComponentConfig):
        noise: Literal["none", "heavy"] = "heavy"


class Segments(Named):
    """Needs colour and weights."""

    name, needs = "segments", frozenset({"rgb"})

    @classmethod
    def check(cls, config):
        if ABSENT.exists():
            raise WeightsError("no file ade20k.tflite; get it with: salframe weights fetch ade20k")


class Rooms(Named):
    """Needs colour and range."""

    name, needs = "panoseg", frozenset({"rgb", "range"})

    class Config(ComponentConfig):
        min_score: float = 0.25


class Blind(Named):
    """Needs colour; `auto` does not know it."""

    name, needs = "blind", frozenset({"rgb"})


@salframe.hookimpl
def salframe_provides():
    return [Annotations, Segments, Rooms, Blind]
