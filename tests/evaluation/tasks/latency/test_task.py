"""What a saved map costs, on the tiny folder, against a map that is built and weighed by hand."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tiny_folder import write_tiny_folder

import salframe
from salframe.evaluation.runs.records import Record
from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.run_folder import MethodStatus, Outcome
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.tasks.latency.rows import ProgramRow
from salframe.evaluation.tasks.latency.task import LatencyTask, _result
from salframe.framework.engines.process_pool import ProcessPool
from salframe.framework.errors import DataError, MethodFailed

SETTINGS = ("detector.kind=annotations", "detector.noise=none")


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    return write_tiny_folder(tmp_path / "tiny")


def running(folder, runs, *methods, engine="processes"):
    request = Request(methods or ("saliency-graph",), str(folder), settings=SETTINGS, engine=engine, runs=runs)
    return run_task(LatencyTask(), request, resolve(request))


def test_the_map_that_is_opened_is_the_one_that_users_build(tiny, tmp_path):
    saved = tmp_path / "map"
    built = salframe.build_map(tiny, saved, "saliency-graph", overrides=SETTINGS, topology=False)
    size = sum(file.stat().st_size for file in saved.rglob("*") if file.is_file())
    row = running(tiny, tmp_path / "runs").row("saliency-graph")
    assert row.scenes == len(built.localization.frames)
    assert row.bytes_per_scene == pytest.approx(size / row.scenes, abs=1)
    assert row.queries == len(salframe.find_dataset(tiny).folds()[0].queries)
    assert min(row.open_s, row.first_ms, row.describe_ms) > 0
    assert 0 < row.query_median_ms <= row.query_p95_ms
    (table,) = LatencyTask.tables([row])
    assert table.rows[0][:2] == ["saliency-graph[detector.noise=none]", "annotations, range"]
    assert not list((tmp_path / "runs").rglob("map-*"))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
@pytest.mark.parametrize("engine", ["inline", "processes"])
def test_memory_is_that_of_a_process_of_its_own(tiny, tmp_path, engine):
    """A few pictures and graphs, and what the first question imports."""
    row = running(tiny, tmp_path / "runs", engine=engine).row("saliency-graph")
    assert 0 <= row.opened_mb <= row.queried_mb < 400


def asked(query_ms, first=False, **given):
    costs = {"scenes": 4, "bytes": 1000, "open_s": 0.5, "status": "ok", "error": None}
    query = {"query": "query", "first": first, "describe_ms": 10.0, "query_ms": query_ms}
    return ProgramRow.model_validate({**query, **costs, **given})


def summarize(*rows):
    record = Record("m", Outcome(MethodStatus.DONE, None, ("range",)), rows, Path())
    (row,) = LatencyTask().summarize([(SimpleNamespace(pieces=rows), [record])], 0)
    return row


def test_the_first_question_of_each_process_stands_apart():
    """Two processes, whose first questions take 300 and 500 ms; of 1 to 9 ms the median is 5."""
    firsts = [asked(ms, first=True, queried_mb=mb) for ms, mb in ((300.0, 20.0), (500.0, 40.0))]
    row = summarize(
        firsts[0], *(asked(float(ms)) for ms in range(1, 5)), firsts[1], *map(asked, (5.0, 6.0, 7.0, 8.0, 9.0))
    )
    assert (row.first_ms, row.queried_mb, row.query_median_ms, row.describe_ms) == (410.0, 30.0, 5.0, 10.0)
    assert row.query_p95_ms == pytest.approx(np.percentile(np.arange(1, 10), 95))
    assert (row.scenes, row.bytes_per_scene, row.reason) == (4, 250.0, None)


def test_questions_that_failed_are_told():
    failed = ProgramRow(query="query", status="error", error="no picture")
    row = summarize(asked(300.0, first=True), asked(2.0), failed)
    assert row.reason == "1 of 3 queries failed, the first error: no picture"
    assert row.query_median_ms == 2.0


def test_a_process_that_dies_is_told_in_one_line():
    with (
        ProcessPool(1) as pool,
        pytest.raises(MethodFailed, match="the process that opened the map ended before it answered"),
    ):
        _result(pool.submit(os._exit, 3))


def test_what_cannot_save_a_map_costs_its_own_row(tiny, tmp_path):
    """`lines` needs colour, which the folder lacks once its pictures are taken away."""
    content = json.loads((tiny / "manifest.json").read_text())
    for frame in content["frames"]:
        del frame["rgb"]
    (tiny / "manifest.json").write_text(json.dumps(content))
    result = running(tiny, tmp_path / "runs", "lines", "saliency-graph")
    lines, graph = result.rows
    assert not lines.measured
    assert "needs colour images" in lines.reason
    assert graph.measured


def test_data_without_a_query_is_refused_in_one_line(tiny, tmp_path):
    content = json.loads((tiny / "manifest.json").read_text())
    content["frames"] = [frame for frame in content["frames"] if frame["role"] != "query"]
    (tiny / "manifest.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=r"has no query \(panorama to localize\), expected at least one"):
        running(tiny, tmp_path / "runs")
