"""Node alignment against scipy's assignment of one graph after the other."""

import numpy as np
from salframe_graphs.alignment import align
from salframe_graphs.node_pairs import NodePairs
from scipy.optimize import linear_sum_assignment


def every_pair(graphs, query_nodes, graph_nodes):
    """All pairs of the nodes of a query and of graphs of one size, and where each graph's nodes begin."""
    graph, query, node = np.nonzero(np.ones((graphs, query_nodes, graph_nodes)))
    first = np.arange(graphs) * graph_nodes
    return NodePairs(query, node + first[graph], graph, graphs), first


def test_pairs_are_those_of_greatest_total():
    rng = np.random.default_rng(0)
    similarity, kernel = rng.uniform(size=(2, 300, 5, 7))
    similarity[similarity < 0.5] = 0
    kernel[kernel < rng.uniform(0.7, 1, (300, 1, 1))] = 0  # of some graphs nothing is explained, of others much
    by_kernel = shared = 0
    aligned = align(*every_pair(300, 5, 7), similarity.ravel(), kernel.ravel())
    for pairs, alike, explained in zip(aligned, similarity, kernel, strict=True):
        totals = [(value[linear_sum_assignment(value, maximize=True)], value) for value in (explained, alike)]
        (best, value) = totals[0] if (totals[0][0] > 0).sum() >= 2 else totals[1]
        by_kernel += value is explained
        shared += value is explained and ((value > 0).sum(0).max() > 1 or (value > 0).sum(1).max() > 1)
        assert (value[tuple(pairs.T)] > 0).all()
        assert len({*pairs[:, 0]}) == len({*pairs[:, 1]}) == len(pairs) == (best > 0).sum()
        np.testing.assert_allclose(value[tuple(pairs.T)].sum(), best.sum())
    assert 20 < shared < by_kernel - 20 < 260  # each way is taken often


def test_no_graph_and_no_pair():
    assert align(*every_pair(0, 3, 4), np.zeros(0), np.zeros(0)) == []
    assert align(*every_pair(1, 3, 4), np.zeros(12), np.zeros(12))[0].shape == (0, 2)
