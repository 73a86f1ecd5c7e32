"""Methods on panoramas without range, given a range model: answers, marks, maps, and what is said without one."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from conformance import conforms
from painted_plugin import without_range
from painted_rooms import PLAIN, write_network

from salframe.framework.components.auto import Choice
from salframe.framework.components.defaults import defaults
from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing
from salframe.localization.describing import complete_panorama, describe_frame, required_parts
from salframe.localization.map import LocalizationMap
from salframe.panoramas.geometry import pose_errors
from salframe.testing.rooms import EYE_M, map_frames, query_frames, query_truths


@pytest.fixture
def network(tmp_path) -> Path:
    return write_network(tmp_path / "depth.onnx", "z-depth", times=3.0, spread=1.0, shift=0.8)


@pytest.fixture
def options(network) -> list[str]:
    """What makes a method estimate the range."""
    chosen = {"model": network, "gives": "z-depth", "camera_height_m": EYE_M, **PLAIN}
    values = {key: list(value) if isinstance(value, tuple) else value for key, value in chosen.items()}
    return [part for key, value in values.items() for part in ("--set", f"range.{key}={value}")]


@pytest.fixture
def rooms(monkeypatch, tmp_path):
    """The painted rooms beside our own components, an empty cache, tmp_path as the working directory."""
    ours = ("annotations", "graphs", "objects", "engines", "depth", "detectors", "panoseg")
    here = Path(__file__).parent
    monkeypatch.setenv("SALFRAME_PLUGINS", ",".join(["painted_plugin", *(f"salframe_{name}" for name in ours)]))
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    paths = [str(here), str(here.parent), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    yield
    registry.cache_clear()


def localizer(network, method="saliency-graph"):
    chosen = {"model": str(network), "gives": "z-depth", "camera_height_m": EYE_M, **PLAIN}
    config = configure(
        "localizer", method, settings("localizer", method), [{"range": chosen, "detector": "annotations"}]
    )
    return registry().build("localizer", config)


def test_panoramas_without_range_are_localized_by_the_estimated_one(network):
    """Map and queries without range; then a map with the true range, of which the estimate must not differ."""
    for frames in (list(map(without_range, map_frames())), map_frames()):
        method = localizer(network)
        built = LocalizationMap.build(method, frames)
        for query in query_frames():
            answer, truth = built.localize(without_range(query)), query_truths()[query.id]
            assert answer.places[0].place == truth.place
            shift_m, turn_rad = pose_errors(answer.T_world_query, truth.T_world_pano)
            assert shift_m < 0.05
            assert np.degrees(turn_rad) < 1


def test_a_sensors_range_is_left_as_it_is(network):
    method, frame = localizer(network), query_frames()[0].load()
    assert complete_panorama(method, frame) == (frame, 0.0)
    estimated, seconds = complete_panorama(method, without_range(query_frames()[0]).load())
    assert (estimated.range_by, frame.range_by) == ("onnx-depth", None)
    assert seconds > 0
    assert np.nanmedian(np.abs(estimated.range_m / frame.range_m - 1)) < 0.01


def test_what_is_needed_follows_what_is_there(network):
    method = localizer(network)
    assert required_parts(method, frozenset({"rgb", "range", "annotations"})) == {"annotations"}
    assert required_parts(method, frozenset({"rgb", "annotations"})) == {"annotations", "rgb"}
    colourless = without_range(query_frames({"range", "rgb", "annotations"})[0])
    with pytest.raises(InputMissing, match=r"'saliency-graph' needs rgb, which .* does not have"):
        describe_frame(method, type(colourless)(colourless.id, lambda: _without_colour(colourless.load())))


def _without_colour(panorama):
    return replace(panorama, rgb=None)


@pytest.mark.parametrize("method", ["saliency-graph", "objects", "sovs"])
def test_auto_takes_a_detector_that_needs_the_range_which_the_model_gives(network, method, monkeypatch):
    monkeypatch.setitem(defaults(), "auto", {"detector": ["annotations", "panoseg"]})
    colour = Choice("photographs", lambda: frozenset({"rgb"}))
    content = settings("localizer", method)
    chosen = {"range": {"model": str(network), "metric": True}}
    assert configure("localizer", method, content, [chosen], colour).detector.kind == "panoseg"
    with pytest.raises(InputMissing, match="'panoseg': needs range images, which the data does not have"):
        configure("localizer", method, content, [], colour)


@pytest.mark.parametrize("method", ["saliency-graph", "objects"])
def test_a_localizer_with_a_range_model_conforms(network, method):
    built = localizer(network, method)
    assert conforms(type(built), built.config)


def test_table_and_report_say_that_the_range_was_estimated(rooms, options, tmp_path):
    arguments = ("compare", "--methods", "saliency-graph,objects", "--data", "painted-rooms", "--engine", "inline")
    done = run(*arguments, *options, "--json")
    rows = {row["method"]: row for row in done.json["rows"]}
    assert rows["saliency-graph"]["accuracy"] == 1.0
    assert rows["saliency-graph"]["median_translation_m"] < 0.05
    assert rows["saliency-graph"]["input"] == rows["objects"]["input"] == ["annotations", "rgb", "estimated range"]
    assert re.search(
        r"saliency-graph\[range.*\]: input annotations, colour, estimated range", run(*arguments, *options).out
    )
    report = Path(done.json["report"]).read_text()
    assert re.search(r"saliency-graph\[range.*\]: input annotations, colour, estimated range", report)


def test_a_map_remembers_its_range_model(rooms, options, network):
    made = run("build", "painted-rooms", "-o", "map", "--method", "saliency-graph", *options)
    assert made.code == 0, made.err
    found = run("localize", "map", "kitchen-query", "--data", "painted-rooms", "--json").json
    assert found["places"][0]["place"] == "kitchen"
    write_network(network, "z-depth")
    error = run("localize", "map", "kitchen-query", "--data", "painted-rooms").err
    assert "was built with other settings, weights or files" in error


def test_without_a_range_model_what_could_estimate_it_is_named(rooms, options):
    arguments = ("compare", "--methods", "saliency-graph", "--data", "painted-rooms", "--set", "detector=panoseg")
    (row,) = run(*arguments, "--engine", "inline", "--json").json["rows"]
    assert row["reason"].startswith(
        "the detector 'panoseg' of the method needs range images, which the dataset painted-rooms does not have: "
    )
    assert row["reason"].endswith(
        "estimate the range (--set range.kind=onnx-depth or --set range.kind=transformers-depth)"
    )
    (row,) = run(*arguments, "--engine", "inline", "--json", *options).json["rows"]
    assert row["input"] == ["rgb", "estimated range"]
    (row,) = run(*arguments, "--engine", "inline", "--json", "--set", "range.kind=onnx-depth").json["rows"]
    assert row["reason"] == "the range model 'onnx-depth' has no network: set `model` to the path of an ONNX file"
