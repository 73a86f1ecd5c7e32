"""Assignment of panorama pixels to annotated objects. A pixel shows an object if its 3D point is in the box of the
object."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays, transform_points
from salframe.panoramas.house_file import HouseObject

_STUFF = frozenset({"void", "wall", "floor", "ceiling", "beam", "column", "stairs", "railing", "unlabeled"})
"""Categories that are not objects."""
_UNKNOWN = "unknown"
_SLACK_M = 0.03
"""Margin in metres that is added to boxes, because measured ranges scatter, and pictures and curtains are thin."""


def labels(objects: Iterable[HouseObject]) -> dict[int, str]:
    """Return the label of each object by instance id (index in the file + 1). Structure such as walls is omitted."""
    return {o.index + 1: o.label for o in objects if o.category not in _STUFF and o.label != _UNKNOWN}


def label_pixels(range_m: np.ndarray, T_world_pano: np.ndarray, objects: Iterable[HouseObject]) -> np.ndarray:
    """Return the instance id of each pixel: (H, 2H) int32, 0 where there is no object or no range.

    A point in several boxes belongs to the smallest box.

    Args:
        range_m: Range image (H, 2H) in metres, NaN where unknown.
        T_world_pano: Pose (4, 4) of the panorama.
        objects: Objects of the .house file.
    """
    known = np.flatnonzero(~np.isnan(range_m))
    points_m = transform_points(
        T_world_pano, (equirectangular_rays(len(range_m)) * range_m[..., None]).reshape(-1, 3)[known]
    )
    instance_id = np.zeros(range_m.size, np.int32)
    objects = list(objects)
    label_by_id = labels(objects)
    for o in sorted(objects, key=lambda o: -np.prod(o.half_m)):
        if o.index + 1 in label_by_id:
            half_m = o.half_m + _SLACK_M
            offset_m = points_m - o.centre_m
            near = np.flatnonzero((np.abs(offset_m) <= np.linalg.norm(half_m)).all(1))
            inside = (np.abs(offset_m[near] @ o.axes.T) <= half_m).all(1)
            instance_id[known[near[inside]]] = o.index + 1
    return instance_id.reshape(range_m.shape)
