"""Resection: poses from exact directions are exact, and what directions cannot tell is not told."""

import numpy as np
import pytest
from salframe_graphs.positioning import LeastSquaresPositioner, RobustPositioner
from scipy.optimize import least_squares

from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, pose_yaw, transform_points, wrap_angle


def directions(T_reference_query, points_m):
    seen = transform_points(invert_pose(T_reference_query), np.asarray(points_m, float))
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)


def random_points(seed, count):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-4, 4, (count, 2)), rng.uniform(-1.4, 1.0, count)])


@pytest.mark.parametrize("count", [3, 4, 8, 15])
def test_exact_directions_give_the_exact_pose(count):
    for seed in range(20):
        rng = np.random.default_rng((count, seed))
        truth = pose_2d(*rng.uniform(-1.5, 1.5, 2), rng.uniform(-np.pi, np.pi))
        points_m = random_points((seed, count), count)
        found = RobustPositioner().resect(directions(truth, points_m), points_m)
        if found.status == "degenerate":  # three points that leave it too uncertain
            assert count < 5
            continue
        assert found.status == "ok"
        assert max(pose_errors(found.T_reference_query, truth)) < 1e-6
        assert found.inliers.all()


def test_three_azimuths_are_enough():
    """Points as high as the camera: their elevations tell nothing. Corners of a square of side 2 around the point
    (1, 1), seen from (1, 0): to the left corners 45 degrees up and down from straight ahead, and so on."""
    points_m = np.array([(0.0, 1.0, 0), (1.0, 1.0, 0), (2.0, 1.0, 0), (0.0, -2.0, 0)])
    azimuth = np.radians([135, 90, 45, -90 - np.degrees(np.arctan(0.5))]) - np.radians(30)
    bearing = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(4)])
    for used in ([0, 1, 2], [0, 1, 2, 3]):
        found = RobustPositioner().resect(bearing[used], points_m[used])
        assert max(pose_errors(found.T_reference_query, pose_2d(1, 0, np.radians(30)))) < 1e-9


def test_from_the_circle_through_three_points_there_is_no_position():
    """All of it sees the points under the same angles; a fourth point, or heights, tell."""
    angle = np.radians([0, 80, 200])
    points_m = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.zeros(3)])
    truth = pose_2d(2 * np.cos(2.5), 2 * np.sin(2.5), 0.7)
    found = RobustPositioner().resect(directions(truth, points_m), points_m)
    assert (found.status, found.T_reference_query) == ("degenerate", None)
    more = np.vstack([points_m, (0.5, 0.3, 0)])
    assert max(pose_errors(RobustPositioner().resect(directions(truth, more), more).T_reference_query, truth)) < 1e-6
    high = points_m + np.array([(0, 0, -1.2), (0, 0, 0.8), (0, 0, -0.9)])
    assert max(pose_errors(RobustPositioner().resect(directions(truth, high), high).T_reference_query, truth)) < 1e-6


def test_two_directions_give_a_heading_where_elevations_tell_distances():
    truth, points_m = pose_2d(0.4, -0.3, 1.9), np.array([(2.0, 1.0, -1.1), (-1.5, 1.2, -0.9)])
    found = RobustPositioner().resect(directions(truth, points_m), points_m)
    assert (found.status, found.T_reference_query) == ("too-few", None)
    assert found.yaw_rad == pytest.approx(1.9, abs=1e-6)
    level = points_m * (1, 1, 0)
    found = RobustPositioner().resect(directions(truth, level), level)
    assert (found.T_reference_query, found.yaw_rad) == (None, None)


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_give_nothing(count):
    points_m = random_points(0, count)
    found = RobustPositioner().resect(directions(np.eye(4), points_m), points_m)
    assert (found.status, found.T_reference_query, found.yaw_rad) == ("too-few", None, None)


def test_wrong_matches_are_told():
    truth, points_m = pose_2d(0.8, 0.5, -2.0), random_points(3, 10)
    bearing = directions(truth, points_m)
    bearing[[2, 7]] = bearing[[7, 2]]
    found = RobustPositioner().resect(bearing, points_m)
    assert max(pose_errors(found.T_reference_query, truth)) < 1e-6
    assert np.flatnonzero(~found.inliers).tolist() == [2, 7]


def test_two_poses_of_equal_support_are_none():
    first, second = pose_2d(1.0, 0.5, 0.2), pose_2d(-1.0, -0.8, 2.5)
    points_m = random_points(5, 8)
    bearing = np.vstack([directions(first, points_m[:4]), directions(second, points_m[4:])])
    found = RobustPositioner(RobustPositioner.Config(tolerance_m=0.2)).resect(bearing, points_m)
    assert (found.status, found.T_reference_query) == ("ambiguous", None)


def test_noisy_directions_give_scipys_least_squares_and_an_honest_covariance():
    """The pose of least squared distances between points and rays; errors as large as the covariance says."""
    truth, points_m = pose_2d(0.5, -0.6, 0.9), random_points(7, 9)
    errors, stated = [], []
    for seed in range(150):
        noisy = points_m + np.random.default_rng(seed).normal(0, 0.15, points_m.shape)
        bearing = directions(truth, noisy)

        def distances(x, bearing=bearing):
            seen = transform_points(invert_pose(pose_2d(*x)), points_m)
            azimuth = np.arctan2(bearing[:, 1], bearing[:, 0])
            ahead = seen[:, 0] * np.cos(azimuth) + seen[:, 1] * np.sin(azimuth)
            beside = seen[:, 1] * np.cos(azimuth) - seen[:, 0] * np.sin(azimuth)
            return np.r_[beside, seen[:, 2] * np.sqrt(1 - bearing[:, 2] ** 2) - ahead * bearing[:, 2]]

        found = RobustPositioner().resect(bearing, points_m)
        pose = found.T_reference_query
        if found.inliers.all():
            best = least_squares(distances, [0.5, -0.6, 0.9]).x
            np.testing.assert_allclose([*pose[:2, 3], pose_yaw(pose)], best, atol=1e-5)
        errors.append([*(pose[:2, 3] - truth[:2, 3]), wrap_angle(pose_yaw(pose) - 0.9)])
        stated.append(np.diag(found.covariance))
    np.testing.assert_allclose(np.std(errors, 0), np.sqrt(np.mean(stated, 0)), rtol=0.35)


def test_a_positioner_of_points_says_that_it_needs_range():
    points_m = random_points(1, 5)
    assert LeastSquaresPositioner().resect(directions(np.eye(4), points_m), points_m).status == "no-range"
