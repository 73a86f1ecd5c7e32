from __future__ import annotations

import base64
import json

import cv2
import numpy as np
import pytest

from salframe.evaluation.finished_runs import write_report
from salframe.evaluation.report.page import as_json, numbers
from salframe.evaluation.tasks.localization.pictures import draw_panorama
from salframe.panoramas.panorama import Panorama


@pytest.fixture
def page(odd, tmp_path, read):
    return read(write_report(odd[:1], tmp_path / "page.html").path)


def test_objects_and_pairs_of_a_query_and_its_map_frame(page):
    islands = page[1]
    query = json.loads(islands["q0-0"])
    (objects,) = query["objects"].values()
    assert objects["labels"] == ["<i>lamp</i>", "table"]
    assert objects["box"][0] == [1.5, 1.0, 0.5, 0.4, 0.4, 0.4, 0.0]
    assert objects["saliency"] == [0.75, 0.25]
    (reference,) = query["arms"]["0"]["references"]
    assert reference == {"kind": "answer", "frame": 0, "pairs": [[0, 0], [1, 1]]}
    frame = json.loads(islands["f0-0"])
    assert (frame["id"], frame["place"], frame["pose"]) == ("map <0>", "<!--<script>", [0.0, 0.0, 0.0])


def test_a_wrong_answer_is_shown_beside_the_true_place(page):
    references = json.loads(page[1]["q0-1"])["arms"]["0"]["references"]
    assert [reference["kind"] for reference in references] == ["answer", "truth"]
    frames = [json.loads(page[1][f"f0-{reference['frame']}"])["id"] for reference in references]
    assert frames == ["map <0>", "map <1>"]


def test_what_a_score_is_made_of(page):
    """Room 1 is taken for room 0: apart from it 0 and 1, so near 4 and 3, far 0 and 0.5, by weights 2 and -1."""
    evidence = json.loads(page[1]["q0-1"])["arms"]["0"]["evidence"]
    assert evidence["parts"] == ["near", "far"]
    assert evidence["weights"] == [2.0, -1.0]
    answer, truth = evidence["places"]
    assert (answer["values"], answer["score"]) == ([4.0, 0.0], 8.0)
    assert (truth["values"], truth["score"]) == ([3.0, 0.5], 5.5)
    assert truth["place"] == "</script><img src=x onerror=alert(1)>"


def test_the_runner_up_stands_beside_a_right_answer(page):
    evidence = json.loads(page[1]["q0-0"])["arms"]["0"]["evidence"]
    assert [place["score"] for place in evidence["places"]] == [8.0, 5.5]


def decode(url):
    kind, _, code = url.partition(",")
    return kind, cv2.imdecode(np.frombuffer(base64.b64decode(code), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def test_thumbnails_are_small_and_whole_panoramas_are_not():
    rgb = np.zeros((320, 640, 3), np.uint8)
    rgb[:, 320:] = (200, 100, 40)
    kind, small = decode(draw_panorama(Panorama("p", rgb), full=False))
    assert kind == "data:image/webp;base64"
    assert small.shape == (256, 512, 3)
    assert small[128, 400].astype(int) == pytest.approx([200, 100, 40], abs=8)
    assert decode(draw_panorama(Panorama("p", rgb), full=True))[1].shape == (320, 640, 3)


def test_a_panorama_without_colour_is_drawn_by_its_range():
    range_m = np.full((32, 64), 8.0, np.float32)
    range_m[:, :32] = 0.5
    _, drawn = decode(draw_panorama(Panorama("p", range_m=range_m), full=True))
    assert drawn[16, 8].mean() > drawn[16, 56].mean() + 100


def test_what_was_not_seen_is_grey():
    valid = np.ones((32, 64), bool)
    valid[:, :32] = False
    _, drawn = decode(draw_panorama(Panorama("p", np.zeros((32, 64, 3), np.uint8), valid=valid), full=True))
    assert drawn[16, 8].astype(int) == pytest.approx([128] * 3, abs=4)


def test_json_ends_no_script():
    value = {"</script>": "<!--<script>", "x": [1, None]}
    text = as_json(value)
    assert "<" not in text
    assert json.loads(text) == value
    assert numbers(np.array([[1.23456, np.nan], [np.inf, 0]]), 2) == [[1.23, None], [None, 0.0]]
