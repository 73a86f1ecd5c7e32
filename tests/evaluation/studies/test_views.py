"""Studies of queries with several views: joined, or fused from the answers to single views."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from salframe.evaluation.runs.request import Request
from salframe.evaluation.studies.study import ablate
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError

ROOMS = 4
FUSED = 1 / ROOMS
"""Share of queries whose earlier views do not show another room of the map: those of the last room."""


@pytest.fixture
def study(fakes, monkeypatch, request):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))
    monkeypatch.setenv("SALFRAME_PLUGINS", "views_plugin,salframe_engines")
    registry.cache_clear()

    def run(**content):
        content = {"data": "walks", "set": {"data.rooms": ROOMS}, **content}
        Path("views.yaml").write_text(yaml.safe_dump(content))
        return ablate("views.yaml", Request((), engine="inline"))

    return run


def test_a_method_without_join_is_answered_view_by_view_and_its_row_says_so(study):
    result = study(methods=["joiner", "reader"])
    rows = {row.method: row for row in result.rows}
    assert rows["joiner"].accuracy.value == 1
    assert rows["reader"].accuracy.value == FUSED
    assert rows["joiner"].input == ("rgb", "3 views joined")
    assert rows["reader"].input == ("rgb", "3 views fused")
    assert rows["joiner"].reason is None
    assert f"queries with several views that were localized view by view: {2 * ROOMS}" in rows["reader"].reason
    assert "because the method 'reader' cannot localize several views together" in rows["reader"].reason


def test_fusions_are_rows(study):
    result = study(methods=["joiner"], views=["joined", "product", "surest"])
    assert [settings["views"] for settings in result.settings] == ["joined", "product", "surest"]
    assert [row.accuracy.value for row in result.rows] == [1, FUSED, FUSED]
    assert [row.input[-1] for row in result.rows] == ["3 views joined", "3 views fused", "3 views fused"]
    assert len({run.name for run in result.runs}) == 3
    again = study(methods=["joiner"], views=["product"])
    assert again.runs == (result.runs[1],)


def test_single_views_have_no_word_in_the_input(study):
    (row,) = study(methods=["joiner"], set={"data.rooms": ROOMS, "data.views": 1}).rows
    assert row.input == ("rgb",)


def test_an_unknown_fusion_is_refused(study):
    with pytest.raises(ConfigError, match=r"views.*mean.*expected"):
        study(methods=["joiner"], views=["mean"])
