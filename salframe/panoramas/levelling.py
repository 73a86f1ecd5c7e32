"""Level tilted panoramas: estimate the tilt of the camera, and turn the images and the annotations."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels
from salframe.panoramas.line_segments import find_segments
from salframe.panoramas.panorama import ObjectBoxes, Panorama
from salframe.panoramas.tilt import level_rotation, up_from_lines, up_from_range

MIN_TILT_DEG = 1.0
"""Minimum tilt of a panorama that is levelled. Below it the panorama does not change."""
MAX_LINE_ROWS = 512
"""Maximum number of rows of the picture whose lines are detected."""
_FLAT_DEG = 1e-3
"""Maximum tilt of a pose that may consist of position and yaw only, without information on the tilt of the camera."""
_BLOCK_ROWS = 256
"""Number of rows that are turned at once, to bound the memory."""


def tilt_deg(rotation: np.ndarray) -> float:
    """Return the angle between the z axes of two frames in degrees, from the rotation (3, 3) between them."""
    return float(np.degrees(np.arctan2(np.hypot(rotation[2, 0], rotation[2, 1]), rotation[2, 2])))


def pose_level_rotation(T_world_pano: np.ndarray) -> np.ndarray | None:
    """Return the rotation R_level_pano (3, 3) that levels a panorama by its pose. None if the pose is level."""
    if tilt_deg(T_world_pano[:3, :3]) < MIN_TILT_DEG:
        return None
    return level_rotation(T_world_pano[2, :3])


def may_be_flat(T_world_pano: np.ndarray) -> bool:
    """Return whether a pose (4, 4) is exactly level, so that it may have no information on the tilt of the camera."""
    return tilt_deg(T_world_pano[:3, :3]) < _FLAT_DEG


def estimate_level_rotation(panorama: Panorama, parts: Collection[str]) -> np.ndarray | None:
    """Return the rotation R_level_pano (3, 3) that levels a panorama.

    The tilt comes from `Panorama.up` if an IMU measured it, else from the range, else from the lines in the colour.
    Without an IMU, a camera that hangs upside down is not detected, because floor and ceiling look alike.

    Args:
        panorama: The panorama.
        parts: Parts that may be used, a subset of {"rgb", "range"}.

    Returns:
        The rotation from the panorama frame to the frame of an upright camera at the same position. None if the tilt is
        below MIN_TILT_DEG or unknown.
    """
    up = panorama.up if panorama.up is not None else _estimate_up(panorama, parts)
    if up is None:
        return None
    rotation = level_rotation(up)
    return None if tilt_deg(rotation) < MIN_TILT_DEG else rotation


def _estimate_up(panorama: Panorama, parts: Collection[str]) -> np.ndarray | None:
    """Return the up direction (3,), estimated from the range or the colour of a panorama. None if it is unknown."""
    if "range" in parts and panorama.range_m is not None:
        return up_from_range(panorama.range_m)
    if "rgb" in parts and panorama.rgb is not None:
        return up_from_lines(find_segments(*_reduced(panorama.rgb, panorama.valid)))
    return None


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
        rotation: (3, 3) rotation from the frame of the panorama to the new frame.
    """
    annotations = panorama.annotations
    images = {name: getattr(panorama, name) for name in ("rgb", "range_m", "valid")}
    images["instance_id"] = None if annotations is None else annotations.instance_id
    names = [name for name, image in images.items() if image is not None]
    turned: dict[str, Any] = dict(zip(names, turn_images([images[name] for name in names], rotation), strict=True))
    instance_id = turned.pop("instance_id", None)
    if annotations is not None and annotations.objects is not None:
        annotations = replace(annotations, objects=_turn_objects(annotations.objects, rotation))
    elif annotations is not None:
        annotations = replace(annotations, instance_id=instance_id)
    up = None if panorama.up is None else rotation @ panorama.up
    return replace(panorama, annotations=annotations, up=up, **turned)


def turn_image(image: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return an equirectangular image (H, 2H, ...) as a camera with other axes would see it, see `turn_images`."""
    return turn_images([image], rotation)[0]


def turn_images(images: Sequence[np.ndarray], rotation: np.ndarray) -> list[np.ndarray]:
    """Return equirectangular images of one size as a camera with other axes at the same position would see them.

    Args:
        images: Images (H, 2H, ...). Images with channels (colour) are interpolated. Others take the nearest pixel.
        rotation: (3, 3) rotation from the frame of the images to the new frame.
    """
    import cv2

    if not images:
        return []
    turned, height = [np.empty_like(image) for image in images], len(images[0])
    around = [np.concatenate([im[:, -1:], im, im[:, :1]], axis=1) if im.ndim == 3 else im for im in images]
    for start in range(0, height, _BLOCK_ROWS):
        block = slice(start, start + _BLOCK_ROWS)
        columns, rows = rays_to_pixels(equirectangular_rays(height)[block] @ rotation, height)
        row, column = np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)
        for image, source in zip(turned, around, strict=True):
            if image.ndim == 3:
                x, y = (columns + 0.5).astype(np.float32), (rows - 0.5).astype(np.float32)
                image[block] = cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            else:
                image[block] = source[row, column]
    return turned


def _turn_objects(objects: ObjectBoxes, rotation: np.ndarray) -> ObjectBoxes:
    """Return objects in other axes. Their boxes stay upright: only the azimuth of the length changes."""
    along = np.column_stack([np.cos(objects.yaw_rad), np.sin(objects.yaw_rad), np.zeros(len(objects.labels))])
    along = along @ rotation.T
    yaw_rad = np.arctan2(along[:, 1], along[:, 0])
    return replace(objects, centroid_m=objects.centroid_m @ rotation.T, yaw_rad=yaw_rad)
