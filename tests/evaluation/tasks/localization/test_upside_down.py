"""`compare` answers upside-down queries as `localize` does, in a rendered building."""

import numpy as np
import pytest

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.localization.map import LocalizationMap
from salframe.panoramas.opening import find_dataset

BUILDING = tuple(
    f"data.{setting}" for setting in ("rooms=6", "rgb=false", "height=128", "queries_per_room=1", "query_tilt_deg=180")
)


def test_compare_answers_upside_down_queries_as_localize_does(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    given = ("detector.kind=annotations", *BUILDING)
    result = compare(Request(("proposed",), "house", settings=given, engine="inline", runs=tmp_path / "runs"))
    (row,) = result.rows
    assert row.accuracy.value == 1.0
    rows = {one.query: one for one in Run.load(result.run).rows("proposed", AnswerRow)}
    dataset = find_dataset("house", overrides=BUILDING)
    (fold,) = dataset.folds()
    config = configure("localizer", "proposed", settings("localizer", "proposed"), [{"detector": "annotations"}])
    built = LocalizationMap.build(registry().build("localizer", config), fold.references, floors=dataset.floors())
    assert len(rows) == len(fold.queries) == 6
    for query in fold.queries:
        answer = built.localize(query, warn=lambda note: None)
        assert rows[query.id].places[0].place == answer.places[0].place
        np.testing.assert_allclose(rows[query.id].pose_matrix, answer.T_world_query, atol=1e-6)
        assert answer.T_world_query[2, 2] == pytest.approx(-1, abs=0.01)
