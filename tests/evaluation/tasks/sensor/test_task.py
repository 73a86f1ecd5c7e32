"""Measuring a detector on the tiny folder, whose annotations are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from salframe_annotations.detector import AnnotationDetector
from tiny_folder import write_tiny_folder

from salframe.evaluation.runs.request import Request
from salframe.evaluation.studies.experiment import run_experiment
from salframe.evaluation.tasks.sensor.measurement import measure_sensor
from salframe.evaluation.tasks.sensor.rows import LookRow
from salframe.framework.errors import ConfigError, InputMissing, UnknownName
from salframe.graphs.sensor import read_sensor

PERFECT = ("detector.noise=none",)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return str(write_tiny_folder(tmp_path_factory.mktemp("tiny")))


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)


def test_a_detector_without_error_finds_all_and_errs_nowhere(tiny):
    measured = measure_sensor("annotations", [tiny], settings=PERFECT)
    sensor = measured.sensor
    whole = measured.lines[0]
    assert (whole.by, whole.detection_rate, whole.right) == ("all", 1, 1)
    assert sensor.provenance.detected == sensor.provenance.objects == whole.objects > 10
    assert all(set(row) == {label} for label, row in sensor.confusion.items())
    assert sensor.false_objects.per_panorama == 0
    assert max(sensor.errors.model_dump().values()) < 1e-6
    assert sensor.provenance.detector["settings"]["noise"] == "none"
    assert sensor.provenance.panoramas == 6  # reference frames and queries


def test_every_split_of_the_objects_adds_up_and_the_model_fits_each_line(tiny):
    measured = measure_sensor("annotations", [tiny], settings=['detector.noise={"missed": 0.4}'])
    total = measured.lines[0].objects
    for words in ("across", "away", "hidden"):
        assert sum(line.objects for line in measured.lines if words in line.by) == total
    whole = measured.lines[0]
    assert whole.modelled == pytest.approx(whole.detection_rate, abs=0.02)
    assert 0.3 < whole.detection_rate < 0.9


def test_what_a_detector_makes_up_and_calls_otherwise_is_counted(tiny, monkeypatch):
    """Each panorama gets a vase that is not there, and every second thing another name."""
    detect = AnnotationDetector.detect

    def err(self, panorama):
        found = detect(self, panorama)
        labels = [label if i % 2 else "piano" for i, label in enumerate(found.labels)]
        vase = replace(found.take([0]), labels=("vase",), centroid_m=np.array([[0, 0, 9.0]]), bearing=None)
        parts = ("scores", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr")
        joined = {part: np.concatenate([getattr(found, part), getattr(vase, part)]) for part in parts}
        return replace(found, labels=(*labels, "vase"), texts=(*found.texts, ""), points_m=None, **joined)

    monkeypatch.setattr(AnnotationDetector, "detect", err)
    sensor = measure_sensor("annotations", [tiny], settings=PERFECT, engine="inline").sensor
    assert sensor.false_objects.per_panorama == 1
    assert sensor.false_objects.labels == {"vase": 6}
    assert sensor.false_objects.range_m == (9.0,) * 11
    pianos = sum(row.get("piano", 0) for row in sensor.confusion.values())
    assert pianos >= sensor.provenance.detected / 2
    assert sensor.right_share == pytest.approx(1 - pianos / sensor.provenance.detected)


def test_the_same_command_writes_the_same_file_and_looks_at_nothing_twice(tiny, tmp_path, monkeypatch):
    arguments = ("sensor", "annotations", "--data", tiny, "--set", "detector.noise=uniform", "--engine", "inline", "-o")
    first = run(*arguments, tmp_path / "first.json")
    assert first.code == 0, first.err
    assert "detected %" in first.out
    assert "false positives: 0.0 per panorama" in first.out
    monkeypatch.setattr(AnnotationDetector, "detect", lambda self, panorama: pytest.fail("looked again"))
    assert run(*arguments, tmp_path / "second.json").code == 0
    assert (tmp_path / "first.json").read_bytes() == (tmp_path / "second.json").read_bytes()
    told = run(*arguments[:-1], "--json").json
    assert told["sensor"] == json.loads((tmp_path / "first.json").read_text())
    monkeypatch.undo()
    assert read_sensor(tmp_path / "first.json").provenance.objects == told["lines"][0]["objects"]


def test_a_measured_file_is_noise_that_the_detector_takes(tiny, tmp_path):
    """What is measured of the noise again is what it was drawn from: 40 % missed, within four standard errors."""
    path = tmp_path / "sensor.json"
    measured = measure_sensor("annotations", [tiny], settings=['detector.noise={"missed": 0.4}'])
    measured.write(path)
    again = measure_sensor("annotations", [tiny], settings=[f"detector.noise={path}"])
    count = measured.lines[0].objects
    assert again.lines[0].detection_rate == pytest.approx(
        measured.lines[0].detection_rate, abs=4 * np.sqrt(0.5 / count)
    )


def test_data_sets_and_seeds_are_pooled_and_named(tiny, tmp_path):
    """A folder twice, under two names; and an office whose seeds are seen in the names."""
    other = write_tiny_folder(tmp_path / "other")
    one = measure_sensor("annotations", [tiny], settings=PERFECT)
    both = measure_sensor("annotations", [tiny, str(other)], settings=PERFECT)
    assert both.lines[0].objects == 2 * one.lines[0].objects
    assert list(both.sensor.provenance.data) == [Path(tiny).name, "other"]
    given = ("data.rgb=false", "data.height=64", "data.rooms=4", "data.queries_per_room=0", *PERFECT)
    seeded = measure_sensor("annotations", ["house-6"], settings=given, seeds=(1, 2)).sensor.provenance
    assert list(seeded.data) == ["house-6 seed 1", "house-6 seed 2"]
    assert [known["settings"]["seed"] for known in seeded.data.values()] == [1, 2]


def test_panoramas_that_cannot_be_read_are_left_out_and_told(tmp_path):
    folder = write_tiny_folder(tmp_path / "data")
    (folder / "frames" / "lounge-query.range.png").write_bytes(b"no image")
    measured = measure_sensor("annotations", [str(folder)], settings=PERFECT)
    assert measured.sensor.provenance.panoramas == 5
    assert len(measured.notes) == 1
    assert measured.notes[0].startswith("1 panorama left out, the first error: ")


def test_an_experiment_pools_seeds_as_one_measurement_of_both(tmp_path):
    """And draws what it keeps as what it measured."""
    rooms = {"data.rgb": False, "data.height": 64, "data.rooms": 4, "data.queries_per_room": 0}
    blind = {"noise": {"missed": 0.4}, "seed": 3}
    settings = [f"{key}={json.dumps(value)}" for key, value in rooms.items()]
    both = measure_sensor(
        "annotations",
        ["house-6"],
        settings=(*settings, 'detector.noise={"missed": 0.4}', "detector.seed=3"),
        seeds=(1, 2),
    )
    study = {
        "title": "Two homes",
        "task": "sensor",
        "data": "house-6",
        "seeds": [1, 2],
        "set": rooms,
        "methods": {"half blind": {"method": "annotations", "set": blind}},
    }
    file = tmp_path / "sensor.yaml"
    file.write_text(json.dumps({"title": "Sensor", "question": "?", "tables": {"homes": study}}))
    table = run_experiment(file, Request(), results=tmp_path / "results").tables[0]
    (row,) = table.stored.rows
    lines = {line.by: line for line in both.lines}
    assert row["objects"] == lines["all"].objects == both.sensor.provenance.objects
    assert row["panoramas"] == both.sensor.provenance.panoramas
    assert row["false_per_panorama"] == 0
    for name, line in row["lines"].items():
        assert (line["objects"], line["detection_rate"]) == (
            lines[name].objects,
            pytest.approx(lines[name].detection_rate, abs=1e-5),
        )
    assert 0 < row["detection_rate_low"] < row["detection_rate"] < row["detection_rate_high"] < 1
    again = run_experiment(file, Request(), results=tmp_path / "results").tables[0]
    assert again.fresh is None
    assert [drawn.rows for drawn in again.tables()] == [drawn.rows for drawn in table.fresh.tables()]
    assert [drawn.rows[0][0] for drawn in again.tables()] == ["half blind"] * 2


def test_what_a_detector_fails_on_counts_as_not_found_and_is_told(tiny, monkeypatch):
    detect = AnnotationDetector.detect

    def fail(self, panorama):
        if panorama.id == "kitchen-query":
            raise RuntimeError("no light")
        return detect(self, panorama)

    whole = measure_sensor("annotations", [tiny], settings=PERFECT, engine="inline", runs="light")
    monkeypatch.setattr(AnnotationDetector, "detect", fail)
    measured = measure_sensor("annotations", [tiny], settings=PERFECT, engine="inline", runs="dark")
    assert measured.lines[0].objects == whole.lines[0].objects
    assert measured.lines[0].detection_rate < 1 == whole.lines[0].detection_rate
    assert measured.crashed
    assert not whole.crashed
    (note,) = measured.notes
    assert note == (
        "1 panorama with an error of the detector (the objects count as missed), "
        "the first error: RuntimeError: no light"
    )
    told = run("sensor", "annotations", "--data", tiny, "--set", "detector.noise=none", "--engine", "inline")
    assert told.code == 1


def test_several_workers_measure_the_same(tiny):
    noisy = ("detector.noise=panoseg",)
    alone = measure_sensor("annotations", [tiny], settings=noisy, runs="alone")
    shared = measure_sensor("annotations", [tiny], settings=(*noisy, "engine.workers=2"), runs="shared")
    assert alone.to_json() == shared.to_json()


def test_a_look_that_was_kept_in_part_is_refused():
    nothing = {
        name: [] for name in ("labels", "scores", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr")
    }
    row = {
        "frame": "a",
        "status": "ok",
        "error": None,
        "truth": nothing,
        "detections": nothing,
        "range_m": [],
        "hidden_share": [],
    }
    LookRow.model_validate(row)
    for part, wrong in (("truth", None), ("detections", {**nothing, "labels": ["vase"]}), ("range_m", [1.0])):
        with pytest.raises(ValueError, match="expected"):
            LookRow.model_validate({**row, part: wrong})


def test_what_cannot_be_measured_is_told_in_one_line(tiny, tmp_path):
    bare = write_tiny_folder(tmp_path / "bare")
    content = json.loads((bare / "manifest.json").read_text())
    for frame in content["frames"]:
        del frame["range"]
    (bare / "manifest.json").write_text(json.dumps(content))
    with pytest.raises(
        InputMissing,
        match="the task 'sensor' needs annotations and range images, but the dataset folder does not have range ",
    ):
        measure_sensor("annotations", [str(bare)])
    with pytest.raises(UnknownName, match=r"unknown detector 'panosec'.* did you mean 'panoseg'"):
        measure_sensor("panosec", [tiny])
    with pytest.raises(ConfigError, match=r"unknown setting noisy, did you mean 'noise'"):
        measure_sensor("annotations", [tiny], settings=["noisy=none"])
    with pytest.raises(ConfigError, match=r"received the dataset 'tiny\d*' twice"):
        measure_sensor("annotations", [tiny, tiny])
    told = run("sensor", "annotations", "--data", tiny, "--seeds", "1,x")
    assert (told.code, told.err) == (
        2,
        "error: received --seeds 'x', expected an integer from 0 to 9223372036854775807\n",
    )
    assert run("sensor", "annotations", "--data", tiny, "--seeds", "1").code == 2  # a folder has no seed
