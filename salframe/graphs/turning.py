"""Detectors that see every panorama from the same side, however the camera was turned."""

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
    """Make a detector's `detect` see each panorama with its near side in the middle, without annotations, and turn what
    it finds back.

    For networks whose answer depends on where the panorama begins (strides, views at fixed azimuths): turning the
    panorama by any number of columns then turns the objects and changes nothing else. This is canonicalisation (Kaba et
    al., Equivariance with Learned Canonicalization Functions, ICML 2023) by a fixed function.
    """

    @wraps(detect)
    def steady(detector: Any, panorama: Panorama) -> Detections:
        side = _side(panorama)
        if side is None:
            return detect(detector, panorama)
        columns = len(side) // 2 - peak_column(side)
        images = {
            name: np.roll(image, columns, 1)
            for name in ("rgb", "range_m", "valid")
            if (image := getattr(panorama, name)) is not None
        }
        found = detect(detector, replace(panorama, annotations=None, **images))
        return turned_detections(found, 2 * np.pi * columns / len(side))

    return steady


def turned_detections(found: Detections, angle_rad: float) -> Detections:
    """The detections turned about the vertical by angle_rad, counter-clockwise seen from above."""
    turn = pose_2d(0, 0, angle_rad)

    def turned(sets: tuple[np.ndarray, ...] | None) -> tuple[np.ndarray, ...] | None:
        return None if sets is None else tuple(transform_points(turn, one).astype(np.float32) for one in sets)

    return replace(
        found,
        centroid_m=transform_points(turn, found.centroid_m),
        bearing=transform_points(turn, found.bearing),
        yaw_rad=(found.yaw_rad + angle_rad) % np.pi,
        points_m=turned(found.points_m),
        rays=turned(found.rays),
    )


def _side(panorama: Panorama) -> np.ndarray | None:
    """(W,) float64, how near things are in each column; where no range is known, how bright; None where the panorama
    has neither."""
    if panorama.range_m is not None and (known := np.isfinite(panorama.range_m)).any():
        return np.divide(1, 1 + panorama.range_m, where=known, out=np.zeros(known.shape)).mean(0)
    return None if panorama.rgb is None else panorama.rgb.mean((0, 2))
