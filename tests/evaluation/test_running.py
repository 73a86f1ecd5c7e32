"""What a saved map costs, on the tiny folder, against a map that is built and weighed by hand."""

from __future__ import annotations

import json

import pytest
from tiny_folder import write_tiny_folder

import salframe
from salframe.evaluation.request import Request, resolve
from salframe.evaluation.runner import run_task
from salframe.evaluation.running import RunningTask
from salframe.evaluation.tables import tables_of
from salframe.framework.errors import DataError

SETTINGS = ("detector.kind=annotations", "detector.noise=none")


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    return write_tiny_folder(tmp_path / "tiny")


def running(folder, runs, *methods, engine="processes"):
    request = Request(methods or ("saliency-graph",), str(folder), settings=SETTINGS, engine=engine, runs=runs)
    return run_task(RunningTask(), request, resolve(request))


def test_the_map_that_is_opened_is_the_one_that_users_build(tiny, tmp_path):
    saved = tmp_path / "map"
    built = salframe.build_map(tiny, saved, "saliency-graph", overrides=SETTINGS)
    size = sum(file.stat().st_size for file in saved.rglob("*") if file.is_file())
    row = running(tiny, tmp_path / "runs").row("saliency-graph")
    assert row.scenes == len(built.mapped_frames)
    assert row.bytes_per_scene == pytest.approx(size / row.scenes, abs=1)
    assert row.queries == len(salframe.find_dataset(tiny).folds()[0].queries)
    assert min(row.open_s, row.first_ms, row.describe_ms, row.query_median_ms) > 0
    assert row.query_median_ms <= row.query_p95_ms
    assert row.asked_mb is None or row.asked_mb < 1000
    (table,) = tables_of("running", [row])
    assert table.rows[0][:2] == ["saliency-graph", "annotations, range"]
    assert not list((tmp_path / "runs").rglob("map-*"))


def test_a_process_that_is_shared_tells_no_memory(tiny, tmp_path):
    row = running(tiny, tmp_path / "runs", engine="inline").row("saliency-graph")
    assert (row.opened_mb, row.asked_mb) == (None, None)
    assert row.measured


def test_what_cannot_save_a_map_costs_its_own_row(tiny, tmp_path):
    """`lines` needs colour, which the folder lacks once its pictures are taken away."""
    content = json.loads((tiny / "manifest.json").read_text())
    for frame in content["frames"]:
        del frame["rgb"]
    (tiny / "manifest.json").write_text(json.dumps(content))
    result = running(tiny, tmp_path / "runs", "lines", "saliency-graph")
    lines, graph = result.rows
    assert not lines.measured
    assert "needs rgb" in lines.reason
    assert graph.measured


def test_data_without_a_query_is_refused_in_one_line(tiny, tmp_path):
    content = json.loads((tiny / "manifest.json").read_text())
    content["frames"] = [frame for frame in content["frames"] if frame["role"] != "query"]
    (tiny / "manifest.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match="has no query, expected at least one"):
        running(tiny, tmp_path / "runs")
