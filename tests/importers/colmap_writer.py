"""COLMAP models written by pycolmap, in arbitrary axes and an arbitrary unit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap

UNIT_M = 2.5
"""Metres per unit of the model."""
_AXES = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
"""Rotation from the world with z up to the axes of the model."""
_ORIGIN = np.array([0.7, -1.1, 0.4])
"""Origin of the world with z up, in the model."""


def optical_pose(x_m: float, y_m: float, z_m: float, yaw_deg: float, pitch_deg: float = 0.0) -> np.ndarray:
    """Pose (4, 4) of an optical frame in a world with z up; pitch: elevation of the optical axis."""
    yaw, pitch = np.radians([yaw_deg, pitch_deg])
    forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0])
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(forward, right), forward, [x_m, y_m, z_m]], 1)
    return pose


class ColmapWriter:
    """Collects cameras and pictures by their poses in a world with z up, in metres.

    level: axes of the model are those of the world, in metres."""

    def __init__(self, *, level: bool = False) -> None:
        self.model = pycolmap.Reconstruction()
        self._axes, self._origin, self._unit_m = (np.eye(3), np.zeros(3), 1.0) if level else (_AXES, _ORIGIN, UNIT_M)

    def camera(self, name: str, width: int, height: int, params: Sequence[float], *, trivial_rig: bool = True) -> int:
        number = len(self.model.cameras) + 1
        camera = pycolmap.Camera.create_from_model_name(number, name, 1.0, width, height)
        camera.params = list(params)
        (self.model.add_camera_with_trivial_rig if trivial_rig else self.model.add_camera)(camera)
        return number

    def picture(self, name: str, camera: int, T_world_camera: np.ndarray) -> None:
        image = pycolmap.Image(name=name, camera_id=camera, image_id=len(self.model.images) + 1)
        self.model.add_image_with_trivial_frame(image, self._rigid(T_world_camera))

    def rig(self, cameras: Sequence[int], T_rig_cameras: Sequence[np.ndarray]) -> int:
        """Add a rig; the first camera is its reference."""
        rig = pycolmap.Rig(rig_id=len(self.model.rigs) + 1)
        rig.add_ref_sensor(self.model.cameras[cameras[0]].sensor_id)
        for camera, T in zip(cameras[1:], T_rig_cameras, strict=True):
            T_camera_rig = np.linalg.inv(T)
            T_camera_rig[:3, 3] /= self._unit_m
            rig.add_sensor(self.model.cameras[camera].sensor_id, pycolmap.Rigid3d(T_camera_rig[:3]))
        self.model.add_rig(rig)
        return rig.rig_id

    def rig_pictures(self, rig: int, names: Sequence[str], cameras: Sequence[int], T_world_rig: np.ndarray) -> None:
        frame = pycolmap.Frame(frame_id=len(self.model.frames) + 1, rig_id=rig)
        first = len(self.model.images) + 1
        images = []
        for number, (name, camera) in enumerate(zip(names, cameras, strict=True)):
            image = pycolmap.Image(name=name, camera_id=camera, image_id=first + number, frame_id=frame.frame_id)
            frame.add_data_id(image.data_id)
            images.append(image)
        frame.rig_from_world = self._rigid(T_world_rig)
        self.model.add_frame(frame)
        for image in images:
            self.model.add_image(image)
        self.model.register_frame(frame.frame_id)

    def points(self, points_m: np.ndarray) -> None:
        for point in points_m @ self._axes.T / self._unit_m + self._origin:
            self.model.add_point3D(point, pycolmap.Track())

    def write(self, folder: Path, *, text: bool = False) -> Path:
        folder.mkdir(parents=True)
        (self.model.write_text if text else self.model.write_binary)(str(folder))
        return folder

    def _rigid(self, T_world_camera: np.ndarray) -> pycolmap.Rigid3d:
        """Rigid3d of COLMAP: from the model to the camera."""
        rotation = self._axes @ T_world_camera[:3, :3]
        centre = self._axes @ T_world_camera[:3, 3] / self._unit_m + self._origin
        return pycolmap.Rigid3d(np.column_stack([rotation.T, -rotation.T @ centre]))
