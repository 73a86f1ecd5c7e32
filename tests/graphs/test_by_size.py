"""The scene index by the number of scenes."""

import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places.localizer import SaliencyPlacesLocalizer
from salframe_graphs.retrieval import by_size
from salframe_graphs.retrieval.by_size import MAX_PLAIN, BySize, choose_scene_index
from salframe_graphs.retrieval.compiled_lists import CompiledLists
from salframe_graphs.retrieval.inverted_lists import InvertedLists
from scene_scores import some_graph

from salframe.framework.errors import DataError, RequirementMissing
from salframe.graphs.scene_index import scene_index_notes
from salframe.testing.expectations import same
from salframe.topology.building_map import build_map


@pytest.fixture(scope="module")
def graphs():
    rng = np.random.default_rng(5)
    return [some_graph(rng) for _ in range(60)]


@pytest.fixture
def without_numba(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "numba" else find(name))


def opened(component, folder):
    index = component()
    index.open(folder)
    return index


def test_small_maps_take_inverted_lists_and_say_nothing():
    assert choose_scene_index(MAX_PLAIN) == (InvertedLists, None)


def test_large_maps_take_compiled_lists_and_say_so():
    pytest.importorskip("numba")
    kind, note = choose_scene_index(MAX_PLAIN + 1)
    assert kind is CompiledLists
    assert (
        note == "the map has over 10,000 panoramas: the scene index compiled-lists selects the part of the map that is "
        "compared with each query"
    )


def test_large_maps_without_numba_take_inverted_lists_and_name_the_extra(without_numba):
    kind, note = choose_scene_index(MAX_PLAIN + 1)
    assert kind is InvertedLists
    assert "pip install 'salframe[fast]'" in note


@pytest.mark.parametrize("localizer", [SaliencyGraphLocalizer, SaliencyPlacesLocalizer])
def test_a_method_tells_the_note_once(localizer):
    config = localizer.Config(detector="annotations")
    assert scene_index_notes(config, MAX_PLAIN) == []
    assert scene_index_notes(config, MAX_PLAIN + 1) == [choose_scene_index(MAX_PLAIN + 1)[1]]
    named = localizer.Config(detector="annotations", matcher={"scene_index": "inverted-lists"})
    expected = 1 if localizer is SaliencyPlacesLocalizer else 0  # it has a slot of its own
    assert len(scene_index_notes(named, MAX_PLAIN + 1)) == expected


def test_a_build_tells_the_note(tmp_path, monkeypatch, without_numba):
    monkeypatch.setattr(by_size, "MAX_PLAIN", 3)
    lines = []
    settings = ["data.rgb=false", "data.height=64", "detector.kind=annotations"]
    build_map("house-6", tmp_path / "map", "saliency-graph", overrides=settings, tell=lines.append)
    note = "the map has over 3 panoramas: for faster queries, pip install 'salframe[fast]' and build the map again"
    assert lines.count(note) == 1


@pytest.mark.parametrize(("limit", "kind"), [(60, InvertedLists), (59, CompiledLists)])
def test_the_answers_are_those_of_the_index_that_was_chosen(graphs, tmp_path, monkeypatch, limit, kind):
    if kind is CompiledLists:
        pytest.importorskip("numba")
    kind().build(graphs, tmp_path / "plain")
    monkeypatch.setattr(by_size, "MAX_PLAIN", limit)
    BySize().build(iter(graphs), tmp_path / "index")
    monkeypatch.setattr(by_size, "MAX_PLAIN", 0)  # what it was built with counts
    one, other = opened(BySize, tmp_path / "index"), opened(kind, tmp_path / "plain")
    for query in graphs[:20]:
        assert same(one.candidates(query, 9), other.candidates(query, 9))


def test_a_map_built_with_numba_names_the_extra_where_that_is_missing(graphs, tmp_path, monkeypatch, request):
    pytest.importorskip("numba")
    monkeypatch.setattr(by_size, "MAX_PLAIN", 10)
    BySize().build(graphs, tmp_path / "index")
    request.getfixturevalue("without_numba")
    with pytest.raises(
        RequirementMissing,
        match=r"needs the Python package numba, which is not installed: pip install 'salframe\[fast\]'",
    ):
        BySize().open(tmp_path / "index")


def test_what_is_no_index_is_refused(graphs, tmp_path):
    with pytest.raises(DataError, match="has no scene index"):
        BySize().open(tmp_path / "elsewhere")
    BySize().build(graphs, tmp_path / "index")
    (tmp_path / "index" / "choice.json").write_text(json.dumps({"kind": "magic"}))
    with pytest.raises(
        DataError, match="scene index of the kind 'magic', expected one of inverted-lists, compiled-lists"
    ):
        BySize().open(tmp_path / "index")


def test_small_maps_do_not_import_numba(graphs, tmp_path):
    BySize().build(graphs, tmp_path / "index")
    code = (
        "import sys, pathlib, salframe; from salframe_graphs.retrieval.by_size import BySize;"
        "BySize().open(pathlib.Path(sys.argv[1])); print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "index"], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("False\n", "")
