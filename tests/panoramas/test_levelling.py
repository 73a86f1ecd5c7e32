"""The tilt of a camera is estimated, and panoramas are turned. Rooms are rendered at tilted poses by their own code."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels
from salframe.panoramas.levelling import (
    MIN_TILT_DEG,
    estimate_level_rotation,
    pose_level_rotation,
    turn_image,
    turn_panorama,
)
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama
from salframe.panoramas.tilt import level_rotation, up_from_lines, up_from_range
from salframe.testing.rooms import ROOMS, look, stand

TILTS = [(8.0, 0.3), (8.0, 2.5), (3.0, -1.0), (25.0, 1.7), (38.0, -2.2)]


def tilted_stand(tilt_deg, axis_rad, room=ROOMS[2]):
    """Return the pose of a camera in a room, tilted about a horizontal axis of the world."""
    pose = stand(room)
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0])
    pose[:3, :3] = Rotation.from_rotvec(np.radians(tilt_deg) * axis).as_matrix() @ pose[:3, :3]
    return pose


def angle_deg(first, second):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))


@pytest.mark.parametrize(("tilt_deg", "axis_rad"), TILTS)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_tilt_of_a_rendered_room_is_estimated_from_its_range(tilt_deg, axis_rad, noise):
    pose = tilted_stand(tilt_deg, axis_rad)
    range_m = look(ROOMS[2], "q", pose, {"range"}).range_m
    range_m = range_m * (1 + noise * np.random.default_rng(0).standard_normal(range_m.shape)).astype(np.float32)
    range_m[np.random.default_rng(1).random(range_m.shape) < 0.1] = np.nan
    assert angle_deg(up_from_range(range_m), pose[2, :3]) < 1


@pytest.mark.parametrize("room", ROOMS, ids=[room.name for room in ROOMS])
def test_level_panoramas_do_not_change(room):
    panorama = look(room, "q", stand(room), {"range"})
    assert angle_deg(up_from_range(panorama.range_m), np.array([0, 0, 1.0])) < 0.2
    assert estimate_level_rotation(panorama, {"range"}) is None
    barely = look(room, "q", tilted_stand(0.8 * MIN_TILT_DEG, 0.4, room), {"range"})
    assert estimate_level_rotation(barely, {"range"}) is None


def test_no_tilt_is_estimated_where_the_surfaces_do_not_show_it():
    shape = 96, 192
    smooth = np.kron(np.random.default_rng(0).uniform(1, 4, (12, 24)), np.ones((8, 8))).astype(np.float32)
    for range_m in (np.full(shape, np.nan), np.full(shape, 3.0), smooth):
        assert up_from_range(range_m.astype(np.float32)) is None


def edges_of_a_box(pose):
    """Return the ends (N, 2, 3) of the edges of a room with windows, seen from a pose inside of it."""
    corners = [np.array([x, y, z]) for x in (-2.5, 2.5) for y in (-2, 2) for z in (0, 2.6)]
    for x, y in ((-2.5, None), (2.5, None), (None, -2.0), (None, 2.0)):
        for shift in (-1.2, -0.3, 0.5, 1.4):
            corners += [np.array([shift if x is None else x, shift if y is None else y, z]) for z in (0.8, 1.9)]
    pairs = [
        (a, b)
        for i, a in enumerate(corners)
        for b in corners[:i]
        if np.count_nonzero(a != b) == 1 and np.linalg.norm(a - b) > 0.5
    ]
    ends = (np.array(pairs) - pose[:3, 3]) @ pose[:3, :3]
    return ends / np.linalg.norm(ends, axis=2, keepdims=True)


@pytest.mark.parametrize(("tilt_deg", "axis_rad"), [(0.0, 0.0), *TILTS])
def test_the_tilt_is_estimated_from_lines(tilt_deg, axis_rad):
    pose = tilted_stand(tilt_deg, axis_rad)
    pose[:3, 3] = 0.3, -0.4, 1.5
    ends, rng = edges_of_a_box(pose), np.random.default_rng(0)
    stray = rng.standard_normal((20, 2, 3)) * 0.2 + rng.standard_normal((20, 1, 3))
    stray /= np.linalg.norm(stray, axis=2, keepdims=True)
    assert angle_deg(up_from_lines(np.concatenate([ends, stray])), pose[2, :3]) < 1


def test_lines_in_random_directions_show_no_tilt():
    ends = np.random.default_rng(3).standard_normal((300, 2, 3))
    ends /= np.linalg.norm(ends, axis=2, keepdims=True)
    assert up_from_lines(ends) is None
    assert up_from_lines(np.zeros((0, 2, 3))) is None


@pytest.mark.parametrize("up", [(0, 0, 1), (0.1, -0.2, 0.9), (0.1, 0.2, -0.9), (0, 0, -1), (1, 0, 0)])
def test_a_level_rotation_is_the_smallest_that_turns_up(up):
    up = np.array(up, float) / np.linalg.norm(up)
    rotation = Rotation.from_matrix(level_rotation(up))
    np.testing.assert_allclose(rotation.apply(up), [0, 0, 1], atol=1e-12)
    assert rotation.magnitude() == pytest.approx(np.arccos(up[2]))


def test_a_tilted_room_is_turned_to_what_a_level_camera_sees():
    room, tilted = ROOMS[0], tilted_stand(12, 0.8, ROOMS[0])
    panorama = look(room, "q", tilted)
    rotation = pose_level_rotation(tilted)
    turned = turn_panorama(panorama, rotation)
    level_pose = tilted.copy()
    level_pose[:3, :3] = tilted[:3, :3] @ rotation.T
    np.testing.assert_allclose(level_pose[2, :3], [0, 0, 1], atol=1e-12)
    truth = look(room, "q", level_pose)
    assert np.mean(np.abs(turned.range_m - truth.range_m) < 0.05) > 0.98
    assert np.mean(turned.annotations.instance_id == truth.annotations.instance_id) > 0.98
    assert np.median(np.abs(turned.rgb.astype(int) - truth.rgb)) < 12


def test_an_upside_down_pose_is_levelled_and_a_level_one_is_not():
    upside_down = np.diag([1.0, -1, -1, 1])
    np.testing.assert_allclose(pose_level_rotation(upside_down), np.diag([1.0, -1, -1]), atol=1e-12)
    assert pose_level_rotation(stand(ROOMS[0])) is None
    assert pose_level_rotation(tilted_stand(0.9, 0.1)) is None


def test_pixels_go_where_their_rays_go():
    rotation = Rotation.from_euler("xyz", [20, -15, 40], degrees=True).as_matrix()
    image = np.arange(64 * 128).reshape(64, 128)
    turned = turn_image(image, rotation)
    columns, rows = rays_to_pixels(equirectangular_rays(64) @ rotation, 64)
    np.testing.assert_array_equal(turned, image[np.minimum(rows.astype(int), 63), columns.astype(int) % 128])


def test_objects_of_a_list_are_turned():
    objects = ObjectBoxes(("bed",), ("1",), np.array([[1.0, 2, 3]]), np.ones((1, 3)), np.array([0.3]))
    rotation = Rotation.from_euler("z", 50, degrees=True) * Rotation.from_euler("x", 10, degrees=True)
    panorama = Panorama("q", annotations=Annotations(objects=objects))
    turned = turn_panorama(panorama, rotation.as_matrix()).annotations.objects
    np.testing.assert_allclose(turned.centroid_m, rotation.apply(objects.centroid_m.copy()))
    along = rotation.apply([np.cos(0.3), np.sin(0.3), 0])
    assert turned.yaw_rad[0] == pytest.approx(np.arctan2(along[1], along[0]))
