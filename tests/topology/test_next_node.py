"""The next view in a map with a topology: turns and walks in a rendered home."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from salframe.framework.components.registry import registry
from salframe.framework.files.cache import Cache
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.opening import find_dataset, reference_frames
from salframe.topology.build import build_topology
from salframe.topology.next_node import next_view_in

FAR = pose_2d(1000, 1000, 0)


@pytest.fixture(scope="module")
def home():
    """The map and the topology of a small home, and its queries of 90 and of 360 degrees."""
    settings = ("data.height=128", "data.queries_per_room=1", "data.rgb=false")
    dataset = find_dataset("house-6", overrides=settings)
    config = (
        registry()
        .get("localizer", "saliency-places")
        .Config.model_validate({"detector": {"kind": "annotations", "noise": "none"}})
    )
    localizer = registry().build(Localizer.role, config)
    frames = reference_frames(dataset)
    map = LocalizationMap.build(localizer, frames, Cache(), dataset.content_key, floors=dataset.floors())
    narrow = find_dataset("house-6", overrides=(*settings, "data.query_fov_deg=90"))
    queries = [query for fold in narrow.folds() for query in fold.queries]
    whole = [query for fold in dataset.folds() for query in fold.queries]
    return map, build_topology(dataset.floors(), frames), queries, whole


def test_the_pose_of_the_first_place_is_that_of_the_answer(home):
    map, _, queries, _ = home
    answers = [(query, map.localize(query)) for query in queries]
    posed = [(query, answer) for query, answer in answers if answer.T_world_query is not None]
    assert len(posed) > len(queries) / 2
    for query, answer in posed:
        poses = map.localizer.place_poses(map.describe_panorama(query.load()).description)
        assert poses.camera.sum() == 18  # of 72 bins: 90 degrees
        np.testing.assert_array_equal(poses.camera, poses.shown)
        first = poses.T_world_query[answer.places[0].place]
        np.testing.assert_allclose(first[:2, 3], answer.T_world_query[:2, 3], atol=0.3)


def test_a_whole_panorama_leads_to_a_walk_and_a_narrow_one_to_the_best_motion(home):
    map, topology, queries, whole = home
    walks = 0
    for query in whole:
        answer = map.localize(query)
        assert answer.next_view is None
        view = next_view_in(topology, answer)
        if view is None:
            continue
        walks += 1
        node = next(node for node in topology.nodes if node.id == view.node)
        offset = np.array(node.xyz_m[:2]) - answer.T_world_query[:2, 3]
        assert view.length_m == pytest.approx(np.linalg.norm(offset), abs=0.1)
        heading_rad = pose_yaw(answer.T_world_query) + np.radians(view.turn_deg)
        np.testing.assert_allclose(np.exp(1j * heading_rad), np.exp(1j * np.arctan2(*offset[::-1])), atol=0.1)
        assert str(view).endswith(f" m to {view.node}")
    assert walks > len(whole) / 2
    for query in queries:
        answer = map.localize(query)
        turn, view = answer.next_view, next_view_in(topology, answer)
        if turn is not None:
            assert view.expected_entropy <= turn.expected_entropy + 1e-6
            assert view.entropy == turn.entropy


def test_without_a_pose_on_a_floor_only_turns_are_compared(home):
    map, topology, queries, _ = home
    answer = next(answer for query in queries if (answer := map.localize(query)).T_world_query is not None)
    outside = replace(answer, T_world_query=FAR)
    assert next_view_in(topology, outside) == answer.next_view


def test_a_camera_that_sees_no_object_turns_to_new_directions(home):
    map, _, queries, _ = home
    panorama = queries[0].load()
    nothing = replace(
        panorama, annotations=replace(panorama.annotations, instance_id=np.zeros_like(panorama.annotations.instance_id))
    )
    answer = map.localize(nothing)
    assert answer.places == ()
    assert answer.next_view.turn_deg == 90
