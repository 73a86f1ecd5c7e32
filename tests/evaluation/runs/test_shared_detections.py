"""Methods of a run share the detections of a panorama. `Rooms` has R reference frames and 2 R queries."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from counting_plugin import DELAY_S, LABELS, LOG

from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.tasks.latency.task import LatencyTask
from salframe.evaluation.tasks.localization.task import compare

ROOMS = len(LABELS)
FRAMES = 3 * ROOMS


@pytest.fixture
def counting(plugins):
    plugins("fake_plugin", "counting_plugin", "salframe_graphs", "salframe_objects", "salframe_engines")


def request(*methods, settings=(), **options):
    return Request(methods, "rooms", settings=(f"data.rooms={ROOMS}", "detector.kind=counting", *settings), **options)


def count_detections() -> Counter[str]:
    """Return the number of detections of each panorama, and forget them."""
    log = Path(LOG)
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    log.unlink(missing_ok=True)
    return Counter(line.split()[0] for line in lines)


@pytest.mark.parametrize(
    ("engine", "settings"), [("inline", ()), pytest.param("processes", ("engine.workers=2",), marks=pytest.mark.slow)]
)
def test_methods_with_one_detector_detect_each_panorama_once(counting, engine, settings):
    result = compare(request("objects", "salient-objects", settings=settings, engine=engine))
    counts = count_detections()
    assert (len(counts), set(counts.values())) == (FRAMES, {1})
    assert [row.accuracy.value for row in result.rows] == [1.0, 1.0]
    for row in result.rows:  # the time of a detection is part of the time of each method
        assert row.describe_ms >= 1e3 * DELAY_S


def test_methods_with_different_detectors_do_not_share(counting):
    compare(request("objects", "salient-objects", settings=("objects.detector.size_m=2",), engine="inline"))
    counts = count_detections()
    assert (len(counts), set(counts.values())) == (FRAMES, {2})


def test_another_content_of_the_panoramas_is_detected_again(counting, monkeypatch):
    compare(request("objects", engine="inline"))
    count_detections()
    monkeypatch.setenv("ROOMS_CONTENT", "other")
    compare(request("salient-objects", engine="inline"))
    assert sum(count_detections().values()) == FRAMES


def test_another_command_uses_the_stored_detections(counting):
    compare(request("objects", engine="inline"))
    count_detections()
    result = compare(request("salient-objects", engine="inline", name="resumed"))
    assert not count_detections()
    assert result.row("salient-objects").describe_ms >= 1e3 * DELAY_S


def test_latency_queries_never_use_stored_detections(counting):
    compare(request("objects", engine="inline"))
    count_detections()
    requested = request("objects", engine="inline")
    row = run_task(LatencyTask(), requested, resolve(requested)).row("objects")
    counts = count_detections()
    assert {name: count for name, count in counts.items() if name.startswith("query")} == {
        f"query-{room}-{query}": 1 for room in range(ROOMS) for query in range(2)
    }
    assert row.describe_ms >= 1e3 * DELAY_S
    assert np.isfinite(row.query_median_ms)
