"""Measuring runs of every task again from their rows."""

from __future__ import annotations

import json

import pytest
from command_line import run as salframe

from salframe.evaluation.finished_runs import evaluate
from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.detection.task import measure_detection
from salframe.evaluation.tasks.localization.task import compare
from salframe.evaluation.tasks.matching.task import measure_matching
from salframe.evaluation.tasks.navigation.options import Positioning
from salframe.evaluation.tasks.navigation.task import navigate
from salframe.framework.errors import ConfigError, DataError


def refuse(*_: object) -> None:
    raise AssertionError("a method was built")


def check_again(result, monkeypatch, component: str) -> None:
    """That a result is measured again alike where none of its methods can be built, in Python and on the command
    line."""
    metrics = {path: path.read_text() for path in result.run.glob("methods/*/metrics.json")}
    for path in metrics:
        path.unlink()
    monkeypatch.setattr(f"{component}.__init__", refuse)
    again = evaluate(result.run)
    assert (again.task, again.rows, again.notes) == (result.task, result.rows, result.notes)
    assert {path: path.read_text() for path in result.run.glob("methods/*/metrics.json")} == metrics
    printed = salframe("evaluate", result.run)
    assert printed.code == 0
    assert all(row.method in printed.out for row in result.rows)
    assert salframe("evaluate", result.run, "--json").json == json.loads(json.dumps(again.to_json()))


def test_a_comparison_is_measured_again(fakes, monkeypatch):
    request = Request(("reader", "weightless"), "rooms", settings=("wrong_from=3",), engine="inline")
    check_again(compare(request), monkeypatch, "fake_plugin.Reader")


def test_a_matching_run_is_measured_again(furnished, monkeypatch):
    request = Request(("points", "nodes"), "furnished", settings=("data.unmapped=true",), engine="inline")
    check_again(measure_matching(request), monkeypatch, "matching_plugin.Points")


def test_a_detection_run_is_measured_again(furnished, monkeypatch):
    request = Request(("annotations",), "furnished", engine="inline")
    detector = "salframe_annotations.detector.AnnotationDetector"
    check_again(measure_detection(request), monkeypatch, detector)


def test_a_navigation_run_is_measured_again(apartment, monkeypatch):
    request = Request(("seer",), "apartment", settings=("navigation.budget=9",), seed=3, engine="inline")
    result = navigate(request, episodes=3, positioning=Positioning.BOTH)
    check_again(result, monkeypatch, "apartment_plugin.Seer")


def test_a_run_on_data_that_changed_is_not_measured(fakes, monkeypatch):
    result = compare(Request(("reader",), "rooms", engine="inline"))
    monkeypatch.setenv("ROOMS_CONTENT", "other")
    with pytest.raises(DataError, match="has changed since the run began"):
        evaluate(result.run)


def test_a_run_of_an_unknown_task_is_told(fakes):
    result = compare(Request(("reader",), "rooms", engine="inline"))
    path = result.run / "request.yaml"
    path.write_text(path.read_text().replace("name: localization", "name: levitation"))
    with pytest.raises(ConfigError, match="has the task 'levitation', expected one of localization, matching"):
        evaluate(result.run)
