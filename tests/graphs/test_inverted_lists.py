"""Inverted lists against the definition, object by object, and against themselves built in pieces."""

import json

import numpy as np
import pytest
from salframe_graphs.retrieval import postings
from salframe_graphs.retrieval.inverted_lists import InvertedLists
from scene_scores import list_scores, some_graph

from salframe.framework.errors import DataError
from salframe.graphs.graph import without_range
from salframe.testing.expectations import same


@pytest.fixture(scope="module")
def graphs():
    rng = np.random.default_rng(5)
    return [some_graph(rng) for _ in range(300)]


@pytest.fixture(scope="module")
def index(graphs, tmp_path_factory):
    index, folder = InvertedLists(), tmp_path_factory.mktemp("index") / "of graphs"
    index.build(iter(graphs), folder)
    index.open(folder)
    return index


@pytest.mark.parametrize("ranged", [True, False])
def test_the_score_is_the_soft_jaccard_index(index, graphs, ranged):
    rng = np.random.default_rng(6)
    for _ in range(10):
        query = some_graph(rng)
        query = query if ranged else without_range(query)
        found, defined = index.candidates(query, len(graphs)), list_scores(query, graphs)
        assert set(np.flatnonzero(defined > 0.01)) <= set(found.scene.tolist())
        np.testing.assert_allclose(found.score, defined[found.scene], atol=0.01)


def test_of_equal_scores_the_lower_number_comes_first(graphs, tmp_path):
    index, query = InvertedLists(), next(graph for graph in graphs if len(graph) > 4)
    index.build([query] * 30, tmp_path / "index")
    index.open(tmp_path / "index")
    assert index.candidates(query, 7).scene.tolist() == list(range(7))


def test_an_index_is_the_same_built_in_pieces(graphs, index, tmp_path, monkeypatch):
    monkeypatch.setattr(postings, "CHUNK", 64)
    pieces = InvertedLists()
    pieces.build(iter(graphs), tmp_path / "index")
    pieces.open(tmp_path / "index")
    for query in graphs[:20]:
        assert same(pieces.candidates(query, 300), index.candidates(query, 300))


def test_a_map_without_objects_has_no_candidates(graphs, tmp_path):
    index, empty = InvertedLists(), next(graph for graph in graphs if not len(graph))
    index.build([empty, empty], tmp_path / "index")
    index.open(tmp_path / "index")
    assert len(index.candidates(graphs[0], 5)) == 0


def test_an_index_that_is_not_whole_is_refused(graphs, tmp_path):
    InvertedLists().build(graphs, tmp_path / "index")
    manifest = tmp_path / "index" / "index.json"
    content = json.loads(manifest.read_text())
    manifest.write_text(json.dumps({**content, "scenes": 7}))
    with pytest.raises(DataError, match="is damaged: its arrays do not have the lengths stated in"):
        InvertedLists().open(tmp_path / "index")
    manifest.write_text(json.dumps({**content, "format": 0}))
    with pytest.raises(DataError, match="format 0, expected 1"):
        InvertedLists().open(tmp_path / "index")
    (tmp_path / "index" / "code.npy").unlink()
    manifest.write_text(json.dumps(content))
    with pytest.raises(DataError, match="is incomplete"):
        InvertedLists().open(tmp_path / "index")
    with pytest.raises(DataError, match="has no scene index"):
        InvertedLists().open(tmp_path / "elsewhere")
