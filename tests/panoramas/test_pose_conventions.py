"""The same camera, written in the axes of other programs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from salframe.panoramas.geometry import is_rigid, pose_2d
from salframe.panoramas.pose_conventions import NAMES, convert_pose

YAW_RAD, X_M, Y_M, Z_M = 0.7, 2.0, -3.0, 1.4
EXPECTED = pose_2d(X_M, Y_M, YAW_RAD, Z_M)
FORWARD, LEFT, UP = (
    np.array([np.cos(YAW_RAD), np.sin(YAW_RAD), 0]),
    np.array([-np.sin(YAW_RAD), np.cos(YAW_RAD), 0]),
    np.array([0, 0, 1]),
)


def camera(x_axis, y_axis, z_axis, position) -> np.ndarray:
    """Pose of a camera from the directions of its axes in the world."""
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x_axis, y_axis, z_axis])
    pose[:3, 3] = position
    return pose


POSITION = np.array([X_M, Y_M, Z_M])


def y_up(vector):
    """East, up, south: the axes of OpenGL and habitat-sim."""
    return np.array([vector[0], vector[2], -vector[1]])


def y_down(vector):
    """Right, down, forward of a first camera that looks along +x: the axes of ORB-SLAM and COLMAP."""
    return np.array([-vector[1], -vector[2], vector[0]])


def north_east_down(vector):
    return np.array([vector[1], vector[0], -vector[2]])


OPENCV = camera(-LEFT, -UP, FORWARD, POSITION)
WRITTEN = {
    "ros": EXPECTED,
    "ros-world-to-camera": np.linalg.inv(EXPECTED),
    "opencv": OPENCV,
    "opencv-world-to-camera": np.linalg.inv(OPENCV),
    "opencv-y-down": camera(y_down(-LEFT), y_down(-UP), y_down(FORWARD), y_down(POSITION)),
    "opencv-y-down-world-to-camera": np.linalg.inv(
        camera(y_down(-LEFT), y_down(-UP), y_down(FORWARD), y_down(POSITION))
    ),
    "opengl": camera(y_up(-LEFT), y_up(UP), y_up(-FORWARD), y_up(POSITION)),
    "opengl-world-to-camera": np.linalg.inv(camera(y_up(-LEFT), y_up(UP), y_up(-FORWARD), y_up(POSITION))),
    "opengl-z-up": camera(-LEFT, UP, -FORWARD, POSITION),
    # Unity: left-handed, x right, y up, z forward; its rotation turns clockwise about y, seen from above.
    "unity": np.block(
        [
            [Rotation.from_euler("y", -YAW_RAD).as_matrix(), np.array([[-Y_M], [Z_M], [X_M]])],
            [np.zeros((1, 3)), np.ones((1, 1))],
        ]
    ),
    "ned": camera(north_east_down(FORWARD), north_east_down(-LEFT), north_east_down(-UP), north_east_down(POSITION)),
    "compass": pose_2d(X_M, Y_M, np.pi / 2 - YAW_RAD, Z_M),
    "image-plan": pose_2d(X_M, -Y_M, -YAW_RAD, Z_M),
}


@pytest.mark.parametrize("name", NAMES)
def test_one_camera_in_every_convention(name):
    assert is_rigid(WRITTEN[name], 1e-9)
    np.testing.assert_allclose(convert_pose(WRITTEN[name], name), EXPECTED, atol=1e-12)


def test_the_unit_scales_positions_only():
    millimetres = EXPECTED.copy()
    millimetres[:3, 3] *= 1000
    np.testing.assert_allclose(convert_pose(millimetres, unit_m=0.001), EXPECTED, atol=1e-12)


def test_an_inverse_in_millimetres():
    pose = EXPECTED.copy()
    pose[:3, 3] *= 1000
    np.testing.assert_allclose(convert_pose(np.linalg.inv(pose), "ros-world-to-camera", 0.001), EXPECTED, atol=1e-12)
