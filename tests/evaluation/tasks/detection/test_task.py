from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import run
from salframe_annotations.detector import AnnotationDetector
from tiny_folder import write_tiny_folder

from salframe.evaluation.runs.request import Request
from salframe.evaluation.studies.experiment import run_experiment
from salframe.evaluation.tasks.detection.judging import count_right
from salframe.evaluation.tasks.detection.task import measure_detection
from salframe.framework.errors import ConfigError
from salframe.graphs.boxes import detections_from_points


def cubes(*objects: tuple[str, tuple[float, float, float]]):
    corners = np.array(np.meshgrid([-0.1, 0.1], [-0.1, 0.1], [-0.1, 0.1])).reshape(3, 8).T
    return detections_from_points(
        [label for label, _ in objects], np.ones(len(objects)), [corners + centre for _, centre in objects]
    )


def test_a_detection_is_right_near_an_annotated_object_of_its_label_and_each_counts_once():
    truth = cubes(("chair", (1, 0, 0)), ("chair", (2, 0, 0)), ("table", (3, 0, 0)))
    found = cubes(("chair", (1.25, 0, 0)), ("chair", (0.9, 0, 0)), ("sofa", (3, 0, 0)), ("table", (3, 0.35, 0)))
    assert count_right(found, truth) == {"chair": 1}  # both chairs are near the first: one is right
    assert count_right(truth, truth) == {"chair": 2, "table": 1}


def test_an_unknown_centroid_is_right_nowhere():
    truth = cubes(("chair", (1, 0, 0)))
    blind = type(truth)(truth.labels, truth.scores, np.full((1, 3), np.nan), truth.size_m, truth.yaw_rad)
    assert count_right(blind, truth) == {}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return write_tiny_folder(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)


def measure(data, *settings, **given):
    return measure_detection(Request(("annotations",), str(data), settings=settings, engine="inline", **given))


def test_annotations_without_error_are_all_right_and_with_error_as_many_as_the_noise_leaves(tiny):
    """Noise that misses a share m of the objects leaves a recall of 1 - m, and a precision of 1."""
    (perfect,) = measure(tiny, "annotations.noise=none").rows
    assert perfect.overall.precision == perfect.overall.recall == 1
    assert perfect.overall.annotated == sum(counts.annotated for counts in perfect.classes.values()) > 0
    (half,) = measure(tiny, 'annotations.noise={"missed": 0.5}').rows
    assert half.overall.precision == 1
    assert half.overall.annotated == perfect.overall.annotated
    assert half.overall.recall == half.overall.detections / half.overall.annotated < 1
    assert 0 <= half.recall.low <= half.overall.recall <= half.recall.high < 1
    assert (perfect.recall.low, perfect.recall.high) == (half.precision.low, half.precision.high) == (1, 1)
    assert half.ms > 0


def test_the_command_prints_what_is_measured_and_a_wrong_setting_is_one_line(tiny):
    result = run("detection", "--detectors", "annotations", "--data", str(tiny), "--classes")
    assert result.code == 0
    assert "precision %" in result.out
    with pytest.raises(ConfigError, match=r"unknown setting noize, did you mean 'noise'"):
        measure(tiny, "noize=none")


def test_detection_resumes(tiny, monkeypatch):
    result = measure(tiny)
    path = result.run / "methods" / "annotations" / "rows.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(lines[0] + lines[1][:20])
    looked = []
    detect = AnnotationDetector.detect

    def spy(self, panorama):
        looked.append(panorama.id)
        return detect(self, panorama)

    monkeypatch.setattr(AnnotationDetector, "detect", spy)
    again = measure(tiny)
    assert again.run == result.run
    assert sorted(set(looked)) == sorted(json.loads(line)["query"] for line in lines[1:])
    assert again.rows[0].overall == result.rows[0].overall
    looked.clear()
    assert measure(tiny).rows == again.rows
    assert looked == []


def test_what_a_crash_had_to_find_was_not_found(tiny, monkeypatch):
    whole = measure(tiny).rows[0].overall
    detect = AnnotationDetector.detect

    def stumble(self, panorama):
        if panorama.id == "lounge-query":
            raise ValueError("too much")
        return detect(self, panorama)

    monkeypatch.setattr(AnnotationDetector, "detect", stumble)
    row = measure(tiny, runs=tiny.parent / "other").rows[0]
    assert (row.status, row.crashed) == ({"ok": 2, "crashed": 1}, True)
    assert row.overall.annotated == whole.annotated
    assert 0 < row.overall.detections < whole.detections
    assert row.overall.recall == row.overall.right / whole.annotated < 1


def test_a_detector_that_exits_costs_its_own_row(tiny, monkeypatch):
    monkeypatch.setattr(AnnotationDetector, "detect", lambda self, panorama: sys.exit("it leaves"))
    result = measure(tiny)
    assert (result.rows[0].reason, result.rows[0].measured) == ("SystemExit: it leaves", False)
    assert result.crashed


@pytest.mark.parametrize("answer", [None, {"labels": ("chair",)}])
def test_what_is_no_detections_costs_the_detector_its_row(tiny, monkeypatch, answer):
    monkeypatch.setattr(AnnotationDetector, "detect", lambda self, panorama: answer)
    result = measure(tiny)
    assert (
        result.rows[0].reason
        == f"the function `detect` of the detector returned {type(answer).__name__}, expected Detections"
    )
    assert result.crashed


def test_labels_of_detector_and_truth_are_compared_in_common_words(tiny, monkeypatch):
    """A detector that calls a tv a television, and a sofa a couch, finds as much as one that speaks as the data do."""
    plain = measure(tiny, "annotations.noise=none").rows[0]
    synonyms = {"tv": "television set", "sofa": "couch", "table": "dining table"}
    detect = AnnotationDetector.detect

    def translate(self, panorama):
        found = detect(self, panorama)
        return replace(found, labels=tuple(synonyms.get(label, label) for label in found.labels))

    monkeypatch.setattr(AnnotationDetector, "detect", translate)
    result = measure(tiny, "annotations.noise=none", runs=tiny.parent / "translated")
    (row,) = result.rows
    assert row.overall == plain.overall
    assert row.overall.precision == row.overall.recall == 1
    assert {"couch": "sofa"}.items() <= row.joined.items()
    assert "couch" not in row.classes
    told = run("evaluate", result.run).out
    assert re.search(r"labels with one name in the shared vocabulary: .*couch = sofa", told), told


def test_a_study_of_detectors_is_kept_with_its_precision_and_recall(tiny):
    methods = {"perfect": {"method": "annotations", "set": {"noise": "none"}}}
    methods["half"] = {"method": "annotations", "set": {"noise": {"missed": 0.5}}}
    table = {"title": "Detectors", "task": "detection", "data": str(tiny), "methods": methods}
    experiment = {"title": "Finds", "question": "?", "tables": {"tiny": table}}
    Path("finds.yaml").write_text(yaml.safe_dump(experiment, sort_keys=False))
    request = Request(engine="inline")
    for result in (run_experiment("finds.yaml", request, results="kept") for _ in range(2)):  # measured, then read
        (drawn,) = result.tables[0].tables()
        told = [dict(zip(drawn.headings, row, strict=True)) for row in drawn.rows]
        (half,) = measure(tiny, 'annotations.noise={"missed": 0.5}').rows
        recalls = [row["recall %\n(95 % CI)"].split() for row in told]
        assert [recall for recall, _ in recalls] == ["100.0", f"{100 * half.overall.recall:.1f}"]
        assert [int(row["correct"]) for row in told] == [half.overall.annotated, half.overall.right]
