"""Positioners against poses that are known, and against the table of
docs/explanation/saliency-graph.md#from-matched-nodes-to-a-pose."""

import numpy as np
import pytest
from salframe_graphs.positioning import LeastSquaresPositioner, RobustPositioner
from scipy.spatial.transform import Rotation

from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, transform_points


def room(rng, nodes):
    return np.column_stack([rng.uniform(-3, 3, nodes), rng.uniform(-2.5, 2.5, nodes), rng.uniform(0, 2, nodes)])


def least_squares(**settings):
    return LeastSquaresPositioner(LeastSquaresPositioner.Config(**settings))


def robust(**settings):
    return RobustPositioner(RobustPositioner.Config(**settings))


@pytest.mark.parametrize("positioner", [least_squares(), robust()], ids=["least-squares", "robust"])
def test_noise_free_pose_is_exact(positioner):
    rng = np.random.default_rng(0)
    for _ in range(20):
        reference = room(rng, 6)
        truth = pose_2d(*rng.uniform(-1, 1, 2), rng.uniform(-np.pi, np.pi))
        found = positioner.solve(transform_points(invert_pose(truth), reference), reference)
        assert found.status == "ok"
        assert pose_errors(found.T_reference_query, truth) == pytest.approx((0, 0), abs=1e-9)


