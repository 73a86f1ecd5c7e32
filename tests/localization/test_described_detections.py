"""Queries of detections instead of a panorama."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_plugin import Reader, Rooms

from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing, UnknownName
from salframe.framework.validation import validate
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.testing.rooms import ROOMS, box_detections, map_frames, stand


@pytest.fixture(scope="module")
def opened() -> dict[str, LocalizationMap]:
    """A map of the rooms by each method that uses detections."""
    maps = {}
    for kind in ("saliency-places", "saliency-graph", "objects", "salient-objects", "sovs"):
        role = registry().get(Localizer.role, kind)
        config = validate(role.Config, {"kind": kind, "detector": {"kind": "annotations"}}, "test")
        maps[kind] = LocalizationMap.build(role(config), map_frames())
    return maps


@pytest.mark.parametrize("kind", ["saliency-places", "saliency-graph", "objects", "salient-objects", "sovs"])
def test_detections_are_localized_without_a_panorama(opened, kind):
    """The detections are the furniture seen from the pose of the reference frame of the room."""
    for room in ROOMS:
        view = opened[kind].describe_detections(box_detections(room))
        answer = opened[kind].answer_query(opened[kind].describe_query([view]))
        assert answer.places[0].place == room.name
        if answer.T_world_query is not None:
            assert np.abs(answer.T_world_query[:2, 3] - stand(room)[:2, 3]).max() < 0.1


@pytest.mark.parametrize("kind", ["saliency-places", "saliency-graph", "objects", "salient-objects", "sovs"])
def test_a_panorama_is_described_from_its_detections(opened, kind):
    localizer, panorama = opened[kind].localizer, map_frames()[0].load()
    detections = registry().build("detector", localizer.config.detector).detect(panorama)
    expected, received = localizer.describe(panorama), localizer.describe_detections(detections, panorama)
    assert expected.keys() == received.keys()
    for name, array in expected.items():
        np.testing.assert_array_equal(array, received[name])


def test_a_reference_frame_and_its_description(opened):
    frame, description = opened["saliency-graph"].reference("kitchen-map")
    assert (frame.place, len(description["labels"])) == ("kitchen", 6)
    with pytest.raises(UnknownName, match="the map has no reference frame 'none'"):
        opened["saliency-graph"].reference("none")


def test_a_method_without_objects_refuses_detections(fakes):
    rooms = LocalizationMap.build(Reader(), reference_frames(Rooms()))
    with pytest.raises(InputMissing, match="received detections, which the method 'reader' does not use"):
        rooms.describe_detections(box_detections(ROOMS[0]))


@pytest.mark.parametrize("kind", ["saliency-places", "saliency-graph", "objects", "salient-objects", "sovs"])
def test_people_pets_and_bags_are_not_described(opened, kind):
    localizer, detections = opened[kind].localizer, box_detections(ROOMS[0])
    moving = replace(detections, labels=("Person", "cat", "suitcase_2", *detections.labels[3:]))
    expected = localizer.describe_objects(detections.take(range(3, len(detections))), Panorama("room"))
    received = localizer.describe_detections(moving, Panorama("room"))
    assert expected.keys() == received.keys()
    for name, array in expected.items():
        np.testing.assert_array_equal(array, received[name])
