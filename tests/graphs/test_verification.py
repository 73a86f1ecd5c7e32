"""Geometric verification of nodes whose poses are known."""

import numpy as np
import pytest
from salframe_graphs.node_pairs import NodePairs
from salframe_graphs.verification import ScaleBound, verify

from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, transform_points


def every_pair(nodes):
    """All pairs of the nodes of a query and of one graph of that many nodes."""
    query, node = np.nonzero(np.ones((nodes, nodes)))
    return NodePairs(query, node, np.zeros(nodes * nodes, int), 1)


def test_verification_ignores_outliers():
    rng = np.random.default_rng(3)
    reference = rng.uniform(-3, 3, (1, 9, 2))
    T = pose_2d(0.7, -0.2, 1.1)
    query = transform_points(invert_pose(T), np.column_stack([reference[0], np.zeros(9)]))[:, :2]
    query[:3] = rng.uniform(-3, 3, (3, 2))
    given = query, reference[0], every_pair(9), np.ones(81), np.full(81, 0.3), np.full(9, 1 / 9)
    found = verify(*given, 4.0)
    assert pose_errors(found.poses(np.array([0]))[0], T) == pytest.approx((0, 0), abs=0.05)
    np.testing.assert_allclose(found.kernel.reshape(9, 9)[range(3, 9), range(3, 9)], 1, atol=0.05)
    far = verify(*given, 0.1)
    assert np.isnan(far.poses(np.array([0]))[0]).all()


@pytest.mark.parametrize("factor", [0.8, 0.92, 1.0, 1.15])
def test_a_bounded_scale_is_estimated_with_the_pose(factor):
    """A room whose ranges are all off by a factor: the exact pose and the factor that puts them right."""
    reference = np.random.default_rng(2).uniform(-3, 3, (9, 3)) * (1, 1, 0.4)
    truth = pose_2d(1.0, -0.5, 2.0)
    query = transform_points(invert_pose(truth), reference) * factor
    bound = ScaleBound(0.3, query[:, 2], reference[:, 2], 0.2)
    given = query[:, :2], reference[:, :2], every_pair(9), np.ones(81), np.full(81, 0.2), np.ones(9), 6.0
    found = verify(*given, bound)
    assert pose_errors(found.poses(np.array([0]))[0], truth) == pytest.approx((0, 0), abs=1e-6)
    np.testing.assert_allclose(np.diag(found.kernel.reshape(9, 9)), 1, atol=1e-5)
    rigid = verify(*given)
    assert (np.diag(rigid.kernel.reshape(9, 9)).sum() > 8.99) == (factor == 1.0)


def test_a_scale_beyond_the_bound_is_not_estimated():
    reference = np.random.default_rng(2).uniform(-3, 3, (9, 3)) * (1, 1, 0.4)
    bound, itself = ScaleBound(0.1, reference[:, 2] * 0.6, reference[:, 2], None), np.arange(9)
    pairs = NodePairs(itself, itself, np.zeros(9, int), 1)
    query_xy = reference[:, :2] * 0.6
    found = verify(query_xy, reference[:, :2], pairs, np.ones(9), np.full(9, 0.2), np.ones(9), 6.0, bound)
    assert found.kernel.sum() < 5
