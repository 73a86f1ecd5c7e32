import numpy as np
import pytest

from salframe.graphs.triangulation import triangulate


def rays_to(points_m, origins_m):
    """Origins, unit directions and targets of the rays from every origin to every point."""
    offset = points_m[:, None] - origins_m[None]
    direction = offset / np.linalg.norm(offset, axis=2, keepdims=True)
    target = np.repeat(np.arange(len(points_m)), len(origins_m))
    return np.tile(origins_m, (len(points_m), 1)), direction.reshape(-1, 3), target


ORIGINS = np.array([[0, 0, 1.5], [1.5, 0.2, 1.4], [0.3, 1.8, 1.6], [2.0, 2.0, 1.5], [-0.8, 1.0, 1.5]])


def test_noise_free_rays_meet_at_the_points():
    points = np.random.default_rng(0).uniform([-1, -1, 0], [2, 2, 2.5], (30, 3))
    origin, direction, target = rays_to(points, ORIGINS)
    assert triangulate(origin, direction, target, 30) == pytest.approx(points, abs=1e-6)


def test_one_bad_bearing_of_five_moves_the_position_little_where_least_squares_follows_it():
    point = np.array([[0.7, 0.9, 0.8]])
    origin, direction, target = rays_to(point, ORIGINS)
    c, s = np.cos(np.radians(25)), np.sin(np.radians(25))
    direction[2] = [
        c * direction[2, 0] - s * direction[2, 1],
        s * direction[2, 0] + c * direction[2, 1],
        direction[2, 2],
    ]
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    plain = np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, origin))
    robust = triangulate(origin, direction, target, 1)[0]
    assert np.linalg.norm(plain - point[0]) > 0.08
    assert np.linalg.norm(robust - point[0]) < 0.03


def test_two_rays_meet_halfway_between_them():
    origin = np.array([[0.0, 0, 0], [2, 0, 0.2]])
    direction = np.array([[1.0, 1, 0], [-1, 1, 0]]) / np.sqrt(2)
    assert triangulate(origin, direction, np.array([0, 0]), 1)[0] == pytest.approx([1, 1, 0.1], abs=1e-9)


def test_what_cannot_be_triangulated_is_nan():
    origin = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0], [2, 0, 0]])
    diverging, far = (
        np.array([[-1.0, 1, 0], [1, 1, 0]]) / np.sqrt(2),
        np.array([[1.0, 0, 0], [1, -0.05, 0] / np.hypot(1, 0.05)]),
    )
    sound = np.array([[1.0, 1, 0], [-1, 1, 0]]) / np.sqrt(2)
    direction = np.concatenate([[[1, 0, 0]], diverging, far, sound])
    position = triangulate(origin, direction, np.array([0, 1, 1, 2, 2, 4, 4]), 5)  # target 3 has no ray at all
    assert np.isnan(position[:4]).all()
    assert position[4] == pytest.approx([1, 1, 0], abs=1e-9)


def test_no_rays():
    assert triangulate(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, int), 0).shape == (0, 3)
