"""Level tilted panoramas: estimate the tilt of the camera, and turn the images and the annotations."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels
from salframe.panoramas.line_segments import find_segments
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama
from salframe.panoramas.tilt import level_rotation, up_from_lines, up_from_range

MIN_TILT_DEG = 1.0
"""Minimum tilt of a panorama that is levelled. Below it the panorama does not change."""
MAX_LINE_ROWS = 512
"""Maximum number of rows of the picture whose lines are detected."""
_FLAT_DEG = 1e-3
"""Maximum tilt of a pose that may be a pose in the plane, which does not say how the camera was tilted."""
_BLOCK_ROWS = 256
"""Number of rows that are turned at once, to bound the memory."""


def tilt_deg(rotation: np.ndarray) -> float:
    """Return the angle between the z axes of two frames in degrees, from the rotation (3, 3) between them."""
    return float(np.degrees(np.arctan2(np.hypot(rotation[2, 0], rotation[2, 1]), rotation[2, 2])))


def pose_level_rotation(T_world_pano: np.ndarray) -> np.ndarray | None:
    """Return the rotation R_level_pano (3, 3) that levels a panorama by its pose; None where that is level."""
    if tilt_deg(T_world_pano[:3, :3]) < MIN_TILT_DEG:
        return None
    return level_rotation(T_world_pano[2, :3])


def may_be_flat(T_world_pano: np.ndarray) -> bool:
    """Return whether a pose may be one in the plane: exactly level, without a word on the tilt of the camera."""
    return tilt_deg(T_world_pano[:3, :3]) < _FLAT_DEG


def estimate_level_rotation(panorama: Panorama, parts: Collection[str]) -> np.ndarray | None:
    """Return the rotation R_level_pano (3, 3) that levels a panorama.

    The tilt comes from the range where there is any, else from the lines in the colour. A camera that hangs upside down
    is not detected, because floor and ceiling look alike.

    Args:
        panorama: The panorama.
        parts: Parts that may be used, of "rgb" and "range".

    Returns:
        The rotation from the panorama frame to that of an upright camera at the same position; None where the tilt is
        below MIN_TILT_DEG or unknown.
    """
    up = None
    if "range" in parts and panorama.range_m is not None:
        up = up_from_range(panorama.range_m)
    elif "rgb" in parts and panorama.rgb is not None:
        up = up_from_lines(find_segments(*_reduced(panorama.rgb, panorama.valid)))
    if up is None:
        return None
    rotation = level_rotation(up)
    return None if tilt_deg(rotation) < MIN_TILT_DEG else rotation


def _reduced(rgb: np.ndarray, valid: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Return a picture and its mask with at most MAX_LINE_ROWS rows."""
    import cv2

    if len(rgb) <= MAX_LINE_ROWS:
        return rgb, valid
    size = 2 * MAX_LINE_ROWS, MAX_LINE_ROWS
    smaller = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    if valid is None:
        return smaller, None
    return smaller, cv2.resize(valid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0


def turn_panorama(panorama: Panorama, rotation: np.ndarray) -> Panorama:
    """Return a panorama as a camera with other axes at the same position would see it.

    Args:
        panorama: The panorama.
        rotation: (3, 3) rotation from its frame to the new frame.
    """
    turned = {
        name: turn_image(image, rotation)
        for name in ("rgb", "range_m", "valid")
        if (image := getattr(panorama, name)) is not None
    }
    if panorama.annotations is not None:
        turned["annotations"] = _turn_annotations(panorama.annotations, rotation)
    return replace(panorama, **turned)


def turn_image(image: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return an equirectangular image (H, 2H, ...) in other axes; colour is interpolated, the rest is not.

    Args:
        image: The image. Images with channels are colour.
        rotation: (3, 3) rotation from its frame to the new frame.
    """
    import cv2

    turned, height = np.empty_like(image), len(image)
    is_color = image.ndim == 3
    around = np.concatenate([image[:, -1:], image, image[:, :1]], axis=1) if is_color else image
    for start in range(0, height, _BLOCK_ROWS):
        rays = equirectangular_rays(height)[start : start + _BLOCK_ROWS] @ rotation
        columns, rows = rays_to_pixels(rays, height)
        if is_color:
            x, y = (columns + 0.5).astype(np.float32), (rows - 0.5).astype(np.float32)
            block = cv2.remap(around, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        else:
            block = image[np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)]
        turned[start : start + _BLOCK_ROWS] = block
    return turned


def _turn_annotations(annotations: Annotations, rotation: np.ndarray) -> Annotations:
    """Return annotations in other axes. The boxes of a list of objects stay upright: only their azimuth changes."""
    if annotations.instance_id is not None:
        return replace(annotations, instance_id=turn_image(annotations.instance_id, rotation))
    objects = annotations.objects or ObjectBoxes.empty()
    along = np.column_stack([np.cos(objects.yaw_rad), np.sin(objects.yaw_rad), np.zeros(len(objects.labels))])
    along = along @ rotation.T
    yaw_rad = np.arctan2(along[:, 1], along[:, 0])
    return replace(annotations, objects=replace(objects, centroid_m=objects.centroid_m @ rotation.T, yaw_rad=yaw_rad))
