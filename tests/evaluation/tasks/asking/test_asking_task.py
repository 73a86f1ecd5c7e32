"""The task `asking`: descriptions of the objects around a query, and the rank of its room."""

from __future__ import annotations

import json

import numpy as np
import pytest

from salframe.evaluation.runs.request import Request
from salframe.evaluation.studies.study import Study, run_study
from salframe.evaluation.tasks.asking.describing import describe_in_words
from salframe.framework.validation import validate
from salframe.graphs.detections import Detections
from salframe.localization.text_query import Direction, read_text

PLACES = {"sofa": [(2, 0)], "plant": [(0, 2), (0, 4)], "bed": [(-2, 0.1)], "lamp": [(1, -1)]}


def objects() -> Detections:
    labels = [label for label, places in PLACES.items() for _ in places]
    centroid_m = np.array([(x, y, 0.0) for places in PLACES.values() for x, y in places])
    n = len(labels)
    return Detections(tuple(labels), np.ones(n), centroid_m, np.full((n, 3), 0.5), np.zeros(n))


@pytest.mark.parametrize("seed", range(8))
def test_descriptions_are_read_as_they_were_meant(seed):
    text = describe_in_words(objects(), ["oven"], 4, 0.0, np.random.default_rng(seed))
    query = read_text(text, list(PLACES))
    assert sorted(mention.label for mention in query.mentions) == sorted(PLACES)
    assert {mention.label: mention.count for mention in query.mentions} == {
        label: len(places) if len(places) > 1 else None for label, places in PLACES.items()
    }
    assert [(relation.first, relation.second) for relation in query.relations] == [(0, 1), (2, 3)]
    for relation in query.relations:
        first, second = (query.mentions[number].label for number in (relation.first, relation.second))
        azimuth_deg = [np.degrees(np.arctan2(*PLACES[label][0][::-1])) for label in (first, second)]
        left_deg = (azimuth_deg[0] - azimuth_deg[1] + 180) % 360 - 180
        expected = Direction.LEFT if left_deg > 0 else Direction.RIGHT
        assert relation.direction is (Direction.OPPOSITE if abs(left_deg) >= 120 else expected)


def test_wrong_words_have_their_share():
    rng = np.random.default_rng(0)
    texts = [describe_in_words(objects(), ["oven"], 3, 0.3, rng) for _ in range(500)]
    assert sum(text.count("oven") for text in texts) / 1500 == pytest.approx(0.3, abs=0.04)


def test_too_few_labels_have_no_description():
    assert describe_in_words(objects(), ["oven"], 5, 0.0, np.random.default_rng(0)) is None


def test_descriptions_of_a_home_find_its_rooms():
    settings = {"data.height": 128, "data.queries_per_room": 1, "data.rgb": False, "detector.noise": "none"}
    content = {"task": "asking", "data": "house-6", "methods": ["proposed"], "set": settings, "labels": [3, 40]}
    with pytest.raises(Exception, match="less than or equal to 20"):
        validate(Study, content, "study")
    study = validate(Study, {**content, "labels": [3, 20], "wrong_share": 0.0}, "study")
    result = run_study(study, Request(engine="inline", name="words"))
    three, twenty = result.rows
    assert [row["labels"] for row in result.settings] == [3, 20]
    assert three.chance1 == pytest.approx(1 / 6)
    assert three.top5.value >= three.top1.value > 2 * three.chance1
    assert (twenty.descriptions, twenty.measured) == (0, False)
    lines = (result.runs[0] / "methods" / "proposed" / "rows.jsonl").read_text().splitlines()
    for row in map(json.loads, lines):
        assert row["text"] is None or 1 <= row["rank"] <= 6
