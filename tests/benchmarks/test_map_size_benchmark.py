"""What a map of `saliency-graph` takes on disk, and the processor time that reading it takes, at 42, 1,000 and 10,000
scenes: at most 1 s. `make benchmark`."""

import time

import numpy as np
import pytest
from city import describe_rooms
from salframe_graphs.localizer import SaliencyGraphLocalizer

from salframe.framework import files
from salframe.framework.installation import folder_bytes
from salframe.panoramas.frames import MapFrame

pytestmark = pytest.mark.slow


class Unindexed(SaliencyGraphLocalizer):
    """Without the matcher's index, which is no part of the map on disk."""

    def index(self, descriptions, frames):
        self.known, self.frames = descriptions, frames


@pytest.fixture(scope="module")
def scenes():
    """The descriptions of the 42 rooms of an office, each with the place and the pose of its frame."""
    described = describe_rooms("office", 42, 7)
    assert len(described) == 42
    return described


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("count", [42, 1000, 10_000])
def test_bytes_and_seconds(benchmark, scenes, tmp_path, count):
    """The rooms over and over, on floors of their own; the hashes of the parts are checked each time."""

    localizer, frames = Unindexed(Unindexed.Config(detector="annotations")), []
    for number in range(count):
        storey, frame = number // 42, scenes[number % 42][1]
        pose = frame.T_world_pano + np.array([[0.0] * 4, [0.0] * 4, [0, 0, 0, 3.0 * storey], [0.0] * 4])
        frames.append(MapFrame(f"{storey}/{frame.id}", f"{storey}/{frame.place}", pose))
    localizer.take_map([scenes[number % 42][0] for number in range(count)], frames)
    localizer.save(tmp_path / "map")
    benchmark.extra_info["bytes_per_scene"] = round(folder_bytes(tmp_path / "map") / count, 1)

    def read_anew():
        files._hash.cache_clear()
        localizer.load(tmp_path / "map")

    benchmark.pedantic(read_anew, rounds=5, warmup_rounds=1)
    assert [frame.id for frame in localizer.frames] == [frame.id for frame in frames]
    for number in (0, count - 1):
        known, exact = localizer.known[number], scenes[number % 42][0]
        assert known["labels"].tolist() == exact["labels"].tolist()
        np.testing.assert_allclose(known["centroid_m"], exact["centroid_m"], atol=6e-4)
    assert benchmark.extra_info["bytes_per_scene"] < 700
