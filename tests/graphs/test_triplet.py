"""The matcher `triplet`: the paper's score worked out by hand."""

from collections import Counter

import numpy as np
import pytest
from drawn_rooms import LABELS, candidates_of, graph_of, room
from salframe_graphs.triplet import TripletMatcher

from salframe.framework.errors import RequirementMissing
from salframe.graphs.graph import SaliencyGraph


def triplets(**settings):
    return TripletMatcher(TripletMatcher.Config(**settings))


@pytest.fixture(scope="module")
def rooms():
    return [room(seed) for seed in range(30)]


def test_candidates_are_those_of_a_large_jaccard_index_of_multisets(rooms):
    """Against collections.Counter, whose & and | are the intersection and union of multisets."""
    graphs, query = [graph_of(r) for r in rooms], graph_of(room(99, nodes=11))
    labels = Counter(query.labels)
    jaccard = [(labels & Counter(g.labels)).total() / (labels | Counter(g.labels)).total() for g in graphs]
    expected = {number for number, value in enumerate(jaccard) if value >= 0.6 * max(jaccard)}
    assert candidates_of(triplets(rarity=False, min_candidate_ratio=0.6), query, graphs) == expected


def test_set_jaccard_ignores_numbers(rooms):
    graphs, query = [graph_of(r) for r in rooms], graph_of(room(99, nodes=11, labels=(*LABELS, "stranger")))
    labels = set(query.labels)
    jaccard = [len(labels & set(g.labels)) / len(labels | set(g.labels)) for g in graphs]
    expected = {number for number, value in enumerate(jaccard) if value >= 0.8 * max(jaccard)}
    assert candidates_of(triplets(rarity=False, labels="set", min_candidate_ratio=0.8), query, graphs) == expected


def test_triplet_score_by_hand():
    """A path a-b-c against one that lacks b-c: I = w_ab over w_ab + w_bc."""
    saliency = np.array([0.5, 0.3, 0.2])
    base = {
        "labels": ("a", "b", "c"),
        "scores": np.ones(3),
        "saliency": saliency,
        "centroid_m": np.eye(3),
        "size_m": np.ones((3, 3)),
        "yaw_rad": np.zeros(3),
    }
    query = SaliencyGraph(**base, edges=np.array([[0, 1], [1, 2]]))
    reference = SaliencyGraph(**base, edges=np.array([[0, 1], [0, 2]]))
    settings = {"structure_weight": 0.0}
    ab, bc = np.sqrt(0.15), np.sqrt(0.06)
    for normalise, expected in ((True, ab / (ab + bc)), (False, ab)):
        one = triplets(**settings, normalise=normalise)
        assert one.match(query, one.index([reference]), 1)[0].score == pytest.approx(expected)
    edgeless = SaliencyGraph(**base, edges=np.zeros((0, 2), int))
    one = triplets(**settings)
    assert one.match(edgeless, one.index([reference]), 1)[0].score == pytest.approx(1.0)


def test_node2vec_without_gensim_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(
        RequirementMissing, match=r"needs gensim, which is not installed: pip install 'salframe\[node2vec\]'"
    ):
        triplets(structure="node2vec")


def test_an_unweighted_graph_counts_triplets():
    """Four objects in a row, each in context with the next; the map lacks the edge of the last two."""

    def chain(edges):
        centroid = np.column_stack([np.arange(4.0), np.ones(4), np.zeros(4)])
        saliency = np.array([0.5, 0.3, 0.15, 0.05])
        return SaliencyGraph(LABELS[:4], np.ones(4), saliency, centroid, np.ones((4, 3)), np.zeros(4), np.array(edges))

    query, reference = chain([(0, 1), (1, 2), (2, 3)]), chain([(0, 1), (1, 2)])
    shares = {"unit": 2 / 3, "saliency": (0.15**0.5 + 0.045**0.5) / (0.15**0.5 + 0.045**0.5 + 0.0075**0.5)}
    numbers = {"unit": 2, "saliency": 0.15**0.5 + 0.045**0.5}
    for normalise, expected in ((True, shares), (False, numbers)):
        for weights, score in expected.items():
            one = triplets(edge_weights=weights, normalise=normalise)
            assert one.match(query, one.index([reference]), 1)[0].score == pytest.approx(score)
