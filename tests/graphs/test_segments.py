"""Groups of columns against loops over the groups."""

from itertools import combinations

import numpy as np
import pytest

from salframe.graphs.segments import Segments, pairs_within, ranges, run_starts, starts, top_per_group


@pytest.mark.parametrize("count", [[3, 1, 4], [0, 2, 0, 0, 3, 0], [0], []])
def test_sums_maxima_and_repetition(count):
    count = np.array(count, int)
    groups, values = Segments(count), np.random.default_rng(1).uniform(0, 1, (2, count.sum()))
    parts = [values[:, low : low + n] for low, n in zip(np.cumsum(count) - count, count, strict=True)]
    assert len(groups) == len(count)
    np.testing.assert_allclose(groups.sum(values), np.array([part.sum(1) for part in parts]).reshape(-1, 2).T)
    np.testing.assert_allclose(
        groups.max(values), np.array([part.max(1, initial=0) for part in parts]).reshape(-1, 2).T
    )
    np.testing.assert_array_equal(groups.spread(np.arange(len(count))), np.repeat(np.arange(len(count)), count))


def test_ranges_and_runs():
    assert starts(np.array([2, 0, 3])).tolist() == [0, 2, 2, 5]
    assert ranges(np.array([5, 9, 0]), np.array([2, 0, 3])).tolist() == [5, 6, 0, 1, 2]
    assert run_starts(np.array([4, 4, 1, 1, 4])).tolist() == [0, 2, 4]
    assert run_starts(np.array([0, 0, 0]), np.array([1, 2, 2])).tolist() == [0, 1]
    assert run_starts(np.zeros(0)).tolist() == []


def test_pairs_within_groups_are_all_combinations():
    count = np.array([3, 0, 1, 5])
    first, second = pairs_within(starts(count))
    groups = np.split(np.arange(9), np.cumsum(count)[:-1])
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == [
        pair for group in groups for pair in combinations(group.tolist(), 2)
    ]


def test_the_largest_of_each_group():
    value = np.array([1.0, 5.0, -np.inf, 3.0, 2.0, 3.0, np.nan])
    group = np.array([0, 1, 0, 1, 1, 1, 0])
    assert top_per_group(value, group, 2).tolist() == [0, 1, 3]
    assert top_per_group(value, group, 3).tolist() == [0, 1, 3, 5]  # ties in order
