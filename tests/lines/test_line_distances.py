"""Line distance functions against points sampled along the arcs."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_lines.arcs import Arcs, Lines3d, project_lines
from salframe_lines.distances import (
    CODES_PER_RAD,
    MAX_CODE,
    agreeing_share,
    distance_codes,
    distance_codes_from,
    sphere_points,
)


def sampled(arcs, axis):
    """(N, 2001, 3) points along arcs."""
    along_rad = np.linspace(*arcs.along_rad.T, 2001, axis=1)
    around_rad = arcs.around_rad[:, None]
    local = np.stack(
        [np.cos(along_rad), np.sin(along_rad) * np.cos(around_rad), np.sin(along_rad) * np.sin(around_rad)], axis=-1
    )
    return np.roll(local, axis, axis=-1)


def random_arcs(rng, count):
    return Arcs(rng.uniform(-np.pi, np.pi, count), np.sort(rng.uniform(0.1, 3.0, (count, 2)), axis=1))


def test_points_cover_the_sphere():
    points = sphere_points(162)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-6)
    anywhere = np.random.default_rng(0).normal(size=(2000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    # 162 caps of this radius have twice the sphere's area
    assert np.arccos((anywhere @ points.T).max(1)).max() < 2 * np.sqrt(4 / 162)


def test_distances_are_those_to_the_nearest_point():
    rng, points = np.random.default_rng(1), sphere_points(162)
    arcs = [random_arcs(rng, count) for count in (1, 3, 7)]
    codes = distance_codes(arcs, points).reshape(3, 162)
    for axis in range(3):
        nearest_rad = np.arccos(np.clip(points @ sampled(arcs[axis], axis).reshape(-1, 3).T, -1, 1)).min(1)
        expected = np.minimum(nearest_rad * CODES_PER_RAD, MAX_CODE)
        np.testing.assert_allclose(
            codes[axis], expected, atol=1.3
        )  # a code is the whole part, and samples are 0.0015 rad apart


def test_a_direction_without_lines_is_far_from_all_points():
    none = Arcs(np.zeros(0), np.zeros((0, 2)))
    assert (distance_codes([none] * 3, sphere_points(10)) == MAX_CODE).all()
    assert (
        distance_codes_from([Lines3d(np.zeros((0, 2)), np.zeros((0, 2)))] * 3, np.zeros((9, 3)), sphere_points(10))
        == MAX_CODE
    ).all()


def test_lines_in_space_have_the_distances_of_the_arcs_they_are_seen_as():
    rng, points = np.random.default_rng(2), sphere_points(50)
    lines = [Lines3d(rng.uniform(-2, 2, (4, 2)), np.sort(rng.uniform(-2, 2, (4, 2)), axis=1)) for _ in range(3)]
    positions_m = rng.uniform(-0.5, 0.5, (11, 3))
    expected = [
        distance_codes([project_lines(lines[k], k, position) for k in range(3)], points) for position in positions_m
    ]
    np.testing.assert_array_equal(distance_codes_from(lines, positions_m, points), expected)


@pytest.mark.parametrize("within_rad", [0.05, 0.1, 0.3])
def test_the_share_of_agreeing_distances(within_rad):
    rng = np.random.default_rng(3)
    codes, query = (
        rng.integers(0, MAX_CODE + 1, (20, 300)).astype(np.uint8),
        rng.integers(0, MAX_CODE + 1, 300).astype(np.uint8),
    )
    expected = (np.abs(codes.astype(int) - query.astype(int)) <= round(within_rad * CODES_PER_RAD)).mean(1)
    np.testing.assert_allclose(agreeing_share(codes, query, within_rad), expected)
