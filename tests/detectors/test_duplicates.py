"""How much two objects overlap, in closed form and by counting points on a sphere, and which are the same."""

import numpy as np
import pytest
from salframe_detectors.duplicates import angle_between, cap_radius, same_objects, shared_cap, shared_volume

from salframe.graphs.detections import Detections

CUBE = np.ones(3)


def box(x, y=0.0, z=0.0, size=(1, 1, 1), yaw_deg=0.0):
    return np.array([x, y, z], float), np.array(size, float), np.radians(yaw_deg)


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (box(0), box(0), 1),
        (box(0), box(0.3), 0.7),
        (box(0), box(0.3, 0.5, 0.2), 0.7 * 0.5 * 0.8),
        (box(0), box(0.1, size=(0.2, 0.2, 0.2)), 1),  # inside
        (box(0), box(0, yaw_deg=45), 2 * (np.sqrt(2) - 1)),  # an octagon
        (box(0, size=(4, 1, 1)), box(0, size=(4, 1, 1), yaw_deg=90), 1 / 4),
        (box(0, size=(4, 1, 1), yaw_deg=30), box(0, size=(4, 1, 1), yaw_deg=210), 1),
        (box(0), box(1.2), 0),
        (box(0), box(0, z=1.2), 0),
        (box(0, size=(4, 0.1, 1), yaw_deg=45), box(1.0, -1.0, size=(4, 0.1, 1), yaw_deg=45), 0),  # side by side
    ],
)
def test_boxes_share_a_volume(one, other, expected):
    assert shared_volume(one, other) == pytest.approx(expected, abs=1e-12)
    assert shared_volume(other, one) == pytest.approx(expected, abs=1e-12)


def sphere(count=400_000):
    """Points spread evenly (a Fibonacci lattice)."""
    number = np.arange(count) + 0.5
    z, azimuth = 1 - 2 * number / count, np.pi * (1 + np.sqrt(5)) * number
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], 1)


@pytest.mark.parametrize(
    ("apart", "one", "other"), [(10, 8, 6), (20, 30, 15), (5, 40, 38), (30, 20, 20), (60, 80, 70), (0.5, 4, 4)]
)
def test_caps_share_what_points_counted_in_both_say(apart, one, other):
    points, apart_rad = sphere(), np.radians(apart)
    centre = np.array([np.cos(apart_rad), np.sin(apart_rad), 0.0])
    in_one, in_other = points[:, 0] > np.cos(np.radians(one)), points @ centre > np.cos(np.radians(other))
    expected = (in_one & in_other).sum() / min(in_one.sum(), in_other.sum())
    assert shared_cap(apart_rad, np.radians(one), np.radians(other)) == pytest.approx(expected, abs=0.02)


def test_caps_inside_beside_and_of_no_size():
    assert shared_cap(0.1, 0.2, 0.5) == shared_cap(0.1, 0.5, 0.2) == 1
    assert shared_cap(0.71, 0.2, 0.5) == 0
    assert shared_cap(0.4, 0.0, 0.5) == 1  # a point inside
    assert shared_cap(0.6, 0.0, 0.5) == 0
    assert shared_cap(0.0, 0.0, 0.0) == 1
    assert shared_cap(1e-6, 0.0, 0.0) == 0


def test_a_cap_of_half_the_sphere_reaches_a_quarter_turn():
    assert cap_radius(2 * np.pi) == pytest.approx(np.pi / 2)
    assert cap_radius(np.pi * 0.01**2) == pytest.approx(0.01, rel=1e-4)
    assert cap_radius(np.nan) == 0
    assert angle_between(np.array([1.0, 0, 0]), np.array([np.cos(1e-7), np.sin(1e-7), 0])) == pytest.approx(1e-7)


def chairs(*x):
    """Cubes of 1 m in a row."""
    centroid = np.array([[at, 0.0, 0.0] for at in x]).reshape(-1, 3)
    return Detections(("chair",) * len(x), np.ones(len(x)), centroid, np.ones((len(x), 3)), np.zeros(len(x)))


def groups(found, of):
    return [group.tolist() for group in same_objects(found, np.array(of))]


def test_those_that_overlap_most_are_joined_first_and_a_detector_finds_an_object_once():
    found = chairs(0.0, 0.9, 0.4)
    assert groups(found, [0, 0, 1]) == [[0, 2], [1]]  # 0.6 with the first, 0.5 with the second
    assert groups(chairs(0.0, 0.3, 0.35), [0, 0, 1]) == [[0], [1, 2]]
    assert groups(chairs(0.0, 0.1), [0, 0]) == [[0], [1]]
    assert groups(chairs(0.0, 0.1, 0.2), [0, 1, 2]) == [[0, 1, 2]]
    assert groups(chairs(0.0, 0.1, 0.2, 0.25), [0, 1, 2, 1]) == [[0, 1], [2, 3]]
    assert groups(chairs(), []) == []
