"""Signs at known places, read by the networks of RapidOCR."""

from dataclasses import replace

import numpy as np
import pytest
from salframe_detectors.union import unite
from salframe_text.detector import TextDetector
from signs import WALL_M, with_signs

from salframe.framework.components.presets import configure
from salframe.framework.errors import ConfigError, InputMissing
from salframe.graphs.annotated import annotated_detections
from salframe.graphs.graph import GraphConfig, build_graph
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays, pack_graph, unpack_graph
from salframe.panoramas.panorama import Annotations, Panorama

pytest.importorskip("rapidocr")

SIGNS = {20.0: "3.14", 175.0: "Office 7"}


@pytest.fixture(scope="module")
def detector():
    return TextDetector()


@pytest.fixture(scope="module")
def detections(detector):
    return detector.detect(with_signs(SIGNS))


def test_each_sign_is_read_once_at_its_bearing_and_range(detections):
    assert sorted(detections.texts) == ["3.14", "Office 7"]
    assert detections.labels == ("text", "text")
    for azimuth, text in SIGNS.items():
        i = detections.texts.index(text)
        expected = WALL_M * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0])
        np.testing.assert_allclose(detections.centroid_m[i], expected, atol=0.1)
        assert detections.bearing[i] @ expected / WALL_M > np.cos(np.radians(1.5))


def test_the_string_is_as_wide_as_its_letters(detections):
    i = detections.texts.index("3.14")
    # 150 px letters on a plate of 800 px and 1.32 m: the string is 0.5 m long, and the network adds a margin
    assert 0.35 < detections.size_m[i][0] < 0.75
    assert 0.1 < detections.size_m[i][2] < 0.4


def test_without_range_the_bearing_is_known(detector):
    detections = detector.detect(with_signs({-60.0: "B12"}, range_m=False))
    assert detections.texts == ("B12",)
    assert np.isnan(detections.centroid_m).all()
    azimuth = np.degrees(np.arctan2(detections.bearing[0, 1], detections.bearing[0, 0]))
    assert azimuth == pytest.approx(-60, abs=1.5)


def test_a_plain_wall_has_no_text_and_colour_is_needed(detector):
    assert len(detector.detect(with_signs({}))) == 0
    with pytest.raises(InputMissing, match="signs has no colour image, which the detector 'text' needs"):
        detector.detect(replace(with_signs({}), rgb=None))


def test_min_length_and_min_score_leave_strings_out():
    settings = {"min_length": 5, "views": 5}
    longer = TextDetector(configure("detector", "text", settings)).detect(with_signs(SIGNS))
    assert longer.texts == ("Office 7",)
    with pytest.raises(
        ConfigError, match=r"views=4 and fov_deg=80, which together cover 320 deg, expected at least 360"
    ):
        configure("detector", "text", {"views": 4})
    assert len(TextDetector(configure("detector", "text", {"min_score": 1.0})).detect(with_signs({20.0: "3.14"}))) == 0


def test_the_string_stays_in_the_packed_graph(detections):
    graph = build_graph(detections, np.array([0.4, 0.6]), GraphConfig())
    assert graph.texts == (detections.texts[1], detections.texts[0])
    packed = pack_graph(graph_to_arrays(graph))
    assert graph_from_arrays(unpack_graph(packed)).texts == graph.texts


def test_a_union_keeps_the_strings_of_text_and_the_objects_of_another_detector(detections):
    chair = annotated_detections(annotated_room())
    united = unite([detections, chair])
    assert sorted(zip(united.labels, united.texts, strict=True)) == [
        ("chair", ""),
        ("text", "3.14"),
        ("text", "EXIT"),
        ("text", "Office 7"),
    ]


def test_an_annotated_label_can_state_the_text_of_a_sign():
    detected = annotated_detections(annotated_room())
    assert detected.labels == ("chair", "text")
    assert detected.texts == ("", "EXIT")
    assert annotated_room().annotations.vocabulary == ("chair", "text")


def annotated_room() -> Panorama:
    """A chair and a sign with the text EXIT, 2 m away."""
    instance_id = np.zeros((64, 128), np.int32)
    instance_id[30:40, 20:30], instance_id[20:28, 80:100] = 1, 2
    labels = {1: "chair", 2: "text: EXIT"}
    return Panorama("room", range_m=np.full((64, 128), 2.0, np.float32), annotations=Annotations(instance_id, labels))
