"""Node alignment against scipy's assignment of one graph after the other."""

import numpy as np
from salframe_graphs.alignment import align
from scipy.optimize import linear_sum_assignment


def test_pairs_are_those_of_greatest_total():
    rng = np.random.default_rng(0)
    similarity, kernel = rng.uniform(size=(2, 300, 5, 7))
    similarity[similarity < 0.5] = 0
    kernel[kernel < rng.uniform(0.7, 1, (300, 1, 1))] = 0  # of some graphs nothing is explained, of others much
    by_kernel = shared = 0
    for pairs, alike, explained in zip(align(similarity, kernel), similarity, kernel, strict=True):
        totals = [(value[linear_sum_assignment(value, maximize=True)], value) for value in (explained, alike)]
        (best, value) = totals[0] if (totals[0][0] > 0).sum() >= 2 else totals[1]
        by_kernel += value is explained
        shared += value is explained and ((value > 0).sum(0).max() > 1 or (value > 0).sum(1).max() > 1)
        assert (value[tuple(pairs.T)] > 0).all()
        assert len({*pairs[:, 0]}) == len({*pairs[:, 1]}) == len(pairs) == (best > 0).sum()
        np.testing.assert_allclose(value[tuple(pairs.T)].sum(), best.sum())
    assert 20 < shared < by_kernel - 20 < 260  # each way is taken often


def test_no_graph_and_no_pair():
    assert align(np.zeros((0, 3, 4)), np.zeros((0, 3, 4))) == []
    assert align(np.zeros((1, 3, 4)), np.zeros((1, 3, 4)))[0].shape == (0, 2)
