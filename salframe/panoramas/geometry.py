"""Coordinate frames and pixels: the equirectangular image and rigid motions.

World and panorama frames are right-handed, with z up, in metres. The centre of a panorama image looks along +x, and y
points to the left (ROS REP-103). Pixel centres are at +0.5. Azimuth increases to the left: counter-clockwise, seen from
above.
"""

from __future__ import annotations

import operator
from functools import lru_cache

import numpy as np

_CHI2_95 = 5.991464547
"""95 % quantile of the chi-squared distribution with two degrees of freedom."""


def wrap_angle(angle_rad):
    """Return angles wrapped to [-pi, pi), float64, in the shape of the input."""
    return (np.asarray(angle_rad, np.float64) + np.pi) % (2 * np.pi) - np.pi


def column_azimuth(width: int) -> np.ndarray:
    """Return the azimuth of each pixel column of an equirectangular image, (W,) float64 in radians."""
    return np.pi - 2 * np.pi * (np.arange(width) + 0.5) / width


def row_elevation(height: int) -> np.ndarray:
    """Return the elevation of each pixel row of an equirectangular image, (H,) float64 in radians."""
    return np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height


def pixel_solid_angles(height: int) -> np.ndarray:
    """Return the solid angle of a pixel in each row of an equirectangular image, (H,) float64 in steradians."""
    edges = np.sin(np.linspace(np.pi / 2, -np.pi / 2, height + 1))
    return (edges[:-1] - edges[1:]) * np.pi / height


@lru_cache(maxsize=4)
def equirectangular_rays(height: int) -> np.ndarray:
    """Return unit vectors through the pixel centres in the panorama frame, (H, 2H, 3) float32.

    The array is read-only and shared between calls.
    """
    azimuth, elevation = column_azimuth(2 * height), row_elevation(height)
    rays = np.empty((height, 2 * height, 3), np.float32)
    rays[..., 0] = np.cos(elevation)[:, None] * np.cos(azimuth)
    rays[..., 1] = np.cos(elevation)[:, None] * np.sin(azimuth)
    rays[..., 2] = np.sin(elevation)[:, None]
    rays.flags.writeable = False
    return rays


def range_of_cube_depth(depth_m: np.ndarray) -> np.ndarray:
    """Convert the z-depth of a panorama that was stitched from a cube map to range along the ray.

    Args:
        depth_m: (H, 2H) depth along the axis of the cube face that a ray passes through. The axes of the cube are those
            of the panorama.

    Returns:
        (H, 2H) float32 range along the ray in metres.
    """
    return depth_m / _cube_cosine(len(depth_m))


def cube_depth_of_range(range_m: np.ndarray) -> np.ndarray:
    """Convert range along the ray (H, 2H) to the z-depth of cube faces: the inverse of `range_of_cube_depth`."""
    return range_m * _cube_cosine(len(range_m))


def _cube_cosine(height: int) -> np.ndarray:
    """Return the cosine between each ray and the axis of the cube face that it passes through, (H, 2H) float32."""
    cosine: np.ndarray = np.abs(equirectangular_rays(height)).max(axis=2)
    return cosine


