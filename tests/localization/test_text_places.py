"""Places that fit a description in words: probabilities in closed form, and the question that splits them."""

from __future__ import annotations

import numpy as np
import pytest
from fake_plugin import Reader

from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing
from salframe.graphs.detections import Detections
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.text_places import ANSWER_SHARE, COUNT_DECREASE, RELATION_SHARE, WRONG_WORD_SHARE, ask
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama

ROOMS = {
    "office": {"sofa": [(2, 0)], "plant": [(2, 1), (0, 3)], "bed": [(3, -1)]},
    "bedroom": {"sofa": [(2, 0)], "plant": [(2, -2)], "bed": [(3, 2)]},
    "bathroom": {"bathtub": [(2, 0)], "sink": [(0, 2)], "mirror": [(-2, 0)]},
}


def objects(room: dict[str, list[tuple[float, float]]]) -> Detections:
    """Objects of 0.5 m at the height of the camera."""
    labels = [label for label, places in room.items() for _ in places]
    centroid_m = np.array([(x, y, 0.0) for places in room.values() for x, y in places]).reshape(-1, 3)
    n = len(labels)
    return Detections(tuple(labels), np.ones(n), centroid_m, np.full((n, 3), 0.5), np.zeros(n))


def build(rooms: dict[str, dict[str, list[tuple[float, float]]]], kind: FrameKind = FrameKind.SCENE) -> LocalizationMap:
    config = registry().get("localizer", "saliency-places").Config.model_validate({"detector": {"kind": "annotations"}})
    localizer = registry().build(Localizer.role, config)
    frames = [ReferenceFrame(f"in {room}", room, pose_2d(10 * k, 0, 0), kind) for k, room in enumerate(rooms)]
    descriptions = [localizer.describe_detections(objects(room), Panorama(name)) for name, room in rooms.items()]
    return LocalizationMap.from_descriptions(localizer, descriptions, frames)


@pytest.fixture(scope="module")
def home() -> LocalizationMap:
    return build(ROOMS)


def shares(map: LocalizationMap, text: str) -> dict[str, float]:
    return {place.place: place.probability for place in ask(map, text).places}


def test_the_probability_of_a_word_is_that_of_its_share(home):
    """Each room has 3 labels; the sofa is in 2 of 3 rooms."""
    elsewhere = WRONG_WORD_SHARE * (2 / 3) / 3
    with_sofa = (1 - WRONG_WORD_SHARE) / 3 + elsewhere
    total = 2 * with_sofa + elsewhere
    expected = {"office": with_sofa / total, "bedroom": with_sofa / total, "bathroom": elsewhere / total}
    assert shares(home, "a sofa") == pytest.approx(expected)
    assert shares(home, "couch") == pytest.approx(expected)


def test_numbers_and_orders_tell_rooms_apart(home):
    counted = shares(home, "two plants")
    elsewhere = WRONG_WORD_SHARE * (2 / 3) / 3
    right = (1 - WRONG_WORD_SHARE) / 3
    ratio = (right + elsewhere) / (right * np.exp(-COUNT_DECREASE) + elsewhere)
    assert counted["office"] / counted["bedroom"] == pytest.approx(ratio)
    ordered = shares(home, "plant left of the bed")  # both plants of the office, no plant of the bedroom
    assert ordered["office"] / ordered["bedroom"] == pytest.approx(RELATION_SHARE / (1 - RELATION_SHARE))
    reverse = shares(home, "plant right of the bed")
    assert reverse["bedroom"] == pytest.approx(ordered["office"])
    facing = shares(home, "bathtub opposite the mirror")
    assert facing["bathroom"] > shares(home, "bathtub, mirror")["bathroom"]


def test_an_absent_object(home):
    left = shares(home, "no bathtub")
    assert left["office"] / left["bathroom"] == pytest.approx(ANSWER_SHARE / (1 - ANSWER_SHARE))


def test_the_question_splits_the_likely_places(home):
    answer = ask(home, "sofa")
    alike = ask(build({"a": {"sofa": [(1, 0)]}, "b": {"sofa": [(1, 0)], "oven": [(2, 0)]}}), "sofa")
    assert alike.question.text == "Is there an oven?"
    prior = np.array([place.probability for place in sorted(alike.places)])
    joint = np.array([[1 - ANSWER_SHARE, ANSWER_SHARE], [ANSWER_SHARE, 1 - ANSWER_SHARE]]) * prior
    conditional = -(joint * np.log(joint / joint.sum(1, keepdims=True))).sum()
    assert alike.question.expected_entropy == pytest.approx(conditional)
    assert alike.entropy == pytest.approx(-(prior * np.log(prior)).sum())
    assert answer.question.label in ("bathtub", "sink", "mirror")


def test_one_place_needs_no_question():
    answer = ask(build({"a": {"sofa": [(1, 0)], "bed": [(2, 0)]}}), "sofa")
    assert answer.question is None
    assert answer.places[0].probability == 1


def test_special_kinds_and_words_that_the_map_lacks():
    map = build({"a": {"dining table": [(1, 0)]}, "b": {"bed": [(1, 0)]}})
    assert ask(map, "table").places[0].place == "a"
    assert ask(map, "coffee table, dining table").places[0].place == "a"
    answer = ask(map, "piano, bed")
    assert answer.places[0].place == "b"
    assert "no object of the map has the label 'piano'" in answer.notes


def test_the_text_and_the_json(home):
    answer = ask(home, "red sofa, two plants left of the bed")
    lines = str(answer).splitlines()
    assert lines[0].endswith("office")
    assert lines[3].startswith("question: ")
    assert lines[-1] == "note: ignored colours, because the map does not store colours: red"
    content = answer.to_json()
    assert [place["place"] for place in content["places"]] == [place.place for place in answer.places]
    assert content["relations"] == [{"first": 1, "direction": "left of", "second": 2}]


def test_a_map_of_doorways_only_uses_them():
    assert ask(build(ROOMS, FrameKind.TRANSITION), "bathtub").places[0].place == "bathroom"


def test_a_method_without_objects_is_refused(fakes):
    map = LocalizationMap.from_descriptions(
        Reader(), [{"room": np.array([0.0])}], [ReferenceFrame("a", "a", pose_2d(0, 0, 0))]
    )
    with pytest.raises(InputMissing, match="built with the method 'reader', which stores no objects"):
        ask(map, "sofa")


def test_a_frame_without_objects_is_a_place_like_others():
    answer = ask(build({"a": {"sofa": [(1, 0)]}, "empty": {}}), "sofa")
    assert [place.place for place in answer.places] == ["a", "empty"]
    assert 0 < answer.places[1].probability < 0.5
