"""Named conventions of poses, and their conversion to `T_world_pano`: z up, panorama x forward, y left (REP-103)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from salframe.panoramas.geometry import invert_pose

_OPENCV = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Matrix (3, 3) from the panorama frame to a camera with x right, y down and z forward."""
_OPENGL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Matrix (3, 3) from the panorama frame to a camera with x right, y up and z backward."""
_UNITY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Matrix (3, 3) from the panorama frame to left-handed axes with x right, y up and z forward."""
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Matrix (3, 3) from a right-handed world with y up to one with z up."""
_FLIP_Y = np.diag([1.0, -1.0, 1.0])
_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Matrix (3, 3) from a world with x north, y east and z down to one with x east, y north and z up."""
_FORWARD_RIGHT_DOWN = np.diag([1.0, -1.0, -1.0])
_QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation matrix (3, 3) of a turn by 90 deg to the left."""
_SAME = np.eye(3)

PoseConvention = Literal[
    "ros",
    "ros-world-to-camera",
    "opencv",
    "opencv-world-to-camera",
    "opencv-y-down",
    "opencv-y-down-world-to-camera",
    "opengl",
    "opengl-world-to-camera",
    "opengl-z-up",
    "unity",
    "ned",
    "compass",
    "image-plan",
]
"""Type of the name of a pose convention. docs/reference/folder-format.md#poses describes the conventions."""
NAMES: tuple[PoseConvention, ...] = get_args(PoseConvention)


@dataclass(frozen=True, eq=False)
class _Axes:
    """Meaning of the 16 numbers of a pose.

    Attributes:
        camera: (3, 3) matrix from the panorama frame to the camera axes of the convention.
        world: (3, 3) matrix from the world axes of the convention to a right-handed world with z up.
        inverted: Whether the pose maps the world to the camera.
        clockwise: Whether the rotation is a heading, clockwise from north (+y).
    """

    camera: np.ndarray
    world: np.ndarray
    inverted: bool = False
    clockwise: bool = False


_CONVENTIONS: dict[PoseConvention, _Axes] = {
    "ros": _Axes(_SAME, _SAME),
    "ros-world-to-camera": _Axes(_SAME, _SAME, inverted=True),
    "opencv": _Axes(_OPENCV, _SAME),
    "opencv-world-to-camera": _Axes(_OPENCV, _SAME, inverted=True),
    "opencv-y-down": _Axes(_OPENCV, _OPENCV.T),
    "opencv-y-down-world-to-camera": _Axes(_OPENCV, _OPENCV.T, inverted=True),
    "opengl": _Axes(_OPENGL, _Y_UP),
    "opengl-world-to-camera": _Axes(_OPENGL, _Y_UP, inverted=True),
    "opengl-z-up": _Axes(_OPENGL, _SAME),
    "unity": _Axes(_UNITY, _UNITY.T),
    "ned": _Axes(_FORWARD_RIGHT_DOWN, _NED),
    "compass": _Axes(_SAME, _SAME, clockwise=True),
    "image-plan": _Axes(_FLIP_Y, _FLIP_Y),
}


def convert_pose(pose: np.ndarray, convention: PoseConvention = "ros", unit_m: float = 1.0) -> np.ndarray:
    """Return `T_world_pano` of a pose that follows another convention.

    Args:
        pose: (4, 4) rigid motion in the axes of the convention.
        convention: One of NAMES.
        unit_m: Unit of the pose's translation in metres.

    Returns:
        (4, 4) float64, metres.
    """
    axes = _CONVENTIONS[convention]
    camera_pose = invert_pose(pose) if axes.inverted else pose
    rotation = _QUARTER_TURN @ camera_pose[:3, :3].T if axes.clockwise else camera_pose[:3, :3]
    converted = np.eye(4)
    converted[:3, :3] = axes.world @ rotation @ axes.camera
    converted[:3, 3] = axes.world @ camera_pose[:3, 3] * unit_m
    return converted