def test_se3_agrees_with_scipy():
    rng = np.random.default_rng(1)
    reference = room(rng, 8)
    turn = Rotation.from_rotvec([0.2, -0.3, 1.1])
    query = turn.inv().apply(reference - [0.3, -0.2, 0.1]) + rng.normal(0, 0.01, (8, 3))
    expected, _ = Rotation.align_vectors(reference - reference.mean(0), query - query.mean(0))
    found = robust(group="SE(3)").solve(query, reference).T_reference_query
    np.testing.assert_allclose(found[:3, :3], expected.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(found[:3, 3], reference.mean(0) - expected.apply(query.mean(0)), atol=1e-9)


def test_all_pairs_equal_centred_least_squares():
    """docs/explanation/saliency-graph.md#from-matched-nodes-to-a-pose: the N(N-1)/2 pair rows give the solution of
    the N mean-centred rows."""
    rng = np.random.default_rng(2)
    u, v = room(rng, 7)[:, :2], room(rng, 7)[:, :2]
    target = (u**2).sum(1) - (v**2).sum(1)
    expected = 0.5 * np.linalg.lstsq(u - u.mean(0), target - target.mean(), rcond=None)[0]
    pad = np.zeros((7, 1))
    found = least_squares().solve(np.hstack([v, pad]), np.hstack([u, pad])).T_reference_query
    np.testing.assert_allclose(found[:2, 3], expected, atol=1e-9)


def test_literal_norms_are_wrong_and_squared_ones_right():
    rng = np.random.default_rng(3)
    reference = room(rng, 8)
    truth = pose_2d(0.6, -0.3, 0.4)
    query = transform_points(invert_pose(truth), reference)
    error = {
        norms: pose_errors(least_squares(norms=norms).solve(query, reference).T_reference_query, truth)[0]
        for norms in ("squared", "literal")
    }
    assert error["squared"] < 1e-9
    assert error["literal"] > 0.3


def test_arccos_loses_the_sign():
    reference = np.array([[2, 1, 0], [1, -2, 0], [-2, -1, 0], [-1, 2.5, 0]], float)
    truth = pose_2d(0, 0, -np.pi / 3)
    query = transform_points(invert_pose(truth), reference)
    assert pose_errors(least_squares(angle="arccos").solve(query, reference).T_reference_query, truth)[1] > 0.2
    assert pose_errors(least_squares().solve(query, reference).T_reference_query, truth)[1] < 1e-9


def test_nodes_without_saliency_weigh_alike():
    reference = room(np.random.default_rng(3), 5)
    query = transform_points(invert_pose(pose_2d(0.4, 0.3, 0.5)), reference)
    for mean in ("arithmetic", "circular"):
        alike, none = (least_squares(mean=mean).solve(query, reference, weights) for weights in (None, np.zeros(5)))
        np.testing.assert_array_equal(alike.T_reference_query, none.T_reference_query)


def simulate(positioner, nodes, noise_m, wrong, trials=400, seed=5):
    """Median translation (m) and rotation (deg) error, and the share within 0.5 m and 10 deg: the simulation of
    docs/explanation/saliency-graph.md#from-matched-nodes-to-a-pose."""
    rng = np.random.default_rng(seed)
    errors = []
    for _ in range(trials):
        points = room(rng, nodes)
        truth = pose_2d(*rng.uniform(-0.7, 0.7, 2), rng.uniform(-np.pi, np.pi))
        query = transform_points(invert_pose(truth), points) + rng.normal(0, noise_m, points.shape)
        reference = points + rng.normal(0, noise_m, points.shape)
        swapped = rng.choice(nodes, int(wrong * nodes), replace=False)
        reference[swapped] = room(rng, len(swapped))
        found = positioner.solve(query, reference)
        if found.T_reference_query is None:
            errors.append((np.inf, np.inf))
            continue
        flat = found.T_reference_query.copy()
        flat[2, 3] = 0
        errors.append(pose_errors(flat, truth))
    translation, rotation = np.array(errors).T
    return (
        np.median(translation),
        np.degrees(np.median(rotation)),
        np.mean((translation < 0.5) & (np.degrees(rotation) < 10)),
    )


@pytest.mark.parametrize(
    ("nodes", "noise_m", "wrong", "translation_m", "rotation_deg", "within"),
    [(5, 0.05, 0.0, 0.045, 0.75, 0.99), (8, 0.10, 0.2, 0.085, 1.25, 0.98), (12, 0.20, 0.4, 0.17, 2.2, 0.97)],
)
def test_robust_reaches_the_table(nodes, noise_m, wrong, translation_m, rotation_deg, within):
    """The right-hand column of the table, with the sampling error of 400 trials."""
    translation, rotation, share = simulate(robust(), nodes, noise_m, wrong)
    assert translation <= translation_m
    assert rotation <= rotation_deg
    assert share >= within


def test_wrong_matches_break_least_squares():
    assert simulate(least_squares(), 12, 0.20, 0.4)[2] < 0.5


def test_inliers_are_the_true_matches():
    rng = np.random.default_rng(6)
    reference = room(rng, 9)
    query = transform_points(invert_pose(pose_2d(0.5, 0.2, 2.0)), reference)
    query[[1, 4]] += [[2, 1, 0], [-1, 2, 0]]
    assert np.flatnonzero(~robust().solve(query, reference).inliers).tolist() == [1, 4]


def test_covariance_matches_the_spread():
    """The stated standard deviations against those of 400 repetitions of one layout."""
    rng = np.random.default_rng(7)
    points = room(rng, 10)
    truth = pose_2d(0.3, 0.4, 0.7)
    exact = transform_points(invert_pose(truth), points)
    poses, stated = [], []
    for _ in range(400):
        found = robust().solve(exact + rng.normal(0, 0.08, exact.shape), points)
        poses.append(
            [*found.T_reference_query[:2, 3], np.arctan2(found.T_reference_query[1, 0], found.T_reference_query[0, 0])]
        )
        stated.append(np.diag(found.covariance))
    np.testing.assert_allclose(np.sqrt(np.mean(stated, axis=0)), np.std(poses, axis=0), rtol=0.15)


def test_symmetric_layout_is_ambiguous():
    square = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], float)
    query = np.concatenate([square, square])
    reference = np.concatenate([square, -square])
    assert robust().solve(query, reference).status == "ambiguous"


@pytest.mark.parametrize(
    ("positioner", "points", "status"),
    [
        (robust(), np.zeros((1, 3)), "too-few"),
        (robust(), np.zeros((4, 3)), "degenerate"),
        (least_squares(), np.array([[0, 0, 0], [1, 0, 0]], float), "too-few"),
        (least_squares(), np.array([[0, 0, 0], [1, 1, 0], [2, 2, 0], [3, 3, 0]], float), "degenerate"),
        (robust(group="SE(3)"), np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2]], float), "degenerate"),
    ],
)
def test_what_cannot_be_solved_says_so(positioner, points, status):
    found = positioner.solve(points, points)
    assert (found.status, found.T_reference_query) == (status, None)


def test_inconsistent_matches():
    query = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]], float)
    reference = np.array([[0, 0, 0], [9, 0, 0], [0, -20, 0]], float)
    assert robust(min_inliers=3).solve(query, reference).status == "inconsistent"
