"""Pairs of perspective views of one room with exact correspondences on LoFTR's coarse grid.

Cell (x, y) of the grid is the point (8 x, 8 y) of the image, with pixel centres at +0.5. View pixels are K R^T d for a
direction d in the panorama frame, where R rotates camera axes (x right, y down, z forward) to the panorama frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from salframe_keypoints.loftr_compact import STRIDE_PX

from salframe.panoramas.geometry import invert_pose, pose_yaw, rays_to_pixels, sample_nearest, transform_points
from training.loftr_compact.panoramas import GrayPanorama

FOCAL_PX = 160.0
"""Focal length of the views of `loftr-compact` at run time: 320 pixels for 90 degrees."""

DEPTH_TOLERANCE = 0.05
"""Maximum relative difference in range of a visible point."""
MIN_MATCHED = 0.1
"""Minimum share of the first view's cells that have a true match. Other pairs are rejected, up to ATTEMPTS times."""

ATTEMPTS = 10
HOMOGRAPHIES = 0.3
"""Share of pairs that are two views of one panorama, related by a homography, with sheared and stretched cameras."""


@dataclass(frozen=True, eq=False)
class PosedView:
    """A perspective view of a rendered panorama, with a camera matrix (3, 3) and a rotation (3, 3) from camera axes to
    the panorama frame. `size_px` is (width, height)."""

    panorama: GrayPanorama
    camera: np.ndarray
    rotation: np.ndarray
    size_px: tuple[int, int]

    def bearings(self, pixels: np.ndarray) -> np.ndarray:
        """Return (K, 3) unit vectors in the panorama frame through pixels (K, 2)."""
        rays = np.column_stack([pixels, np.ones(len(pixels))]) @ (self.rotation @ np.linalg.inv(self.camera)).T
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def project(self, directions: np.ndarray) -> np.ndarray:
        """Return the (K, 2) pixels of directions (K, 3) in the panorama frame, NaN behind the camera and outside the
        image."""
        image = directions @ (self.camera @ self.rotation.T).T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = image[:, :2] / image[:, 2:]
        inside = (image[:, 2] > 0) & (pixels >= 0).all(1) & (pixels < self.size_px).all(1)
        return np.where(inside[:, None], pixels, np.nan)

    def cut(self) -> np.ndarray:
        """Return the grey perspective image that is cut from the panorama by bilinear interpolation, (h, w) uint8."""
        width, height = self.size_px
        y, x = np.mgrid[:height, :width] + 0.5
        columns, rows = rays_to_pixels(self.bearings(np.column_stack([x.ravel(), y.ravel()])), len(self.panorama.gray))
        maps = ((a.reshape(height, width) - 0.5).astype(np.float32) for a in (columns, rows))
        return cv2.remap(self.panorama.gray, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)

    def grid(self) -> np.ndarray:
        """Return the (L, 2) float64 points of the coarse grid, row by row."""
        x, y = np.meshgrid(*(np.arange(0, size, STRIDE_PX) for size in self.size_px))
        return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def warp(points_px: np.ndarray, source: PosedView, target: PosedView) -> np.ndarray:
    """Return the (K, 2) pixels in the target view of points (K, 2) of the source view.

    NaN marks points outside the image, points with unknown range, and points that are occluded or changed: their
    distance from the target differs from the range in the target's panorama.
    """
    bearings = source.bearings(points_px)
    points_m = bearings * sample_nearest(source.panorama.range_m, bearings)[:, None].astype(np.float64)
    target_m = transform_points(invert_pose(target.panorama.T_world_pano) @ source.panorama.T_world_pano, points_m)
    finite = np.isfinite(target_m).all(1)
    range_m = np.where(finite, np.linalg.norm(target_m, axis=1), np.nan)
    target_m = np.where(finite[:, None], target_m, (1.0, 0.0, 0.0))
    measured_m = sample_nearest(target.panorama.range_m, target_m).astype(np.float64)
    with np.errstate(invalid="ignore"):
        visible = finite & (np.abs(measured_m - range_m) < DEPTH_TOLERANCE * range_m)
    return np.where(visible[:, None], target.project(target_m), np.nan)


def correspondences(first: PosedView, second: PosedView) -> tuple[np.ndarray, np.ndarray]:
    """Return the matching cell of the second view for each cell of the first.

    Two cells match if each is the nearest cell to the true position of the other (LoFTR section 3.3).

    Returns:
        Cells (L,) int64, -1 for no match, and offsets (L, 2) float32 from the matching cell to the true position, in
        pixels.
    """
    grid_first, grid_second = first.grid(), second.grid()
    forward = warp(grid_first, first, second)
    cells, back = _nearest_cell(forward, second.size_px), _nearest_cell(warp(grid_second, second, first), first.size_px)
    mutual = (cells >= 0) & (back[cells] == np.arange(len(cells)))
    offset_px = np.where(mutual[:, None], forward - grid_second[cells], 0)
    return np.where(mutual, cells, -1), offset_px.astype(np.float32)


