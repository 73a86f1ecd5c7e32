"""What a graph costs: from an instance image and range, and against the map of 42 rooms. `make benchmark`."""

from functools import partial

import pytest
from salframe_house.building import change_building, generate_building
from salframe_house.frames import choose_frames
from salframe_house.render import HouseRenderer

from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Annotations, Panorama

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def building():
    """The reference frames and queries of an office of 42 rooms, panoramas of 1024 x 512 in memory on demand."""
    before = generate_building("office", 42, 7)
    after = change_building(before, 0.1, 7)
    renderers = {False: HouseRenderer(before.scene(), "day"), True: HouseRenderer(after.scene(), "day")}
    labels = {False: before.labels, True: after.labels}

    def load(spec):
        asked = spec.role == "query"
        range_m, instance_id = renderers[asked].geometry(pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m))
        return Panorama(spec.id, range_m=range_m, annotations=Annotations(instance_id, labels[asked]))

    specs = choose_frames(before, after, 7, queries_per_room=1)
    poses = {spec.id: pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m) for spec in specs}
    kinds = {"map": FrameKind.SCENE, "transition": FrameKind.TRANSITION}
    mapping = [
        ReferenceFrame(s.id, s.place, poses[s.id], kinds[s.role], partial(load, s)) for s in specs if s.role in kinds
    ]
    return mapping, [QueryFrame(s.id, partial(load, s)) for s in specs if s.role == "query"]


def localizer(method: str) -> Localizer:
    """A method whose objects are annotated, without errors."""
    noiseless = {"detector": {"kind": "annotations", "noise": "none"}}
    return registry().build("localizer", configure_default("localizer", method, [noiseless]))


@pytest.mark.parametrize("method", ["proposed", "saliency-graph"])
def test_instance_image_and_range_to_graph(benchmark, building, method):
    """Goal: 250 ms at 1024 x 512."""
    benchmark(localizer(method).describe, building[1][0].load())


@pytest.mark.parametrize("method", ["proposed", "saliency-graph"])
def test_query_against_the_map_of_42_rooms(benchmark, building, method):
    """The graph built; every query in turn, the time is of all 42 together."""
    mapping, queries = building
    asked = localizer(method)
    built = LocalizationMap.build(asked, mapping)
    descriptions = [describe_frame(asked, query)[0] for query in queries]
    answers = benchmark(lambda: [built.answer(description) for description in descriptions])
    assert len(answers) == len(queries)
