from __future__ import annotations

import numpy as np
import pytest
from colmap_writer import optical_pose
from salframe_import.colmap_world import floor_height, up_direction, upright_rotation
from scipy.spatial.transform import Rotation

from salframe.framework.errors import DataError


def turned(turn: Rotation, poses: list[np.ndarray]) -> list[np.ndarray]:
    T = np.eye(4)
    T[:3, :3] = turn.as_matrix()
    return [T @ pose for pose in poses]


def test_up_of_tilted_cameras_that_look_to_all_sides():
    """Cameras that look down by 20 deg: their tilts cancel out."""
    turn = Rotation.from_euler("xyz", [40, -70, 110], degrees=True)
    poses = turned(turn, [optical_pose(0, 0, 0, yaw, -20) for yaw in range(0, 360, 45)])
    assert np.allclose(up_direction(poses), turn.apply([0, 0, 1]), atol=1e-12)


def test_up_of_a_cube_rig():
    poses = [optical_pose(0, 0, 0, yaw) for yaw in (0, 90, 180, 270)]
    poses += [optical_pose(0, 0, 0, 0, pitch) for pitch in (-90, 90)]
    assert np.allclose(up_direction(poses), (0, 0, 1))


def test_pictures_upside_down_are_named():
    poses = [optical_pose(0, 0, 0, 0), optical_pose(0, 0, 0, 90) @ np.diag([-1.0, -1, 1, 1])]
    with pytest.raises(
        DataError, match=r"the pictures of the COLMAP model have different up directions .* length 0\.00, expected 0\.5"
    ):
        up_direction(poses)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (0.6, 0, 0.8), (0.48, -0.64, -0.6)])
def test_upright_rotation(up):
    rotation = upright_rotation(np.array(up, float))
    assert np.allclose(rotation @ up, (0, 0, 1))
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert Rotation.from_matrix(rotation).magnitude() == pytest.approx(np.arccos(up[2]))  # the smallest one


def room_points(rng: np.random.Generator) -> np.ndarray:
    """Heights of points of a room, in metres: a floor at 0, a table at 0.75, walls, and points below the floor."""
    return np.concatenate(
        [rng.normal(0, 0.01, 1000), rng.normal(0.75, 0.005, 1500), rng.uniform(0, 2.5, 1500), rng.uniform(-3, 0, 30)]
    )


def test_the_floor_is_the_lowest_level_with_many_points():
    rng = np.random.default_rng(0)
    unit = 0.4
    heights = (room_points(rng) + 7) / unit
    cameras = (7 + 1.5 + rng.normal(0, 0.02, 40)) / unit
    assert floor_height(heights, cameras) * unit == pytest.approx(7, abs=0.02)


def test_too_few_points_are_named():
    with pytest.raises(DataError, match=r"has 20 points below the cameras, expected at least 50 .*pass --set scale"):
        floor_height(np.linspace(-1, 0, 20), np.ones(3))


def test_cameras_of_two_storeys_are_named():
    points = room_points(np.random.default_rng(0))
    with pytest.raises(DataError, match=r"differ by .* pass --set scale"):
        floor_height(np.concatenate([points, points + 3]), np.repeat([1.5, 4.5], 10))
