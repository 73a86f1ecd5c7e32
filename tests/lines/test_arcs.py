"""Segments, directions and lines of a room with known edges."""

from __future__ import annotations

import numpy as np
import pytest
from plain_room import EYE_M, SIZE_M
from salframe_lines.arcs import (
    Arcs,
    Lines3d,
    arcs_along_axes,
    lift_arcs,
    line_distances,
    principal_yaw,
    project_lines,
    rotate_by_quarter_turn,
)

from salframe.panoramas.geometry import pose_2d, wrap_angle
from salframe.panoramas.line_segments import find_segments

YAW_RAD = 0.4
POSE = pose_2d(2.1, 1.7, YAW_RAD, EYE_M)


def described(room, pose, limit=100):
    """Return principal yaw, arcs, and lines in the principal frame."""
    panorama = room.panorama("room", pose)
    ends = find_segments(panorama.rgb, None)
    yaw_rad = principal_yaw(ends)
    arcs = arcs_along_axes(ends, yaw_rad, limit)
    lines = [lift_arcs(arcs[k], line_distances(arcs[k], k, yaw_rad, panorama.range_m)) for k in range(3)]
    return yaw_rad, arcs, lines


@pytest.mark.parametrize("yaw_deg", [0.0, 17.3, 44.9, 90.0, -121.0])
def test_the_walls_directions_are_found(rooms, yaw_deg):
    yaw_rad = np.deg2rad(yaw_deg)
    estimate_rad = principal_yaw(find_segments(rooms[0].panorama("room", pose_2d(2.1, 1.7, yaw_rad, EYE_M)).rgb, None))
    # the walls run along the world's axes, which are at -yaw in the panorama
    assert abs(wrap_angle(4 * (estimate_rad + yaw_rad)) / 4) < np.deg2rad(0.1)


def test_every_edge_of_the_room_is_found_where_it_is(rooms):
    yaw_rad, _, lines = described(rooms[0], POSE)
    quarter = round((YAW_RAD + yaw_rad) / (np.pi / 2))
    assert (
        quarter == 1
    )  # so that the principal frame is turned by 90 degrees from the world: x is the world's y, y its -x
    eye = POSE[:3, 3]
    for low in (
        0.0,
        SIZE_M[2],
    ):  # floor and ceiling, along the world's x: the principal frame's y, whose neighbours are z and x
        for wall in (0.0, SIZE_M[1]):
            off_m = np.linalg.norm(lines[1].across_m - (low - eye[2], wall - eye[1]), axis=1)
            assert off_m.min() < 0.03
            assert np.diff(lines[1].along_m[off_m.argmin()])[0] == pytest.approx(SIZE_M[0], rel=0.25)
    for corner in ((0, 0), (0, 1), (1, 0), (1, 1)):  # the vertical edges
        x_m, y_m = SIZE_M[:2] * corner - eye[:2]
        off_m = np.linalg.norm(lines[2].across_m - (y_m, -x_m), axis=1)
        assert off_m.min() < 0.03
        np.testing.assert_allclose(lines[2].along_m[off_m.argmin()], (-eye[2], SIZE_M[2] - eye[2]), atol=0.15)


def test_no_line_is_where_no_edge_is(rooms):
    _, _, lines = described(rooms[0], POSE)
    room = rooms[0]
    heights_m = [
        0,
        SIZE_M[2],
        *(limit[1] for normal, _, low, high, _ in room.rectangles if normal != 2 for limit in (low, high)),
    ]
    for axis in (0, 1):  # of a line on a wall or the floor, the height is that of an edge
        z_m = lines[axis].across_m[:, 1 - axis] + EYE_M
        on_wall = (z_m > 0.1) & (z_m < SIZE_M[2] - 0.1)
        assert on_wall.sum() >= 3
        assert np.abs(z_m[on_wall, None] - heights_m).min(1).max() < 0.04


