"""A data set that renders, in no time, and a method whose weights lie at the address $SMALL_WEIGHTS, for the tests of
kills."""

from __future__ import annotations

import hashlib
import os

import numpy as np
from fake_plugin import Reader

import salframe
from salframe.framework.files.weights import Download, NetworkWeights, WeightsFile
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.rendered import FrameSpec, RenderedDataset

NUMBERS = bytes(range(256)) * 4096
"""The weights."""
SMALL_WEIGHTS = "SMALL_WEIGHTS"


class Small(RenderedDataset[FrameSpec]):
    """Eight panoramas 16 pixels high, of one floor."""

    name = "small"
    version = "1"
    provides = frozenset({"range", "annotations"})

    def list_frames(self) -> list[FrameSpec]:
        mapped = [FrameSpec(f"m{number}", "map", "hall", number, 2.0, 1.5, 0.0) for number in range(4)]
        return mapped + [FrameSpec(f"q{number}", "query", "hall", number, 2.5, 1.5, 1.0) for number in range(4)]

    def render(self, frame: FrameSpec) -> Panorama:
        instance_id = np.zeros((16, 32), np.int32)
        instance_id.flat[:100] = 1
        range_m = np.full((16, 32), 1.0 + frame.x_m, np.float32)
        return Panorama(frame.id, range_m=range_m, annotations=Annotations(instance_id, rendered=True))

    def list_objects(self) -> dict[str, list]:
        return {"instance_id": [1], "label": ["bed"]}

    def list_floors(self) -> dict[str, FloorMasks]:
        free = np.ones((8, 10), bool)
        return {"ground": FloorMasks(free, free.astype(np.int32), free, 0.5, (0.0, 4.0), {1: "hall"})}


class Address(Download):
    """A server that is known when it is asked."""

    def address(self, url: str, file: WeightsFile) -> str:
        return f"{os.environ[SMALL_WEIGHTS]}/{file.name}"


class Weighted(Reader):
    """Has weights."""

    name = "weighted"
    weights = (
        NetworkWeights(
            "small",
            "MIT",
            (WeightsFile("small.bin", hashlib.sha256(NUMBERS).hexdigest(), len(NUMBERS)),),
            Address((f"${SMALL_WEIGHTS}",)),
        ),
    )


@salframe.hookimpl
def salframe_provides():
    return [Small, Weighted]
