"""The outline of free space against the walls of a box room."""

import numpy as np
import pytest
from salframe_graphs.places.likelihood import Poses
from salframe_graphs.places.outline import MapOutlines, free_outline, pack_outline, unpack_outline
from salframe_graphs.sectors import BINS

from salframe.panoramas.geometry import equirectangular_rays, wrap_angle

HALF = np.array([3.0, 2.0])


def walls(azimuth_rad, position_m=(0.0, 0.0)):
    """Horizontal distance to the walls of a 6 x 4 m room."""
    direction = np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad)], -1)
    return ((np.sign(direction) * HALF - position_m) / direction).min(-1)


def seen_from(position_m, yaw_rad):
    """(H, 2H) range in the room without floor and ceiling, from a camera at a position, turned."""
    rays = equirectangular_rays(180)
    azimuth = np.arctan2(rays[..., 1], rays[..., 0]) + yaw_rad
    return walls(azimuth, position_m) / np.hypot(rays[..., 0], rays[..., 1])


def middles(yaw_rad=0.0):
    return (np.arange(BINS) + 0.5) * 2 * np.pi / BINS + yaw_rad


def test_the_outline_of_a_box_room_is_its_walls():
    position, yaw = np.array([0.7, -0.4]), 1.1
    outline = free_outline(seen_from(position, yaw))
    assert (outline.shape, outline.dtype) == ((BINS,), np.float32)
    exact = walls(middles(yaw), position)
    corners = np.arctan2(*(np.array([[s * 3, t * 2] for s in (-1, 1) for t in (-1, 1)]) - position).T[::-1])
    smooth = np.abs(wrap_angle(middles(yaw)[:, None] - corners)).min(1) > np.radians(5)
    np.testing.assert_allclose(outline[smooth], exact[smooth], rtol=0.03)
    assert smooth.sum() > 60


def test_what_has_no_range_has_no_outline():
    assert np.isnan(free_outline(np.full((90, 180), np.nan, np.float32))).all()
    half = seen_from((0.0, 0.0), 0.0)
    half[:, :180] = np.nan  # the left half of the image: azimuth 0 to pi
    known = np.isfinite(free_outline(half))
    assert known[BINS // 2 :].all()
    assert not known[: BINS // 2].any()


def test_packed_it_is_two_bytes_a_bin():
    packed = pack_outline(np.array([1.2344, np.nan, 99.0], np.float32))
    assert (packed.dtype, packed.tolist()) == (np.uint16, [1234, 0, 65535])
    back = unpack_outline(packed)
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, [1.234, np.nan, 65.535], rtol=1e-6)


@pytest.mark.parametrize("turned", [0.0, 2.0])
def test_the_true_pose_fits_best(turned):
    """Of poses off by half a metre and more, or by a quarter turn, none fits like the true one."""
    outlines = MapOutlines.of(walls(middles())[None, None], np.zeros((1, 1, 3)))
    position, yaw = np.array([0.9, 0.5]), turned
    query = free_outline(seen_from(position, yaw))
    shifts = position + np.array([[0, 0], [0.6, 0], [0, 0.6], [-0.8, -0.8], [0, 0]])
    yaws = yaw + np.array([0, 0, 0, 0, np.pi / 2])
    ratio = outlines.ratio(query, Poses(np.zeros(5, int), shifts, yaws))
    assert ratio[0] > 100
    assert (ratio[0] > ratio[1:] + 30).all()


def test_a_place_without_an_outline_is_not_judged_by_one():
    outlines = MapOutlines.of(np.full((1, 2, BINS), np.nan), np.zeros((1, 2, 3)))
    assert outlines.ratio(walls(middles()), Poses(np.zeros(1, int), np.zeros((1, 2)), np.zeros(1))).tolist() == [0.0]
