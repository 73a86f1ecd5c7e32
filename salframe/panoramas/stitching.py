"""Stitching of overlapping pictures of cameras with known poses to one upright equirectangular panorama.

The cameras of a viewpoint are some centimetres apart (3 cm in height on Matterport's rig, two degrees at 1 m), so the
pixel that corresponds to a direction of the panorama depends on the distance of the surface. Range is therefore
stitched first, and colour is then looked up at the point at that range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.panoramas.camera import Camera, DistortionModel
from salframe.panoramas.geometry import equirectangular_rays, invert_pose, row_elevation

_ROUNDS = 3
"""Number of times that a direction is projected into a camera. Each projection uses the range that the previous one
found. The third projection moves the position by at most a tenth of a pixel."""
_FEATHER = 2
"""Exponent of the weight with which a picture fades out towards its border. A higher value makes seams narrower and
exposure steps sharper."""
AGREEING = 0.06
"""Maximum relative difference of two readings (depth values of two cameras) of one point."""
_AGREEMENT_ROWS = 64
"""Height of the panorama in which readings are compared."""
_OVERSAMPLING = 1.5
"""Pixels of a downscaled picture per pixel of the panorama."""


@dataclass(frozen=True, eq=False)
class PosedCamera:
    """A camera in the world.

    Attributes:
        camera: The intrinsics. T_base_camera is not used.
        T_world_camera: Pose (4, 4). The camera axes are x right, y down, z forward.
    """

    camera: Camera
    T_world_camera: np.ndarray

    def scaled(self, width: int, height: int) -> PosedCamera:
        """Return the camera of the picture resized to a size in pixels."""
        return PosedCamera(self.camera.scaled(width, height), self.T_world_camera)


def stitch_range(
    z_depth_m: Sequence[np.ndarray], cameras: Sequence[PosedCamera], T_world_pano: np.ndarray, height: int
) -> np.ndarray:
    """Stitch depth images to range_m (H, 2H) float32 along the rays of the panorama, NaN where no camera has a reading.

    Each ray takes the reading of the camera whose image centre is nearest to the ray. Readings are never averaged,
    since averaging would put points between a chair and the wall behind it.

    Args:
        z_depth_m: One image (h, w) float32 per camera: depth along its z axis in metres, NaN where unknown.
        cameras: Camera of each image.
        T_world_pano: Pose (4, 4) of the panorama.
        height: Height H of the panorama in pixels.
    """
    import cv2

    range_m = np.full((height, 2 * height), np.nan, np.float32)
    best = np.zeros_like(range_m)
    for depth_m, camera in zip(z_depth_m, cameras, strict=True):
        direction, offset_m = _in_camera(camera, T_world_pano, height)
        distance_m = np.full_like(range_m, np.inf)
        for _ in range(_ROUNDS):
            column, row = _project(camera, direction, offset_m, distance_m)
            sampled_depth_m = cv2.remap(
                depth_m, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
            )
            distance_m = (sampled_depth_m - offset_m[2]) / direction[..., 2]
        weight = np.where(distance_m > 0, _centrality(column, row, depth_m.shape), 0)
        nearer = weight > best
        range_m[nearer], best[nearer] = distance_m[nearer], weight[nearer]
    return range_m


def stitch_color(
    pictures: Sequence[np.ndarray], cameras: Sequence[PosedCamera], T_world_pano: np.ndarray, range_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Stitch pictures to a panorama's colour.

    Overlapping pictures are blended, weighted by the distance to their border.

    Args:
        pictures: One picture (h, w, 3) uint8 per camera.
        cameras: Camera of each picture.
        T_world_pano: Pose (4, 4) of the panorama.
        range_m: Range (H, 2H) in metres; NaN is treated as infinitely far.

    Returns:
        Colour (H, 2H, 3) uint8, and the mask (H, 2H) bool of the pixels that some camera sees.
    """
    import cv2

    height = len(range_m)
    total, weights = np.zeros((*range_m.shape, 3), np.float32), np.zeros(range_m.shape, np.float32)
    for picture, camera in zip(pictures, cameras, strict=True):
        # Area interpolation averages all picture pixels that one panorama pixel covers.
        factor = min(1.0, _OVERSAMPLING * height / np.pi / camera.camera.fx)
        small = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        shrunk = camera.scaled(small.shape[1], small.shape[0])
        direction, offset_m = _in_camera(shrunk, T_world_pano, height)
        column, row = _project(shrunk, direction, offset_m, np.where(np.isnan(range_m), np.inf, range_m))
        weight = _centrality(column, row, small.shape) ** _FEATHER
        total += weight[..., None] * cv2.remap(small, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        weights += weight
    valid = weights > 0
    rgb = total / np.where(valid, weights, 1)[..., None]
    return np.round(rgb).astype(np.uint8), valid


def reading_agreement(
    z_depth_m: Sequence[np.ndarray], cameras: Sequence[PosedCamera], T_world_pano: np.ndarray
) -> tuple[float, float]:
    """Return the share of the sphere where both depth images have a depth, and the share of this part where they agree.

    Two depths agree if they differ by at most AGREEING. Near edges they differ, because the cameras are apart.

    Args:
        z_depth_m: As in `stitch_range`.
        cameras: As in `stitch_range`.
        T_world_pano: As in `stitch_range`.
    """
    first, second = (np.full((_AGREEMENT_ROWS, 2 * _AGREEMENT_ROWS), np.nan, np.float32) for _ in range(2))
    for depth_m, camera in zip(z_depth_m, cameras, strict=True):
        range_m = stitch_range([depth_m], [camera], T_world_pano, _AGREEMENT_ROWS)
        is_second = np.isfinite(first) & np.isnan(second)
        second[is_second] = range_m[is_second]
        is_first = np.isnan(first)
        first[is_first] = range_m[is_first]
    weight = np.cos(row_elevation(_AGREEMENT_ROWS))[:, None] * np.isfinite(second)
    overlap = float(weight.sum())
    agreeing = np.abs(first - second) <= AGREEING * np.fmax(first, second)
    whole = float(np.cos(row_elevation(_AGREEMENT_ROWS)).sum() * 2 * _AGREEMENT_ROWS)
    return overlap / whole, float((weight * agreeing).sum()) / max(overlap, 1e-9)


def _in_camera(camera: PosedCamera, T_world_pano: np.ndarray, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the panorama's rays (H, 2H, 3) float32 and its origin (3,) in metres, in camera axes."""
    T_camera_pano = invert_pose(camera.T_world_camera) @ T_world_pano
    return equirectangular_rays(height) @ T_camera_pano[:3, :3].T.astype(np.float32), T_camera_pano[:3, 3].astype(
        np.float32
    )


def _project(
    camera: PosedCamera, direction: np.ndarray, offset_m: np.ndarray, range_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Project the points at range_m along the rays: column and row (H, 2H) float32, -1e4 behind the camera."""
    # Dividing by the range makes the offset vanish at infinity. An unknown range is treated as infinite.
    points = direction + offset_m * np.nan_to_num(1 / range_m)[..., None]
    lens = camera.camera
    if lens.distortion_model is DistortionModel.FISHEYE or any(lens.distortion):
        pixels = np.nan_to_num(lens.project(points @ lens.rotation.T), nan=-1e4).astype(np.float32)
        return pixels[..., 0], pixels[..., 1]
    x, y, z = np.moveaxis(points, -1, 0)
    ahead = z > 1e-3
    z = np.where(ahead, z, 1)
    column = np.where(ahead, lens.fx * x / z + lens.cx, -1e4)
    row = np.where(ahead, lens.fy * y / z + lens.cy, -1e4)
    return column.astype(np.float32), row.astype(np.float32)


def _centrality(column: np.ndarray, row: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return weights (H, 2H) float32: 1 at the centre of a picture of shape (h, w), 0 at its border and beyond."""
    across, down = (1 - np.abs((at + 0.5) / size * 2 - 1) for at, size in ((column, shape[1]), (row, shape[0])))
    return np.maximum(np.minimum(across, down), 0).astype(np.float32)
