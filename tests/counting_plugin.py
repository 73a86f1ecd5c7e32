"""A detector that records each detection in a file, so that tests can count the detections of all processes."""

from __future__ import annotations

import os
import time

import numpy as np
from pydantic import Field

import salframe
from salframe.framework.component import ComponentConfig
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector

LOG = "detections.log"
"""Name of the file in the working folder."""
LABELS = ("sofa", "bed", "chair", "table")
"""Label of the object in each room."""
DELAY_S = 0.03
"""Duration of a detection."""


class Counting(Detector):
    """Detects one object, whose label stands for the room that the panorama of `fake_plugin` shows."""

    name, version, needs = "counting", "1", frozenset({"rgb"})

    class Config(ComponentConfig):
        size_m: float = Field(1.0, description="size of the object")

    def detect(self, panorama):
        time.sleep(DELAY_S)
        with open(LOG, "a", encoding="utf-8") as log:
            log.write(f"{panorama.id} {os.getpid()}\n")
        label, size_m = LABELS[panorama.rgb[0, 0, 0]], np.full((1, 3), self.config.size_m)
        return Detections((label,), np.ones(1), np.array([[1.0, 0.0, 0.0]]), size_m, np.zeros(1))


@salframe.hookimpl
def salframe_provides():
    return [Counting]
