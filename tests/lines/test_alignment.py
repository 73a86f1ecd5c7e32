"""Positions relative to 3D lines, estimated from arcs of those lines."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_lines.alignment import AGREE_RAD, SEARCH, agreement, refine, search
from salframe_lines.arcs import Arcs, Lines3d, project_lines

POSITION_M = np.array([0.4, -0.3, 0.02])


def shifted(*by_m):
    return POSITION_M + np.array(by_m)


def room_lines(rng, count=12):
    """Lines on the walls, floor and ceiling of a room 5 x 4 x 2.6 m around the origin."""
    half_m, lines = np.array([2.5, 2.0, 1.3]), []
    for axis in range(3):
        first, second = half_m[(axis + 1) % 3], half_m[(axis + 2) % 3]
        across_m = rng.uniform(-1, 1, (count, 2)) * (first, second)
        on_first = rng.random(count) < 0.5
        across_m[on_first, 0], across_m[~on_first, 1] = (
            np.copysign(first, across_m[on_first, 0]),
            np.copysign(second, across_m[~on_first, 1]),
        )
        along_m = np.sort(rng.uniform(-half_m[axis], half_m[axis], (count, 2)), axis=1)
        lines.append(Lines3d(across_m, along_m + np.array([-0.2, 0.2])))
    return lines


@pytest.fixture(scope="module")
def lines():
    return room_lines(np.random.default_rng(0))


@pytest.fixture(scope="module")
def arcs(lines):
    return [project_lines(lines[axis], axis, POSITION_M) for axis in range(3)]


def test_all_arcs_agree_where_they_were_seen_from_and_few_elsewhere(arcs, lines):
    shares = agreement(arcs, lines, np.stack([POSITION_M, shifted(0.3, 0.2, 0), shifted(0.003, 0, 0)]), AGREE_RAD)
    assert shares[0] == pytest.approx(1, abs=1e-5)
    assert shares[1] < 0.35
    assert 0.8 < shares[2] < shares[0]


def test_half_the_arcs_explained_is_half_the_agreement(arcs, lines):
    without = [lines[0], lines[1], Lines3d(np.zeros((0, 2)), np.zeros((0, 2)))]
    length = [np.minimum(np.diff(along.along_rad), 0.5).sum() for along in arcs]
    assert agreement(arcs, without, POSITION_M[None], AGREE_RAD)[0] == pytest.approx(
        sum(length[:2]) / sum(length), abs=1e-5
    )


def test_the_search_ends_within_reach_of_the_refinement(arcs, lines):
    rng = np.random.default_rng(1)
    for _ in range(10):
        position_m = search(arcs, lines, POSITION_M * (1, 1, 0) + [*rng.uniform(-0.2, 0.2, 2), 0])
        assert np.abs(position_m[:2] - POSITION_M[:2]).max() <= SEARCH[-1][0]


def test_the_refinement_is_exact_on_exact_arcs(arcs, lines):
    position_m, turn_rad = refine(arcs, lines, shifted(0.03, -0.03, -0.02))
    np.testing.assert_allclose(position_m, POSITION_M, atol=1e-4)
    assert abs(turn_rad) < 1e-5


def test_the_refinement_is_not_misled_by_arcs_of_other_lines(arcs, lines):
    rng = np.random.default_rng(2)
    others = [Arcs(rng.uniform(-np.pi, np.pi, 12), np.sort(rng.uniform(0.3, 2.8, (12, 2)), axis=1)) for _ in range(3)]
    mixed = [
        Arcs(*(np.concatenate(parts) for parts in zip(*pair, strict=True))) for pair in zip(arcs, others, strict=True)
    ]
    position_m, _ = refine(mixed, lines, shifted(0.03, -0.03, 0))
    np.testing.assert_allclose(position_m, POSITION_M, atol=0.005)


def test_a_small_turn_of_the_query_is_found(arcs, lines):
    turn_rad = np.deg2rad(0.3)
    turned = [
        _turned(along, axis, -turn_rad) for axis, along in enumerate(arcs)
    ]  # in a query rotated to the left, lines are further right
    position_m, estimate_rad = refine(turned, lines, shifted(0.02, 0.02, 0))
    assert estimate_rad == pytest.approx(turn_rad, abs=2e-4)
    np.testing.assert_allclose(position_m, POSITION_M, atol=0.003)


def _turned(arcs, axis, angle_rad):
    """Return arcs whose middles are rotated about the vertical."""
    middle_rad = arcs.along_rad.mean(1)
    local = np.stack(
        [
            np.cos(middle_rad),
            np.sin(middle_rad) * np.cos(arcs.around_rad),
            np.sin(middle_rad) * np.sin(arcs.around_rad),
        ],
        axis=1,
    )
    x, y, z = np.roll(local, axis, axis=1).T
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    _, first, second = np.roll(np.stack([c * x - s * y, s * x + c * y, z], axis=1), -axis, axis=1).T
    return Arcs(np.arctan2(second, first), arcs.along_rad)


def test_without_lines_the_position_stays():
    nothing, no_arcs = [Lines3d(np.zeros((0, 2)), np.zeros((0, 2)))] * 3, [Arcs(np.zeros(0), np.zeros((0, 2)))] * 3
    position_m, turn_rad = refine(no_arcs, nothing, POSITION_M)
    np.testing.assert_array_equal(position_m, POSITION_M)
    assert turn_rad == 0
    assert agreement(no_arcs, nothing, POSITION_M[None], AGREE_RAD) == 0
