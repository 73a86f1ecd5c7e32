"""Notes of answers: labels that the map does not know, and places whose frames are not one room."""

from dataclasses import replace

import pytest
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places.localizer import SaliencyPlacesLocalizer
from salframe_objects.localizer import ObjectSetLocalizer, SalientObjectsLocalizer
from salframe_objects.sovs import SalientVolumesLocalizer

from salframe.localization.answer_json import answer_json
from salframe.localization.map import LocalizationMap, open_map
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.panorama import Panorama
from salframe.testing.rooms import ROOMS, look, map_frames, query_frames, query_truths, stand

METHODS = [
    *(SaliencyPlacesLocalizer, SaliencyGraphLocalizer),
    *(ObjectSetLocalizer, SalientObjectsLocalizer, SalientVolumesLocalizer),
]


def renamed(panorama: Panorama, names: dict[str, str]) -> Panorama:
    labels = {number: names.get(label, label) for number, label in panorama.annotations.labels.items()}
    return replace(panorama, annotations=replace(panorama.annotations, labels=labels))


def rooms_map(method, frames=None) -> LocalizationMap:
    settings = method.Config(detector={"kind": "annotations", "noise": "none"})
    return LocalizationMap.build(method(settings), frames or map_frames())


@pytest.mark.parametrize("method", METHODS)
def test_other_spellings_and_synonyms_change_no_answer(method):
    built, names = rooms_map(method), {"bed": "Beds_2", "sofa": "COUCH", "chair": "chair#4", "lamp": "Lamp "}
    for query in query_frames():
        panorama = query.load()
        plain, spelt = built.localize(panorama), built.localize(renamed(panorama, names))
        assert answer_json(plain) == answer_json(spelt)
        assert (plain.notes, plain.places[0].place) == ((), query_truths()[query.id].place)


@pytest.mark.parametrize("method", METHODS)
def test_labels_that_the_map_lacks_are_named_as_they_are_written(method, tmp_path):
    built, panorama = rooms_map(method), renamed(query_frames()[0].load(), {"bed": "Bett", "chair": "Stuhl 2"})
    built.save(tmp_path / "map")
    for one in (built, open_map(tmp_path / "map")):
        assert one.localize(panorama).notes == ("no object of the map has the labels 'Bett', 'Stuhl 2'",)


def test_a_place_on_two_storeys_explains_that_there_is_no_pose():
    frames = []
    for storey, height_m in enumerate((0.0, 3.0)):
        for number, x_share in enumerate((0.4, 0.55)):
            pose = stand(ROOMS[0], x_share)
            panorama = look(ROOMS[storey], f"{storey}-{number}", stand(ROOMS[storey], x_share))
            pose[2, 3] += height_m
            frames.append(ReferenceFrame(panorama.id, "bedroom", pose, load=lambda panorama=panorama: panorama))
    built = rooms_map(SaliencyPlacesLocalizer, [*frames, *map_frames()[2:]])
    answers = [built.localize(frame.load()) for frame in frames]
    assert {answer.places[0].place for answer in answers} == {"bedroom"}
    for answer in answers:
        explained = (
            "no pose: the reference frames of the place 'bedroom' lie on several storeys (z = 1.50 to 4.50 m), "
            "expected one storey: use different place names on each storey"
        )
        assert answer.notes == (() if answer.status == "ok" else (explained,))
    assert "no-pose" in [answer.status for answer in answers]
