"""Photographs of NYU Depth v2 with depth and labels, as upright partial panoramas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.images import read_color, read_range
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.photograph import LEVEL, Pinhole

FOCAL_PX, CENTRE_PX = 519.0, (325.0, 254.0)
"""Of the Kinect's colour camera, with which depth and labels are aligned."""
STEPS_DEG = (45.0, 45.0, 45.0, 15.0, 15.0, 15.0, 15.0, 15.0)
"""Within so much of level or upright a surface speaks for a vertical; first coarsely, then finely."""


@dataclass(frozen=True, eq=False)
class View:
    """A photograph: camera, and class ids (h, w) uint8 as in thirteen.CLASSES, 0 where nobody labelled."""

    name: str
    camera: Pinhole
    rgb: np.ndarray
    depth_m: np.ndarray
    labels: np.ndarray

    def panorama(self, height: int) -> Panorama:
        """What it shows of the sphere."""
        return self.camera.panorama(self.name, self.rgb, self.depth_m, height)


def read_views(folder: Path) -> Iterator[View]:
    """The labelled views of a folder with rgb/, depth/ (16 bits, millimetres, z-depth) and labels13/. Raises
    DataError."""
    paths = sorted((folder / "labels13").glob("*.png"))
    if not paths:
        raise DataError(f"{folder} has no labels13/*.png, expected the folder of the NYU views")
    for path in paths:
        labels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        depth_m = read_range(folder / "depth" / path.name)
        height, width = labels.shape
        axes = upright(normals(depth_m, FOCAL_PX, CENTRE_PX))
        camera = Pinhole(width, height, FOCAL_PX, CENTRE_PX, axes)
        yield View(path.stem, camera, read_color(folder / "rgb" / path.name), depth_m, labels)


def normals(depth_m: np.ndarray, focal_px: float, centre_px: tuple[float, float], step: int = 8) -> np.ndarray:
    """(n, 3) unit normals of the surfaces of a depth image (z-depth), camera axes (x right, y down, z forward)."""
    y, x = np.mgrid[: depth_m.shape[0] : step, : depth_m.shape[1] : step]
    z = cv2.blur(np.nan_to_num(depth_m), (step, step))[::step, ::step]
    points = np.stack([(x + 0.5 - centre_px[0]) / focal_px * z, (y + 0.5 - centre_px[1]) / focal_px * z, z], -1)
    across, along = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
    normal = np.cross(across, along).reshape(-1, 3)
    length = np.linalg.norm(normal, axis=1)
    return normal[length > 0] / length[length > 0, None]


def upright(normal: np.ndarray) -> np.ndarray:
    """(3, 3) from camera axes to an upright frame in which the camera looks along +x, by the normals (n, 3) of what it
    sees: the vertical that most surfaces are level or upright to.

    Gupta, Arbelaez, Malik, Perceptual Organization and Recognition of Indoor Scenes from RGB-D Images, CVPR 2013. No
    label is used.
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
    forward = LEVEL.T @ [1.0, 0.0, 0.0]
    ahead = forward - (forward @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up])
