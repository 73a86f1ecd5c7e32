"""Structural features of nodes against their definition, node by node."""

import numpy as np
import pytest
from drawn_rooms import LABELS, graph_of, room
from salframe_graphs.features import feature_products, node2vec, ring_hop_histograms
from scipy.sparse import random_array

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.table import GraphNodes, MemoryGraphs
from salframe.panoramas.geometry import pose_2d


def histograms(table):
    """(N, F) the structural features of all nodes of a table."""
    every = np.arange(len(table))
    labels = np.arange(len(table.labels))
    return ring_hop_histograms(table.take(every), table.adjacency(every), labels, (1.0, 2.0, 4.0), 2)


def test_ring_and_hop_histograms_by_hand():
    """Labels a, b, c on a line at 0, 1.5 and 3 m; only a and b are linked."""
    graph = SaliencyGraph(
        ("a", "b", "c"),
        np.ones(3),
        np.full(3, 1 / 3),
        np.array([[0, 0, 0], [1.5, 0, 0], [3, 0, 0]], float),
        np.ones((3, 3)),
        np.zeros(3),
        np.array([[0, 1]]),
    )
    received = histograms(MemoryGraphs([graph]))
    a = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 0]]).ravel()
    np.testing.assert_allclose(received[0], a / np.linalg.norm(a))


def test_node2vec_is_seeded_and_joint():
    pytest.importorskip("gensim")
    graphs = [graph_of(room(3)), graph_of(room(3), pose_2d(0.3, 0.1, 1.0))]
    first, again = node2vec(graphs, seed=1), node2vec(graphs, seed=1)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    same_label = np.array([[x == y for y in graphs[1].labels] for x in graphs[0].labels])
    similarity = first[0] @ first[1].T
    assert similarity[same_label].mean() > similarity[~same_label].mean()


def defined_histograms(graph, vocabulary):
    """(N, F) structural features node by node, as defined."""
    rows = np.zeros((len(graph), 5, len(vocabulary)))
    for node in range(len(graph)):
        hops = {node: 0}
        for step in (1, 2):
            for a, b in [*graph.edges.tolist(), *graph.edges[:, ::-1].tolist()]:
                if hops.get(a) == step - 1:
                    hops.setdefault(b, step)
        for other in range(len(graph)):
            if other == node or graph.labels[other] not in vocabulary:
                continue
            label = vocabulary[graph.labels[other]]
            distance = np.hypot(*(graph.centroid_m[node] - graph.centroid_m[other])[:2])
            ring = np.searchsorted((1.0, 2.0, 4.0), distance, side="right")
            if ring < 3:
                rows[node, ring, label] += 1
            if other in hops:
                rows[node, 2 + hops[other], label] += 1
    rows = rows.reshape(len(graph), -1)
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)


def test_histograms_are_as_defined():
    """Graphs of other sizes together, node by node; a label that the vocabulary lacks is not counted."""
    graphs = [graph_of(room(seed, nodes=3 + seed % 9)) for seed in range(30)]
    table = MemoryGraphs(graphs)
    expected = np.concatenate([defined_histograms(graph, table.vocabulary) for graph in graphs])
    np.testing.assert_allclose(histograms(table), expected, atol=1e-12)
    query = graph_of(room(7, labels=(*LABELS, "stranger")))
    nodes = GraphNodes.of(query, table.vocabulary)
    expected = defined_histograms(query, table.vocabulary).reshape(len(query), 5, -1)
    for labels in (np.arange(len(table.labels)), np.array([3, 0])):
        columns = ring_hop_histograms(nodes, query.adjacency[None], labels, (1.0, 2.0, 4.0), 2)
        np.testing.assert_allclose(columns, expected[..., labels].reshape(len(query), -1), atol=1e-12)


def test_products_of_features_are_those_of_matrices():
    rng = np.random.default_rng(2)
    query, features = rng.uniform(size=(4, 30)), random_array((9, 30), density=0.2, random_state=3, format="csr")
    i, row = rng.integers(0, 4, 40), rng.integers(0, 9, 40)
    expected = (query @ features.T.toarray())[i, row]
    np.testing.assert_allclose(feature_products(query, features, i, row), expected, atol=1e-12)
