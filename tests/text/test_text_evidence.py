"""The edit distance, and the log likelihood ratio of strings in closed form with its bound."""

import numpy as np
import pytest
from conformance import conforms
from salframe_text.evidence import ALPHABET, TextEvidence

from salframe.framework.components.presets import configure
from salframe.localization.evidence_model import PlaceFrames, PlaceHypotheses

E, U = 0.03, 0.35


def evidence_of(places: list[list[str]], **settings) -> TextEvidence:
    """Evidence of a map with one frame per place, whose graph has these texts."""
    evidence = TextEvidence(configure("evidence", "text", settings))
    count = len(places)
    frames = PlaceFrames([f"room {i}" for i in range(count)], np.arange(count), np.arange(count), np.arange(count + 1))
    evidence.index([described(evidence, texts) for texts in places], frames, np.zeros((count, 3, 4)))
    return evidence


def described(evidence: TextEvidence, texts: list[str]) -> dict[str, np.ndarray]:
    return evidence.describe(None, {"texts": np.array(texts, np.str_)})


def score(evidence: TextEvidence, texts: list[str], count: int) -> np.ndarray:
    hypotheses = PlaceHypotheses(np.arange(count), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(count))
    return evidence.score(described(evidence, texts), hypotheses)["text"]


def test_the_ratio_is_that_of_the_documented_model():
    evidence = evidence_of([["3.14"], ["3.15"], []])
    exact, one_off = (1 - E) ** 4, (1 - E) ** 3 * E / ALPHABET
    mean = (exact + one_off) / 2
    other = U * (mean + ALPHABET**-4.0) / 2
    random_place = (1 - U) * mean + other
    expected = [np.log(((1 - U) * of + other) / random_place) for of in (exact, one_off)] + [0.0]
    np.testing.assert_allclose(score(evidence, ["3.14"], 3), expected, rtol=1e-9)


def test_rare_strings_count_more_than_common_ones():
    places = [["EXIT", f"R{i}{i}"] for i in range(20)]
    values = score(evidence_of(places), ["EXIT"], 20)
    np.testing.assert_allclose(values, 0, atol=0.01)
    rare = score(evidence_of(places), ["R77"], 20)
    assert rare.argmax() == 7
    assert rare[7] > 2
    assert np.delete(rare, 7).max() < 0


def test_a_misread_character_still_supports_the_right_place_and_spaces_and_case_do_not_matter():
    evidence = evidence_of([["Kitchen 4"], ["Seminar 5"], ["Library 6"]])
    assert score(evidence, ["kitchon4"], 3).argmax() == 0
    np.testing.assert_array_equal(score(evidence, ["KITCHEN4"], 3), score(evidence, ["Kitchen 4"], 3))


def test_wrong_signs_never_exceed_the_bound_and_cost_the_true_place_little():
    places = [[f"{i:04d}x{j}" for j in range(3)] for i in range(200)]
    evidence = evidence_of(places, max_nats=3.0)
    wrong = score(evidence, places[17], 200)
    assert wrong.max() == 3.0 == wrong[17]
    one = score(evidence, places[17][:1], 200)
    assert one[5] == pytest.approx(np.log(U / 2 / (1 - U / 2)), abs=1e-3)
    many = score(evidence, [text for place in places[:50] for text in place], 200)
    assert many.min() >= -3.0


def test_an_unknown_string_and_no_string_say_nothing():
    evidence = evidence_of([["3.14"], ["3.15"]])
    np.testing.assert_array_equal(score(evidence, [], 2), 0)
    values = score(evidence, ["completely else"], 2)
    assert np.ptp(values) < 1e-9
    np.testing.assert_array_equal(score(evidence_of([[], []]), ["3.14"], 2), 0)


def test_views_are_joined_and_equal_strings_count_once():
    evidence = evidence_of([["3.14"]])
    first, second = described(evidence, ["3.14", ""]), described(evidence, ["Lab", "3.14"])
    joined = evidence.join([first, second], np.zeros((2, 4, 4)))
    assert joined["strings"].tolist() == ["3.14", "lab"]
    assert evidence.join([{}, {}], np.zeros((2, 4, 4))) == {}


def test_the_component_conforms():
    assert conforms(TextEvidence)
