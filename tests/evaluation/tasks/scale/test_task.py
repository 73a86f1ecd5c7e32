"""Maps of many scenes, measured on some that are small enough to be matched at once."""

import numpy as np
import pytest
from pydantic import ValidationError
from salframe_graphs.geometric import GeometricMatcher
from scipy.stats import binomtest

from salframe.evaluation.finished_runs import evaluate
from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.studies.study import Study, run_study
from salframe.evaluation.tasks.scale import task as scale
from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.graphs.packing import graph_to_arrays
from salframe.graphs.synthetic_map import SyntheticMap
from salframe.graphs.table import MappedGraphs
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import MapParts
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.opening import configure_dataset, open_dataset

SCENES = 60
STUDY = {
    "task": "scale",
    "data": "furnished",
    "scenes": [SCENES],
    "set": {"detector.kind": "annotations", "detector.noise": "none"},
}
METHODS = {
    "one": {"method": "saliency-graph", "set": {"matcher.max_candidates": 1}},
    "twenty": {"method": "saliency-graph", "set": {"matcher.max_candidates": 20}},
}


@pytest.fixture
def furnished(plugins, monkeypatch):
    plugins("matching_plugin", "salframe_graphs", "salframe_annotations", "salframe_engines")
    monkeypatch.setattr(scale, "QUERIES", 12)
    monkeypatch.setattr(scale, "EXHAUSTIVE", 6)


def test_what_a_map_costs_and_what_is_found_in_it(furnished, tmp_path, monkeypatch):
    """Against the matcher on all scenes at once, and the same map as the method saves it."""
    monkeypatch.setattr(scale, "WINDOW", 7)
    result = run_study(Study(**STUDY, methods=METHODS), Request(engine="inline"))
    one, twenty = result.rows
    assert [row["scenes"] for row in result.settings] == [SCENES, SCENES]
    settings = {"detector": {"kind": "annotations", "noise": "none"}, "matcher": {"max_candidates": 1}}
    method = registry().build("localizer", configure_default("localizer", "saliency-graph", [settings]))
    synthetic_map = SyntheticMap(
        scale.SEED, scale.rooms_of(method, open_dataset(configure_dataset("furnished", None, [])[1]))
    )
    described = [graph_to_arrays(graph) for graph in synthetic_map.scenes(SCENES)]
    frames = [ReferenceFrame(f"frame-{i}", f"room-{i}", np.eye(4)) for i in range(SCENES)]
    LocalizationMap.from_descriptions(method, described, frames).save(tmp_path / "map")
    # the index has another path in map.json
    assert one.bytes_per_scene == pytest.approx(folder_bytes(tmp_path / "map") / SCENES, rel=0.02)
    packed, saved = MapParts(next((tmp_path / "map").glob("parts-*"))).read_scenes()
    graphs, numbers = MappedGraphs(packed), [int(frame.id.removeprefix("frame-")) for frame in saved]
    matcher = GeometricMatcher(GeometricMatcher.Config(max_candidates=None))
    index, rows = matcher.index(graphs), Run.load(result.runs[0]).rows("twenty", scale.ScaleTask.row)
    assert len({row.query for row in rows}) == 12
    expected = {
        row.query: numbers[matcher.match(synthetic_map.query(row.query), index, 1)[0].scene] == row.query
        for row in rows
    }
    exhaustive = {row.query: row.right_exhaustive for row in rows if row.right_exhaustive is not None}
    assert exhaustive == {query: expected[query] for query in exhaustive}
    assert len(exhaustive) == 6
    assert twenty.recall_at_1_exhaustive.value == np.mean(list(exhaustive.values()))
    wilson = binomtest(round(12 * twenty.recall_at_1.value), 12).proportion_ci(method="wilson")
    assert (twenty.recall_at_1.low, twenty.recall_at_1.high) == pytest.approx((wilson.low, wilson.high))
    assert one.recall_at_1.value <= twenty.recall_at_1.value
    assert twenty.recall_at_1.value > 0.8
    assert 0 < twenty.query_median_ms <= twenty.query_p95_ms
    assert evaluate(result.runs[0]).rows == result.rows


def test_a_method_without_an_index_is_told(furnished):
    (row,) = run_study(Study(**{**STUDY, "set": {}}, methods=["points"]), Request(engine="inline")).rows
    assert not row.measured
    assert (
        row.reason == "the method has no scene index (search over reference frames), expected a method "
        "with a scene index, such as 'proposed'"
    )


def test_scenes_belong_to_this_task_alone():
    with pytest.raises(ValidationError, match=r"the required setting scenes is missing"):
        Study(task="scale", method="proposed")
    with pytest.raises(ValidationError, match="unknown key scenes"):
        Study(method="proposed", scenes=[10])
