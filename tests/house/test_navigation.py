"""Closed loop in a rendered building, with the detector's uniform noise."""

from __future__ import annotations

from pathlib import Path

import pytest

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.navigation.options import Positioning
from salframe.evaluation.tasks.navigation.task import navigate


@pytest.mark.slow
def test_poses_bring_the_agent_to_its_goals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    settings = ("data.rgb=false", "data.height=256", "data.queries_per_room=1")
    request = Request(("proposed",), "house-6", settings=settings, runs=tmp_path, engine="inline")
    navigation = navigate(request, episodes=10, positioning=Positioning.BOTH)
    posed, placed = navigation.rows
    assert posed.success_rate.value >= 0.9
    assert posed.spl.value >= 0.8
    assert placed.success_rate.value < posed.success_rate.value
    assert navigation.report.exists()
