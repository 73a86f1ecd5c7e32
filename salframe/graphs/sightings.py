"""How annotated objects show in a panorama: what a detector's chance to find them depends on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.annotated import Annotated, has_points
from salframe.graphs.boxes import upright_box
from salframe.panoramas.panorama import Panorama

OCCLUDER_SHARE = 0.05
"""What borders an object hides it where it is nearer by more than this share of the range: the floor before its feet
does not."""


@dataclass(frozen=True, eq=False)
class ObjectVisibility:
    """N objects as they show: labels; solid_angle_sr (N,), how much of the sphere each covers; range_m (N,), of its
    centroid; hidden_share (N,), of its outline, where something nearer borders it. All float64, NaN where unknown."""

    labels: tuple[str, ...]
    solid_angle_sr: np.ndarray
    range_m: np.ndarray
    hidden_share: np.ndarray


def sightings(panorama: Panorama, objects: Sequence[Annotated]) -> ObjectVisibility:
    """How annotated objects of a panorama show in it. Of an object known by its box alone the solid angle is that of
    the box seen from a random side, and what hides it is unknown."""
    instance_id = None if panorama.annotations is None else panorama.annotations.instance_id
    solid_angle_sr, range_m, hidden = (np.full(len(objects), np.nan) for _ in range(3))
    if has_points(panorama):
        range_m[:] = [np.linalg.norm(one.points_m.mean(0, dtype=np.float64)) for one in objects]
    if instance_id is not None:
        solid_angle_sr[:] = [one.solid_angle_sr.sum() for one in objects]
    else:
        solid_angle_sr[:] = [
            box_solid_angle(upright_box(one.points_m)[0], r) for one, r in zip(objects, range_m, strict=True)
        ]
    if instance_id is not None and panorama.range_m is not None and objects:
        hidden[:] = hidden_shares(instance_id, panorama.range_m)[[one.key for one in objects]]
    return ObjectVisibility(tuple(one.label for one in objects), solid_angle_sr, range_m, hidden)


def box_solid_angle(size_m: np.ndarray, range_m: float) -> float:
    """Solid angle_sr of a box (3,) at a range, from a random side: Cauchy's mean shadow of a convex body, a quarter of
    its surface, by the squared range."""
    length, width, height = size_m
    return float((length * width + width * height + height * length) / 2 / range_m**2)


def hidden_shares(instance_id: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """For each id from 0 to the largest in an instance image (H, 2H), the share of its outline at which something
    nearer borders it; NaN where it has no outline. The image's left and right edges are neighbours."""
    ids = instance_id.ravel()
    number, nearness = int(ids.max(initial=0)) + 1, range_m.ravel() * (1 - OCCLUDER_SHARE)
    pixels = np.arange(ids.size).reshape(instance_id.shape)
    beside, below = (pixels, np.roll(pixels, -1, axis=1)), (pixels[:-1], pixels[1:])
    outline, hidden = np.zeros(number), np.zeros(number)
    for first, second in (beside, below):
        edge = ids[first] != ids[second]
        for own, other in ((first[edge], second[edge]), (second[edge], first[edge])):
            outline += np.bincount(ids[own], minlength=number)
            hides = range_m.ravel()[other] < nearness[own]
            hidden += np.bincount(ids[own][hides], minlength=number)
    return np.divide(hidden, outline, out=np.full(number, np.nan), where=outline > 0)
