"""Make detectors rotation-equivariant: rotate each panorama to a canonical heading before detection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Any

import numpy as np

from salframe.graphs.detections import Detections
from salframe.panoramas.geometry import peak_column, pose_2d, transform_points
from salframe.panoramas.panorama import Panorama


def from_near_side(detect: Callable[[Any, Panorama], Detections]) -> Callable[[Any, Panorama], Detections]:
    """Decorate the method `detect` of a detector, so that the detections rotate with the panorama.

    The decorated method rotates each panorama so that the side with the nearest surfaces is in the middle, removes the
    annotations, detects, and rotates the detections back. Use it for networks whose output depends on which column of
    the panorama is the first, for example because of strides or views at fixed azimuths. The method is canonicalization
    (Kaba et al., Equivariance with Learned Canonicalization Functions, ICML 2023) by a fixed function.
    """

    @wraps(detect)
    def detect_canonical(detector: Any, panorama: Panorama) -> Detections:
        side = _side(panorama)
        if side is None:
            return detect(detector, panorama)
        columns = len(side) // 2 - peak_column(side)
        images = {
            name: np.roll(image, columns, 1)
            for name in ("rgb", "range_m", "valid")
            if (image := getattr(panorama, name)) is not None
        }
        detections = detect(detector, replace(panorama, annotations=None, **images))
        return rotate_detections(detections, 2 * np.pi * columns / len(side))

    return detect_canonical


def rotate_detections(detections: Detections, angle_rad: float) -> Detections:
    """Return detections rotated about the vertical axis by angle_rad, counter-clockwise when viewed from above."""
    turn = pose_2d(0, 0, angle_rad)

    def rotate(sets: tuple[np.ndarray, ...] | None) -> tuple[np.ndarray, ...] | None:
        return None if sets is None else tuple(transform_points(turn, points).astype(np.float32) for points in sets)

    return replace(
        detections,
        centroid_m=transform_points(turn, detections.centroid_m),
        bearing=transform_points(turn, detections.bearing),
        yaw_rad=(detections.yaw_rad + angle_rad) % np.pi,
        points_m=rotate(detections.points_m),
        rays=rotate(detections.rays),
    )


def _side(panorama: Panorama) -> np.ndarray | None:
    """Return the mean of 1 / (1 + range) of each pixel column, (W,) float64. If no range is known, return the mean
    brightness of each column; None if the panorama has no colour either."""
    if panorama.range_m is not None and (known := np.isfinite(panorama.range_m)).any():
        return np.divide(1, 1 + panorama.range_m, where=known, out=np.zeros(known.shape)).mean(0)
    return None if panorama.rgb is None else panorama.rgb.mean((0, 2))
