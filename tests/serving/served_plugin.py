"""A detector for the rooms of the conformance suite, whose surfaces have one hue each."""

from __future__ import annotations

import zlib
from typing import ClassVar

import numpy as np

import salframe
from salframe.framework.component import ComponentConfig
from salframe.graphs.boxes import detections_from_points
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.geometry import equirectangular_rays
from salframe.testing.rooms import ROOMS

MIN_PIXELS = 40


def _hues() -> tuple[list[str], np.ndarray]:
    """The labels and hues of all surfaces; "" for walls."""
    labels, names = [], []
    for room in ROOMS:
        labels += ["", *(box.label for box in room.boxes)]
        names += [room.name, *(f"{room.name} {box.label}" for box in room.boxes)]
    colour = np.array([np.random.default_rng(zlib.crc32(name.encode())).uniform(60, 230, 3) for name in names])
    return labels, colour / np.linalg.norm(colour, axis=1, keepdims=True)


class PaintedDetector(Detector):
    """Detects surfaces by their hue."""

    name = "painted"
    version = "1"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb", "range"})

    class Config(ComponentConfig):
        pass

    def detect(self, panorama):
        labels, hues = _hues()
        rgb = panorama.rgb.reshape(-1, 3).astype(float)
        length = np.linalg.norm(rgb, axis=1)
        number = np.where(length > 0, (rgb @ hues.T).argmax(1), -1)
        rays = equirectangular_rays(len(panorama.rgb)).reshape(-1, 3)
        points = rays * panorama.range_m.reshape(-1, 1)
        known = np.isfinite(points).all(1)
        names, sets = [], []
        for i, label in enumerate(labels):
            mine = known & (number == i)
            if label and mine.sum() >= MIN_PIXELS:
                names.append(label)
                sets.append(points[mine].astype(np.float32))
        return detections_from_points(names, np.ones(len(sets)), sets) if sets else Detections.empty()


@salframe.hookimpl
def salframe_provides():
    return [PaintedDetector]