def test_an_arc_is_not_lifted_across_surfaces_of_different_distance():
    arcs = Arcs(np.array([0.0]), np.array([[1.0, 2.0]]))  # upright, ahead
    range_m = np.full((64, 128), 2.0, np.float32)
    # a cylinder of radius 2 around the eye stands at one distance from a vertical line, a sphere does not
    cylinder_m = np.repeat((2.0 / np.sin(np.pi * (np.arange(64) + 0.5) / 64)).astype(np.float32)[:, None], 128, axis=1)
    assert line_distances(arcs, 2, 0.0, cylinder_m)[0] == pytest.approx(2.0, rel=0.02)
    range_m[::2] = 3.0
    range_m[1::4] = 5.0
    assert np.isnan(
        line_distances(Arcs(arcs.around_rad, np.array([[0.4, 2.7]])), 2, 0.0, np.repeat(range_m[:, :1], 128, axis=1))
    )[0]
    assert np.isnan(line_distances(arcs, 2, 0.0, np.full((64, 128), np.nan, np.float32)))[0]


def test_pieces_of_a_line_are_joined_and_the_longest_kept():
    def piece(around_rad, low_rad, high_rad):
        return [
            [np.sin(t) * np.cos(around_rad), np.sin(t) * np.sin(around_rad), np.cos(t)] for t in (low_rad, high_rad)
        ]

    ends = np.array(
        [
            piece(0.5, 1.0, 1.3),
            piece(0.501, 1.29, 1.6),
            piece(0.5, 1.7, 1.9),
            piece(2.0, 1.2, 1.5),
            piece(-1.0, 1.5, 1.52),
        ]
    )
    arcs = arcs_along_axes(ends, 0.0, 100)[2]  # the fourth is a separate line, the last is too short
    np.testing.assert_allclose(arcs.along_rad, [[1.0, 1.6], [1.2, 1.5], [1.7, 1.9]], atol=1e-9)
    np.testing.assert_allclose(arcs.around_rad, [0.5005, 2.0, 0.5], atol=5e-4)
    assert len(arcs_along_axes(ends, 0.0, 1)[2].around_rad) == 1


def test_a_position_sees_lines_as_points_on_them_are_seen():
    rng = np.random.default_rng(3)
    for axis in range(3):
        lines = Lines3d(rng.uniform(-2, 2, (5, 2)), np.sort(rng.uniform(-2, 2, (5, 2)), axis=1))
        position_m = rng.uniform(-0.5, 0.5, 3)
        arcs = project_lines(lines, axis, position_m)
        for line in range(5):
            for end in (0, 1):
                point = np.empty(3)
                point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3] = (
                    lines.along_m[line, 1 - end],
                    *lines.across_m[line],
                )
                x, y, z = np.roll((point - position_m) / np.linalg.norm(point - position_m), -axis)
                assert arcs.around_rad[line] == pytest.approx(np.arctan2(z, y))
                assert arcs.along_rad[line, end] == pytest.approx(np.arccos(x))


def test_a_quarter_turn_of_the_arcs_is_that_of_the_lines():
    rng = np.random.default_rng(4)
    middle = rng.normal(size=(60, 3))
    axes = np.eye(3)[rng.integers(0, 3, 60)]
    ends = np.stack([middle - 0.4 * axes, middle + 0.4 * axes], axis=1)
    ends /= np.linalg.norm(ends, axis=2, keepdims=True)
    turned = ends @ pose_2d(0, 0, np.pi / 2)[:3, :3].T
    for expected, rotated in zip(
        arcs_along_axes(turned, 0.0, 100), rotate_by_quarter_turn(arcs_along_axes(ends, 0.0, 100)), strict=True
    ):
        order = [np.lexsort((arcs.along_rad[:, 1], arcs.along_rad[:, 0])) for arcs in (expected, rotated)]
        np.testing.assert_allclose(rotated.along_rad[order[1]], expected.along_rad[order[0]], atol=1e-9)
        np.testing.assert_allclose(
            wrap_angle(rotated.around_rad[order[1]] - expected.around_rad[order[0]]), 0, atol=1e-9
        )
