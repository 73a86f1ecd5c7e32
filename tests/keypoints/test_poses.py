from __future__ import annotations

import cv2
import numpy as np
from salframe_keypoints.poses import robust_pose, solve_p3p
from scipy.spatial.transform import Rotation

from salframe.panoramas.geometry import pose_errors


def scene(count, seed=0):
    """Return points around a camera, their bearings, and the pose of the camera."""
    rng = np.random.default_rng((seed, 3))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.8, 3)).as_matrix()
    pose[:3, 3] = rng.normal(0, 0.5, 3)
    points = rng.uniform(-4, 4, (count, 3))
    bearings = (points - pose[:3, 3]) @ pose[:3, :3]
    return bearings / np.linalg.norm(bearings, axis=1, keepdims=True), points, pose, rng


def test_p3p_solutions_reproduce_their_bearings_and_one_is_the_truth():
    bearings, points, pose, rng = scene(60)
    samples = np.array([rng.permutation(60)[:3] for _ in range(200)])
    rotations, centres = solve_p3p(bearings[samples], points[samples])
    error = np.abs(centres - pose[:3, 3]).max(1) + np.abs(rotations - pose[:3, :3]).max((1, 2))
    assert (error < 1e-6).sum() >= 195
    np.testing.assert_allclose(np.linalg.det(rotations), 1, atol=1e-9)


def test_p3p_agrees_with_opencv_where_opencv_applies():
    rng = np.random.default_rng(4)
    points = np.array([[-1.0, -0.5, 4.0], [1.2, -0.3, 5.0], [0.1, 0.9, 3.5]])
    rotation, shift = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix(), rng.normal(0, 0.3, 3)
    camera = points @ rotation.T + shift
    _, turns, shifts = cv2.solveP3P(points, camera[:, :2] / camera[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_P3P)
    expected = sorted(
        (-cv2.Rodrigues(turn)[0].T @ move).ravel().tolist() for turn, move in zip(turns, shifts, strict=True)
    )
    ahead = camera / np.linalg.norm(camera, axis=1, keepdims=True)
    np.testing.assert_allclose(sorted(solve_p3p(ahead[None], points[None])[1].tolist()), expected, atol=1e-5)


def test_a_sample_that_repeats_a_point_gives_no_pose():
    bearings, points, _, _ = scene(3)
    assert len(solve_p3p(bearings[[[0, 0, 1]]], points[[[0, 0, 1]]])[0]) == 0


def test_the_pose_survives_sixty_percent_of_wrong_matches():
    bearings, points, pose, rng = scene(400)
    wrong = rng.random(400) < 0.6
    bearings[~wrong] += rng.normal(0, 0.003, bearings[~wrong].shape)
    bearings[wrong] = rng.normal(size=bearings[wrong].shape)
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    estimate, inliers = robust_pose(bearings, points, np.deg2rad(1), 500, rng)
    translation, rotation = pose_errors(estimate, pose)
    # 160 bearings of 3 mrad at about 4 m: 12 mm a match, an eighth of that together
    assert translation < 0.005
    assert rotation < np.deg2rad(0.1)
    assert (inliers & ~wrong).sum() >= 0.97 * (~wrong).sum()


def test_every_inlier_has_its_share_in_the_pose():
    errors = []
    for seed in range(20):
        bearings, points, pose, rng = scene(400, seed)
        bearings += rng.normal(0, 0.006, bearings.shape)
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
        errors.append(pose_errors(robust_pose(bearings, points, np.deg2rad(1), 500, rng)[0], pose))
    translation, rotation = np.max(errors, axis=0)
    # 400 bearings of 6 mrad: a twentieth of that together, and three times as much at worst; a pose of three of them is
    # off by degrees
    assert translation < 0.006
    assert rotation < np.deg2rad(0.06)


def test_matches_by_chance_have_few_inliers_and_no_crash():
    for seed in range(20):
        rng = np.random.default_rng((seed, 5))
        bearings = rng.normal(size=(rng.integers(4, 60), 3))
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
        pose, inliers = robust_pose(bearings, rng.uniform(-4, 4, bearings.shape), np.deg2rad(1), 100, rng)
        assert np.isfinite(pose).all()
        assert inliers.sum() < 10


def test_too_few_or_only_degenerate_matches_have_no_inliers():
    bearings, points, _, rng = scene(3)
    assert robust_pose(bearings, points, 0.02, 50, rng)[1].sum() == 0
    same = np.tile(bearings[:1], (10, 1)), np.tile(points[:1], (10, 1))
    assert robust_pose(*same, 0.02, 50, rng)[1].sum() == 0
