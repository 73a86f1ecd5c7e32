"""Overlapping pictures of a tripod's cameras, joined to one equirectangular panorama that is upright and has a known
pose in the world.

The cameras of a viewpoint stand some centimetres apart (3 cm in height on Matterport's rig, two degrees at 1 m), so
that a direction of the panorama falls on another pixel of each camera the nearer the surface is. Range is therefore
found first, and colour is looked up at the point that range tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays, invert_pose

_ROUNDS = 3
"""Projections of a direction into a camera, each with the range that the one before found: the third moves no pixel by
more than a tenth."""
_FEATHER = 2
"""Power of the weight with which a picture fades out towards its border: a higher one makes seams narrower and steps of
exposure harder."""
_OVERSAMPLING = 1.5
"""Pixels of a shrunk picture for a pixel of the panorama."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera in the world: focal length and principal point in pixels, the centre of the first pixel at (0,
    0); T_world_camera (4, 4) with axes x right, y down, z forward."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    T_world_camera: np.ndarray

    def scaled(self, factor: float) -> Camera:
        """The camera of the picture shrunk by this factor."""
        cx_px, cy_px = ((c + 0.5) * factor - 0.5 for c in (self.cx_px, self.cy_px))
        return Camera(self.fx_px * factor, self.fy_px * factor, cx_px, cy_px, self.T_world_camera)


def stitch_range(
    z_depth_m: Sequence[np.ndarray], cameras: Sequence[Camera], T_world_pano: np.ndarray, height: int
) -> np.ndarray:
    """Range_m (H, 2H) float32 along the rays of the panorama, NaN where no camera has a reading.

    z_depth_m: (h, w) float32 a camera, depth along its z axis in metres, NaN where unknown. A ray takes the reading of
    the camera that sees it nearest to the middle of its picture: readings are never averaged, which would put points
    between a chair and the wall behind it.
    """
    import cv2

    range_m = np.full((height, 2 * height), np.nan, np.float32)
    best = np.zeros_like(range_m)
    for depth_m, camera in zip(z_depth_m, cameras, strict=True):
        direction, offset_m = _in_camera(camera, T_world_pano, height)
        found_m = np.full_like(range_m, np.inf)
        for _ in range(_ROUNDS):
            column, row = _project(camera, direction, offset_m, found_m)
            depth_seen_m = cv2.remap(
                depth_m, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
            )
            found_m = (depth_seen_m - offset_m[2]) / direction[..., 2]
        weight = np.where(found_m > 0, _centrality(column, row, depth_m.shape), 0)
        nearer = weight > best
        range_m[nearer], best[nearer] = found_m[nearer], weight[nearer]
    return range_m


def stitch_color(
    pictures: Sequence[np.ndarray], cameras: Sequence[Camera], T_world_pano: np.ndarray, range_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Colour (H, 2H, 3) uint8 of a panorama whose range_m (H, 2H) is known (NaN: taken as far away), and which of it
    some camera saw, (H, 2H) bool.

    pictures: (h, w, 3) uint8 a camera. Where pictures overlap they are blended, each by its distance from its own
    border.
    """
    import cv2

    height = len(range_m)
    total, weights = np.zeros((*range_m.shape, 3), np.float32), np.zeros(range_m.shape, np.float32)
    for picture, camera in zip(pictures, cameras, strict=True):
        # A pixel of the panorama covers many of the picture's: shrunk by area they are all averaged.
        factor = min(1.0, _OVERSAMPLING * height / np.pi / camera.fx_px)
        small = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        shrunk = camera.scaled(small.shape[1] / picture.shape[1])
        direction, offset_m = _in_camera(shrunk, T_world_pano, height)
        column, row = _project(shrunk, direction, offset_m, np.where(np.isnan(range_m), np.inf, range_m))
        weight = _centrality(column, row, small.shape) ** _FEATHER
        total += weight[..., None] * cv2.remap(small, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        weights += weight
    seen = weights > 0
    rgb = total / np.where(seen, weights, 1)[..., None]
    return np.round(rgb).astype(np.uint8), seen


def _in_camera(camera: Camera, T_world_pano: np.ndarray, height: int) -> tuple[np.ndarray, np.ndarray]:
    """The rays of the panorama (H, 2H, 3) float32 and its origin (3,) in metres, in the axes of a camera."""
    T_camera_pano = invert_pose(camera.T_world_camera) @ T_world_pano
    return equirectangular_rays(height) @ T_camera_pano[:3, :3].T.astype(np.float32), T_camera_pano[:3, 3].astype(
        np.float32
    )


def _project(
    camera: Camera, direction: np.ndarray, offset_m: np.ndarray, range_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Column and row (H, 2H) float32 on which the points at range_m along the rays fall, -1e4 behind the camera."""
    # Divided by the range: at infinity the offset vanishes. A range that no camera knows is as good as infinite.
    x, y, z = np.moveaxis(direction + offset_m * np.nan_to_num(1 / range_m)[..., None], -1, 0)
    ahead = z > 1e-3
    z = np.where(ahead, z, 1)
    column = np.where(ahead, camera.fx_px * x / z + camera.cx_px, -1e4)
    row = np.where(ahead, camera.fy_px * y / z + camera.cy_px, -1e4)
    return column.astype(np.float32), row.astype(np.float32)


def _centrality(column: np.ndarray, row: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(H, 2H) float32 from 1 in the middle of a picture of this (h, w) to 0 at its border and beyond."""
    across, down = (1 - np.abs((at + 0.5) / size * 2 - 1) for at, size in ((column, shape[1]), (row, shape[0])))
    return np.maximum(np.minimum(across, down), 0).astype(np.float32)