def rays_to_pixels(rays: np.ndarray, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Project directions onto an equirectangular image.

    Args:
        rays: (..., 3) directions of any length in the panorama frame.
        height: Height H of the image in pixels.

    Returns:
        Columns in [0, 2H) and rows, (...) float64 each; the centre of the first pixel is at (0.5, 0.5).
    """
    rays = np.asarray(rays, np.float64)
    azimuth = np.arctan2(rays[..., 1], rays[..., 0])
    elevation = np.arctan2(rays[..., 2], np.hypot(rays[..., 0], rays[..., 1]))
    column = (np.pi - azimuth) * height / np.pi % (2 * height)
    return column, (np.pi / 2 - elevation) * height / np.pi


def sample_nearest(image: np.ndarray, bearings: np.ndarray) -> np.ndarray:
    """Return the values of an equirectangular image (H, 2H, ...) at the pixels of bearings (K, 3): (K, ...)."""
    height = image.shape[0]
    columns, rows = rays_to_pixels(bearings, height)
    return image[np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)]


def peak_column(values: np.ndarray) -> int:
    """Return the column at the peak of the first harmonic of values (W,), from its phase.

    Rolling the values by c columns adds c to the result, modulo W.
    """
    column = -np.angle(np.fft.rfft(values)[1]) * len(values) / (2 * np.pi)
    # The peak of a mirror-symmetric room lies on a half column: 1e-6 rounds it up in spite of rounding errors.
    return int(np.floor(column + 0.5 + 1e-6))


def pose_2d(x_m: float, y_m: float, yaw_rad: float, z_m: float = 0.0) -> np.ndarray:
    """Return the pose of an upright frame, (4, 4) float64: rotation by yaw about +z, then translation by (x, y, z)."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0, x_m], [s, c, 0, y_m], [0, 0, 1, z_m], [0, 0, 0, 1]], np.float64)


def poses_2d(xy_m: np.ndarray, yaw_rad: np.ndarray) -> np.ndarray:
    """Return the poses of K upright frames, (K, 4, 4) float64: `pose_2d` of each xy_m (K, 2) and yaw_rad (K,)."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    poses = np.zeros((len(yaw_rad), 4, 4))
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = c, -s, s, c
    poses[:, 2, 2] = poses[:, 3, 3] = 1
    poses[:, :2, 3] = xy_m
    return poses


def translation(position_m: np.ndarray) -> np.ndarray:
    """Return the translation by a position (3,), (4, 4) float64."""
    matrix = np.eye(4)
    matrix[:3, 3] = position_m
    return matrix


def as_complex(xy: np.ndarray) -> np.ndarray:
    """Return the first two coordinates of points (..., D) as complex numbers x + iy, (...).

    A product with exp(i * angle) rotates them.
    """
    return xy[..., 0] + 1j * xy[..., 1]  # type: ignore[no-any-return]


def pose_yaw(pose: np.ndarray) -> float:
    """Return the yaw of a (4, 4) pose in radians: the azimuth of its x axis."""
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


def are_rotations(matrices: np.ndarray, tolerance: float = 1e-6) -> np.ndarray:
    """Return whether each of (..., 3, 3) finite matrices is a rotation within a tolerance, (...) bool."""
    orthonormal = np.isclose(matrices @ np.swapaxes(matrices, -1, -2), np.eye(3), atol=tolerance).all((-1, -2))
    return orthonormal & (np.linalg.det(matrices) > 0)


def invert_pose(pose: np.ndarray) -> np.ndarray:
    """Return the inverse of a rigid motion, (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def moved_covariance(covariance: np.ndarray, offset_m: np.ndarray) -> np.ndarray:
    """Return the covariance of the pose of a second frame that is rigidly attached to a first one, to first order.

    A small rotation vector d of the first frame moves the origin of the second frame by the cross product d x offset.

    Args:
        covariance: (3, 3) covariance of the first pose as (x_m, y_m, yaw_rad), or (6, 6) of position and rotation, in
            the axes of the world.
        offset_m: (3,) origin of the second frame relative to the first one, in the axes of the world.
    """
    x, y, z = offset_m
    jacobian = np.eye(len(covariance))
    if len(covariance) == 3:
        jacobian[:2, 2] = -y, x
    else:
        jacobian[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return np.asarray(jacobian @ covariance @ jacobian.T)


def confidence_ellipse(covariance_m2: np.ndarray) -> np.ndarray:
    """Return the ellipse around the origin that contains 95 % of a normal distribution, 48 points (x, y) in metres.

    Args:
        covariance_m2: (2, 2) covariance.
    """
    angle = np.linspace(0, 2 * np.pi, 48)
    variances, axes = np.linalg.eigh(covariance_m2)
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(np.sqrt(_CHI2_95) * unit * np.sqrt(np.maximum(variances, 0)) @ axes.T)


def flat_pose(pose: np.ndarray) -> np.ndarray:
    """Return the pose (4, 4) with the position and the yaw of a pose (4, 4), without its tilt."""
    return pose_2d(pose[0, 3], pose[1, 3], pose_yaw(pose), pose[2, 3])


def transform_points(pose: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Transform points (..., 3) by a (4, 4) rigid motion."""
    return points_m @ pose[:3, :3].T + pose[:3, 3]


def pose_errors(estimate: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Return the translation error in metres and the rotation error in radians between two poses (4, 4).

    The rotation error is the angle of the residual rotation, in [0, pi].
    """
    residual = estimate[:3, :3].T @ truth[:3, :3]
    sine = np.linalg.norm(residual - residual.T) / (2 * np.sqrt(2))
    rotation = np.arctan2(sine, (np.trace(residual) - 1) / 2)
    return float(np.linalg.norm(estimate[:3, 3] - truth[:3, 3])), float(rotation)


def is_rigid(pose: object, tolerance: float = 1e-6) -> bool:
    """Return whether a value is a (4, 4) rigid motion within a tolerance."""
    matrix = np.asarray(pose)
    if matrix.shape != (4, 4) or matrix.dtype.kind not in "iuf" or not np.isfinite(matrix).all():
        return False
    rows = matrix.tolist()  # lists are many times as fast as arrays of this size
    x, y, z = (row[:3] for row in rows[:3])
    products = [sum(map(operator.mul, left, right)) for left in (x, y, z) for right in (x, y, z)]
    numbers, rigid = [*products, *rows[3]], [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1]
    determinant = sum(x[i] * (y[i - 2] * z[i - 1] - y[i - 1] * z[i - 2]) for i in range(3))
    is_near = all(
        abs(number - expected) <= tolerance + 1e-5 * expected for number, expected in zip(numbers, rigid, strict=True)
    )
    return is_near and determinant > 0