def _nearest_cell(points_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Return the (K,) int64 index of the coarse cell nearest to each point, -1 for NaN and outside the grid."""
    columns, rows = (size // STRIDE_PX for size in size_px)
    finite = np.isfinite(points_px).all(1)
    x, y = np.rint(np.where(finite[:, None], points_px, -STRIDE_PX) / STRIDE_PX).astype(np.int64).T
    return np.where((x >= 0) & (x < columns) & (y >= 0) & (y < rows), y * columns + x, -1)


def draw_pair(
    rooms: Sequence[Sequence[GrayPanorama]], size_px: tuple[int, int], rng: np.random.Generator
) -> tuple[PosedView, PosedView]:
    """Return two random overlapping views of a room, from two panoramas or by a homography from one."""
    for _ in range(ATTEMPTS):
        room = rooms[rng.integers(len(rooms))]
        homography = rng.random() < HOMOGRAPHIES or len(room) < 2
        pair = (_draw_homography if homography else _draw_views)(room, size_px, rng)
        if (correspondences(*pair)[0] >= 0).mean() >= MIN_MATCHED:
            break
    return pair


def _draw_views(
    room: Sequence[GrayPanorama], size_px: tuple[int, int], rng: np.random.Generator
) -> tuple[PosedView, PosedView]:
    """Return random views of two panoramas. As at run time, both look at about the same point of the room, or into the
    same direction of the world."""
    a, b = (room[i] for i in rng.choice(len(room), 2, replace=False))
    azimuth, focal = rng.uniform(-np.pi, np.pi), FOCAL_PX * rng.uniform(0.8, 1.25)
    first = PosedView(a, _camera(size_px, focal), _rotation(azimuth, rng.normal(0, 0.09), rng.normal(0, 0.04)), size_px)
    ahead = first.bearings(np.array([size_px]) / 2)
    target_m = transform_points(
        invert_pose(b.T_world_pano) @ a.T_world_pano, ahead * sample_nearest(a.range_m, ahead)[0]
    )[0]
    same_point, pitch = rng.random() < 0.6 and np.isfinite(target_m).all(), rng.normal(0, 0.09)
    target = (
        np.arctan2(target_m[1], target_m[0])
        if same_point
        else azimuth + pose_yaw(a.T_world_pano) - pose_yaw(b.T_world_pano)
    )
    aside = rng.uniform(-2 / 3, 2 / 3) * np.arctan(size_px[0] / 2 / FOCAL_PX)
    second = PosedView(
        b,
        _camera(size_px, focal * rng.uniform(0.85, 1.18)),
        _rotation(target + aside, pitch, rng.normal(0, 0.04)),
        size_px,
    )
    return first, second


def _draw_homography(
    room: Sequence[GrayPanorama], size_px: tuple[int, int], rng: np.random.Generator
) -> tuple[PosedView, PosedView]:
    panorama = room[rng.integers(len(room))]
    azimuth, focal = rng.uniform(-np.pi, np.pi), FOCAL_PX * rng.uniform(0.8, 1.25)
    first = PosedView(
        panorama, _camera(size_px, focal), _rotation(azimuth, rng.normal(0, 0.2), rng.normal(0, 0.1)), size_px
    )
    camera = _camera(size_px, focal * rng.uniform(0.7, 1.4), shear=rng.normal(0, 0.12), stretch=rng.uniform(0.85, 1.18))
    turn = rng.uniform(-0.5, 0.5) * np.arctan(size_px[0] / 2 / FOCAL_PX)
    return first, PosedView(
        panorama, camera, _rotation(azimuth + turn, rng.normal(0, 0.2), rng.normal(0, 0.25)), size_px
    )


def _camera(size_px: tuple[int, int], focal_px: float, shear: float = 0.0, stretch: float = 1.0) -> np.ndarray:
    return np.array([[focal_px, shear * focal_px, size_px[0] / 2], [0, stretch * focal_px, size_px[1] / 2], [0, 0, 1]])


def _rotation(azimuth_rad: float, pitch_rad: float, roll_rad: float) -> np.ndarray:
    """Return the (3, 3) rotation from camera axes to the panorama frame: roll, then pitch up, then counter-clockwise
    yaw of a level camera that faces forward."""
    (ca, cp, cr), (sa, sp, sr) = (f(np.array([azimuth_rad, pitch_rad, roll_rad])) for f in (np.cos, np.sin))
    level = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    roll = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    pitch = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    turn = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    return turn @ pitch @ level @ roll


def photometric(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the image as (1, h, w) float32 in [0, 1], with random exposure, gamma, noise, slight blur, and JPEG."""
    if rng.random() < 0.3:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.2))
    value = (image / 255.0) ** rng.uniform(0.6, 1.6)
    value = 0.5 + (value - 0.5) * rng.uniform(0.6, 1.3) + rng.uniform(-0.12, 0.12)
    value = np.clip(255 * (value + rng.normal(0, rng.uniform(0, 0.02), image.shape)), 0, 255).astype(np.uint8)
    encoded = cv2.imencode(".jpg", value, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(70, 96))])[1]
    return cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE)[None].astype(np.float32) / 255
