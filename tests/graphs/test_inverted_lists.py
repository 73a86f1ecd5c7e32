"""Inverted lists against the definition, object by object, and against themselves compiled and in pieces."""

import json

import numpy as np
import pytest
from salframe_graphs import compilation
from salframe_graphs.retrieval import postings
from salframe_graphs.retrieval.inverted_lists import InvertedLists

from salframe.framework.errors import DataError
from salframe.graphs.graph import SaliencyGraph, without_range
from salframe.testing.asking import same

NAMES = np.array(["chair", "chair", "chair", "table", "lamp", "bed", "vase", "harp"])


def some_graph(rng, most=9):
    """Objects on the codes' own values, so that rounding them changes nothing."""
    count = rng.integers(0, most)
    value = postings.CODE_LOW + postings.CODE_STEP * rng.integers(60, 200, (count, 3))
    centroid = np.column_stack([rng.normal(0, 2, (count, 2)), value[:, 0]])
    size = np.exp(value[:, [1, 1, 2]])
    ones, edges = np.ones(count), np.zeros((0, 2), np.int64)
    return SaliencyGraph(
        tuple(rng.choice(NAMES, count).tolist()), ones, ones / max(count, 1), centroid, size, 0 * ones, edges
    )


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


def defined_scores(query, graphs):
    """(S,) the score as defined, in floating point."""
    rarity = {
        name: np.log((1 + len(graphs)) / (1 + sum(name in graph.labels for graph in graphs))) + 1
        for name in {*NAMES.tolist(), *query.labels}
    }
    scores = []
    for graph in graphs:
        shared = 0.0
        for name in set(query.labels) & set(graph.labels):
            ours, theirs = ([i for i, label in enumerate(g.labels) if label == name] for g in (query, graph))
            alike = np.ones((len(ours), len(theirs)))
            if not query.bearings_only:
                for values, scale in (
                    (lambda g: g.centroid_m[:, 2], 0.2),
                    (lambda g: np.log(g.size_m[:, 0]), 0.8),
                    (lambda g: np.log(g.size_m[:, 2]), 0.5),
                ):
                    alike /= 1 + ((values(query)[ours][:, None] - values(graph)[theirs]) / scale) ** 2
            shared += rarity[name] * min(alike.max(1).sum(), alike.max(0).sum())
        whole = sum(rarity[name] for name in (*query.labels, *graph.labels))
        scores.append(shared / (whole - shared) if whole else 0.0)
    return np.array(scores)


@pytest.mark.parametrize("ranged", [True, False])
def test_the_score_is_the_soft_jaccard_index(index, graphs, ranged):
    rng = np.random.default_rng(6)
    for _ in range(10):
        query = some_graph(rng)
        query = query if ranged else without_range(query)
        found, defined = index.candidates(query, len(graphs)), defined_scores(query, graphs)
        assert set(np.flatnonzero(defined > 0.01)) <= set(found.scene.tolist())
        np.testing.assert_allclose(found.score, defined[found.scene], atol=0.01)


def test_of_equal_scores_the_lower_number_comes_first(graphs, tmp_path):
    index, query = InvertedLists(), next(graph for graph in graphs if len(graph) > 4)
    index.build([query] * 30, tmp_path / "index")
    index.open(tmp_path / "index")
    assert index.candidates(query, 7).scene.tolist() == list(range(7))


def test_compiled_gives_the_same_candidates_in_the_same_order(index, monkeypatch):
    pytest.importorskip("numba")
    rng = np.random.default_rng(7)
    asked = [some_graph(rng, 14) for _ in range(40)]
    asked = [(query, count) for seen in asked for query in (seen, without_range(seen)) for count in (3, 50, 300)]
    found = [index.candidates(query, count) for query, count in asked]
    monkeypatch.setattr(compilation, "compiled", lambda module: None)
    for (query, count), candidates in zip(asked, found, strict=True):
        assert same(index.candidates(query, count), candidates)


def test_an_index_is_the_same_built_in_pieces(graphs, index, tmp_path, monkeypatch):
    monkeypatch.setattr(postings, "_CHUNK", 64)
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
    with pytest.raises(DataError, match="lists of other lengths"):
        InvertedLists().open(tmp_path / "index")
    manifest.write_text(json.dumps({**content, "format": 0}))
    with pytest.raises(DataError, match="format 0, expected 1"):
        InvertedLists().open(tmp_path / "index")
    (tmp_path / "index" / "code.npy").unlink()
    manifest.write_text(json.dumps(content))
    with pytest.raises(DataError, match="not whole"):
        InvertedLists().open(tmp_path / "index")
    with pytest.raises(DataError, match="holds no scene index"):
        InvertedLists().open(tmp_path / "elsewhere")
