"""Panoramas of a camera that turns on the spot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from salframe.panoramas.geometry import pose_2d, transform_points
from salframe.panoramas.panorama import Panorama

DEFAULT_WIDTH = 360
"""Width of a panorama without images: one column per degree."""


def panorama_width(panorama: Panorama) -> int:
    """Return the width of a panorama's images in pixels, or DEFAULT_WIDTH if it has no images."""
    annotations = panorama.annotations
    images = (panorama.rgb, panorama.range_m, panorama.valid, None if annotations is None else annotations.instance_id)
    return next((image.shape[1] for image in images if image is not None), DEFAULT_WIDTH)


def turned(panorama: Panorama, columns: int) -> Panorama:
    """Return the panorama rolled to the right by a number of columns.

    This is the panorama of the same camera, rotated to the left by columns / W of a full turn.
    """

    def roll(image: np.ndarray | None) -> np.ndarray | None:
        return None if image is None else np.roll(image, columns, axis=1)

    annotations = panorama.annotations
    turn_rad = -2 * np.pi * columns / panorama_width(panorama)
    if annotations is not None and annotations.objects is not None:
        objects = annotations.objects
        centroid_m = transform_points(pose_2d(0, 0, turn_rad), objects.centroid_m)
        objects = replace(objects, centroid_m=centroid_m, yaw_rad=(objects.yaw_rad + turn_rad) % np.pi)
        annotations = replace(annotations, objects=objects)
    elif annotations is not None:
        annotations = replace(annotations, instance_id=roll(annotations.instance_id))
    return replace(
        panorama,
        rgb=roll(panorama.rgb),
        range_m=roll(panorama.range_m),
        valid=roll(panorama.valid),
        annotations=annotations,
        up=None if panorama.up is None else pose_2d(0, 0, turn_rad)[:3, :3] @ panorama.up,
    )
