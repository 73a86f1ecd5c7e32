"""Visibility of annotated objects in a panorama: solid angle, range and occlusion. The probability of detection depends
on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.annotated import Annotated, has_points
from salframe.graphs.boxes import box_solid_angle, upright_box
from salframe.panoramas.panorama import Panorama

OCCLUDER_SHARE = 0.05
"""Minimum difference of ranges, as a share of the range of the object, at which a nearer neighbouring pixel counts as
hiding the object. The minimum excludes the floor in front of the object."""


@dataclass(frozen=True, eq=False)
class ObjectVisibility:
    """Visibility of N objects.

    Attributes:
        labels: N labels.
        solid_angle_sr: (N,) float64, solid angle that each object covers, NaN where unknown.
        range_m: (N,) float64, range of the centroid, NaN where unknown.
        hidden_share: (N,) float64, share of the outline that borders a nearer surface, NaN where unknown.
    """

    labels: tuple[str, ...]
    solid_angle_sr: np.ndarray
    range_m: np.ndarray
    hidden_share: np.ndarray


def object_visibility(panorama: Panorama, objects: Sequence[Annotated]) -> ObjectVisibility:
    """Return the visibility of annotated objects in a panorama.

    If only the box of an object is known, the solid angle is the mean over all sides from which the box can be viewed,
    and the hidden share is unknown.
    """
    instance_id = None if panorama.annotations is None else panorama.annotations.instance_id
    solid_angle_sr, range_m, hidden = (np.full(len(objects), np.nan) for _ in range(3))
    if has_points(panorama):
        range_m[:] = [np.linalg.norm(annotated.points_m.mean(0, dtype=np.float64)) for annotated in objects]
    if instance_id is not None:
        solid_angle_sr[:] = [annotated.solid_angle_sr.sum() for annotated in objects]
    else:
        solid_angle_sr[:] = [
            box_solid_angle(upright_box(annotated.points_m)[0], r) if np.isfinite(r) else annotated.solid_angle_sr.sum()
            for annotated, r in zip(objects, range_m, strict=True)
        ]
    if instance_id is not None and panorama.range_m is not None and objects:
        hidden[:] = hidden_shares(instance_id, panorama.range_m)[[annotated.key for annotated in objects]]
    return ObjectVisibility(tuple(annotated.label for annotated in objects), solid_angle_sr, range_m, hidden)


def hidden_shares(instance_id: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """Return the share of the outline that borders a nearer surface, for each instance id from 0 to the maximum.

    The first and the last pixel column of the images are neighbours.

    Args:
        instance_id: (H, 2H) instance image.
        range_m: (H, 2H) range image, in metres.

    Returns:
        (maximum id + 1,) float64, NaN for an id without an outline.
    """
    ids = instance_id.ravel()
    number, nearer_than = int(ids.max(initial=0)) + 1, range_m.ravel() * (1 - OCCLUDER_SHARE)
    pixels = np.arange(ids.size).reshape(instance_id.shape)
    beside, below = (pixels, np.roll(pixels, -1, axis=1)), (pixels[:-1], pixels[1:])
    outline, hidden = np.zeros(number), np.zeros(number)
    for first, second in (beside, below):
        edge = ids[first] != ids[second]
        for inner, outer in ((first[edge], second[edge]), (second[edge], first[edge])):
            outline += np.bincount(ids[inner], minlength=number)
            hides = range_m.ravel()[outer] < nearer_than[inner]
            hidden += np.bincount(ids[inner][hides], minlength=number)
    return np.divide(hidden, outline, out=np.full(number, np.nan), where=outline > 0)
