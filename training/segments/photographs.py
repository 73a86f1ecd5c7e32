"""Photographs of NYU Depth v2 with depth and labels, as upright partial panoramas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.camera import LEVEL, Camera
from salframe.panoramas.images import read_color, read_range
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.photograph import photograph_panorama

FOCAL_PX, CENTRE_PX = 519.0, (324.5, 253.5)
"""Focal length and principal point of the Kinect's colour camera. The centre of the first pixel is at 0. Depth and
labels are aligned with the colour image."""
STEPS_DEG = (45.0, 45.0, 45.0, 15.0, 15.0, 15.0, 15.0, 15.0)
"""Maximum deviation of a surface from horizontal or vertical in each step of the gravity estimate, coarse to fine."""


@dataclass(frozen=True, eq=False)
class LabelledPhotograph:
    """A photograph with its camera, and class ids (h, w) uint8 as in thirteen.CLASSES, 0 where unlabelled."""

    name: str
    camera: Camera
    rgb: np.ndarray
    depth_m: np.ndarray
    labels: np.ndarray

    def panorama(self, height: int) -> Panorama:
        """Return the photograph as a partial panorama."""
        return photograph_panorama(self.camera, self.name, self.rgb, self.depth_m, height=height)


def read_views(folder: Path) -> Iterator[LabelledPhotograph]:
    """Yield the labelled views of a folder with rgb/, depth/ (16 bits, millimetres, z-depth) and labels13/.

    Raises:
        DataError: The folder holds no labels, or a file cannot be read.
    """
    paths = sorted((folder / "labels13").glob("*.png"))
    if not paths:
        raise DataError(f"{folder} has no file labels13/*.png, expected a folder with views of NYU Depth v2")
    for path in paths:
        labels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        depth_m = read_range(folder / "depth" / path.name)
        height, width = labels.shape
        pose = np.eye(4)
        pose[:3, :3] = upright(normals(depth_m, FOCAL_PX, CENTRE_PX))
        camera = Camera(width, height, FOCAL_PX, FOCAL_PX, *CENTRE_PX, T_base_camera=pose)
        yield LabelledPhotograph(path.stem, camera, read_color(folder / "rgb" / path.name), depth_m, labels)


def normals(depth_m: np.ndarray, focal_px: float, centre_px: tuple[float, float], step: int = 8) -> np.ndarray:
    """Return (n, 3) unit surface normals of a z-depth image, in camera axes (x right, y down, z forward)."""
    y, x = np.mgrid[: depth_m.shape[0] : step, : depth_m.shape[1] : step]
    z = cv2.blur(np.nan_to_num(depth_m), (step, step))[::step, ::step]
    points = np.stack([(x - centre_px[0]) / focal_px * z, (y - centre_px[1]) / focal_px * z, z], -1)
    across, along = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
    normal = np.cross(across, along).reshape(-1, 3)
    length = np.linalg.norm(normal, axis=1)
    return normal[length > 0] / length[length > 0, None]


def upright(normal: np.ndarray) -> np.ndarray:
    """Estimate the (3, 3) rotation from camera axes to an upright frame in which the camera faces +x.

    The estimated vertical is parallel or perpendicular to most surface normals (n, 3) (Gupta, Arbelaez, Malik,
    Perceptual Organization and Recognition of Indoor Scenes from RGB-D Images, CVPR 2013). Labels are not used.
    """
    up = np.array([0.0, -1.0, 0.0])
    for step_deg in STEPS_DEG:
        cosine = np.abs(normal @ up)
        level, standing = cosine > np.cos(np.radians(step_deg)), cosine < np.sin(np.radians(step_deg))
        if not (level.any() or standing.any()):
            break
        spread = normal[standing].T @ normal[standing] - normal[level].T @ normal[level]
        _, vectors = np.linalg.eigh(spread)
        up = vectors[:, 0] * np.sign(vectors[:, 0] @ up)
    forward = LEVEL[0, :3]
    ahead = forward - (forward @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up])
