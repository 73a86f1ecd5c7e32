"""What a map of `saliency-graph` or `proposed` takes on disk, and the processor time that opening it takes, ready to be
asked, at 42, 1,000 and 10,000 scenes, with the index that is kept with it and without. `make benchmark`."""

import time

import numpy as np
import pytest
from house_map import describe_rooms
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places.localizer import SaliencyPlacesLocalizer

from salframe.framework.components.installation import folder_bytes
from salframe.framework.files import hashes
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import ReferenceFrame

pytestmark = pytest.mark.slow


def new_localizer(method):
    return method(method.Config(detector="annotations"))


@pytest.fixture(scope="module", params=[SaliencyGraphLocalizer, SaliencyPlacesLocalizer], ids=lambda one: one.name)
def method(request):
    return request.param


@pytest.fixture(scope="module")
def scenes(method):
    """The descriptions of the 42 rooms of an office, each with the place and the pose of its frame."""
    described = describe_rooms("office", 42, 7, method)
    assert len(described) == 42
    return described


@pytest.fixture(scope="module", params=[42, 1000, 10_000])
def mapped(request, method, scenes):
    """A map of the rooms over and over, on floors of their own."""
    frames = []
    for number in range(request.param):
        storey, frame = number // 42, scenes[number % 42][1]
        pose = frame.T_world_pano + np.array([[0.0] * 4, [0.0] * 4, [0, 0, 0, 3.0 * storey], [0.0] * 4])
        frames.append(ReferenceFrame(f"{storey}/{frame.id}", f"{storey}/{frame.place}", pose))
    descriptions = [scenes[number % 42][0] for number in range(request.param)]
    return LocalizationMap.from_descriptions(new_localizer(method), descriptions, frames)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("indexed", [True, False])
def test_bytes_and_seconds(benchmark, method, scenes, mapped, indexed, tmp_path):
    """The hashes of the parts are checked each time."""
    mapped.save(tmp_path / "map", with_index=indexed)
    count = len(mapped.frames)
    benchmark.extra_info["bytes_per_scene"] = round(folder_bytes(tmp_path / "map") / count, 1)

    def open_anew():
        hashes._hash.cache_clear()
        return LocalizationMap.open(tmp_path / "map", new_localizer(method))

    opened = benchmark.pedantic(open_anew, rounds=5, warmup_rounds=1)
    for number in (0, count - 1):
        before, after = (one.answer(scenes[number % 42][0]) for one in (mapped, opened))
        assert before.places == after.places
        np.testing.assert_array_equal(before.T_world_query, after.T_world_query)
    assert benchmark.extra_info["bytes_per_scene"] < (700 if method is SaliencyGraphLocalizer else 2000)
