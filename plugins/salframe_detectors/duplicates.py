"""Which of the objects that several detectors find in one panorama are the same, and how much two of them overlap."""

from __future__ import annotations

import numpy as np

from salframe.graphs.detections import Detections

SAME = 0.5
"""Two detectors mean the same object where what they find shares more than this of the smaller. Of the smaller, not of
both: one sees the part of an object that its mask covers, the other the box around all of it. Objects of `panoseg` and
annotated ones of the same name in a rendered home (house-6, seed 100, 30 panoramas): of 98 pairs within 0.3 m 97 share
more of their boxes and 96 of their caps, of 11 pairs over 1 m apart none and 1."""
SLACK_M = 0.1
"""A side of a box counts as no less than this when boxes are laid on each other: two boxes around a picture on the wall
are a few cm thick and as far apart."""


def same_objects(found: Detections, of: np.ndarray) -> list[np.ndarray]:
    """Which of the objects of several detectors are the same: arrays of positions, one an object.

    of (N,) int: the detector that found each. Detectors mean the same where the labels are equal and the overlap is
    over SAME; a detector finds an object once; those that overlap most are joined first.
    """
    labels = np.array(found.labels, dtype=np.str_)
    a, b = np.triu_indices(len(found), 1)
    alike = (labels[a] == labels[b]) & (of[a] != of[b])
    a, b = a[alike], b[alike]
    shared = np.array([overlap(found, i, j) for i, j in zip(a, b, strict=True)])
    group_of = np.arange(len(found))
    for pair in np.argsort(-shared, kind="stable"):
        if shared[pair] <= SAME:
            break
        mine, other = (np.flatnonzero(group_of == group_of[i]) for i in (a[pair], b[pair]))
        if not np.isin(of[mine], of[other]).any():
            group_of[other] = group_of[a[pair]]
    return [np.flatnonzero(group_of == name) for name in np.unique(group_of)]


def overlap(found: Detections, i: int, j: int) -> float:
    """The share of the smaller of two objects that both cover: of volume where both are placed, of solid angle where
    one is not; 0 where not even the bearings are known."""
    if np.isfinite(found.centroid_m[[i, j]]).all() and np.isfinite(found.size_m[[i, j]]).all():
        boxes = ((found.centroid_m[k], np.maximum(found.size_m[k], SLACK_M), float(found.yaw_rad[k])) for k in (i, j))
        return shared_volume(*boxes)
    if not np.isfinite(found.bearing[[i, j]]).all():
        return 0.0
    apart_rad = angle_between(found.bearing[i], found.bearing[j])
    return shared_cap(apart_rad, *(cap_radius(float(found.solid_angle_sr[k])) for k in (i, j)))


def shared_volume(one: tuple[np.ndarray, np.ndarray, float], other: tuple[np.ndarray, np.ndarray, float]) -> float:
    """The volume that two upright boxes (centre (3,) in m, size (3,) in m, yaw in rad) share, over that of the
    smaller."""
    low, high = (
        side([box[0][2] + sign * box[1][2] / 2 for box in (one, other)]) for side, sign in ((max, -1), (min, 1))
    )
    reach_m = sum(float(np.hypot(*box[1][:2])) / 2 for box in (one, other))
    if high <= low or np.hypot(*(one[0] - other[0])[:2]) >= reach_m:
        return 0.0
    area_m2 = _footprint(*one).intersection(_footprint(*other)).area
    return float(area_m2 * (high - low) / min(one[1].prod(), other[1].prod()))


def _footprint(centre_m: np.ndarray, size_m: np.ndarray, yaw_rad: float):  # type: ignore[no-untyped-def]
    """The outline of an upright box seen from above."""
    from shapely import Polygon

    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * size_m[:2] / 2
    return Polygon(corners @ np.array([[c, s], [-s, c]]) + centre_m[:2])


def angle_between(one: np.ndarray, other: np.ndarray) -> float:
    """The angle in rad between two unit vectors, exact for small ones too."""
    return float(2 * np.arctan2(np.linalg.norm(one - other), np.linalg.norm(one + other)))


def cap_radius(solid_angle_sr: float) -> float:
    """The angular radius in rad of the cap that covers as much of the sphere; 0, a point, where that is not known."""
    share = 0.0 if np.isnan(solid_angle_sr) else solid_angle_sr / (4 * np.pi)
    return float(2 * np.arcsin(np.sqrt(np.clip(share, 0, 1))))


def shared_cap(apart_rad: float, one_rad: float, other_rad: float) -> float:
    """The solid angle that two caps of these radii share, over that of the smaller; their centres are apart_rad apart.

    A point counts as shared where it lies in the other cap. The lens of two caps is the sum of two sectors less the two
    triangles between them (Girard); what the caps leave of the sphere is none here: objects cover less than half of it.
    """
    small, large = sorted((one_rad, other_rad))
    if apart_rad + small <= large:
        return 1.0
    if apart_rad >= small + large or not small:
        return 0.0
    corner = _angle(apart_rad, small, large)
    at_small, at_large = _angle(large, small, apart_rad), _angle(small, large, apart_rad)
    lens_sr = 2 * (np.pi - corner - at_small * np.cos(small) - at_large * np.cos(large))
    return float(lens_sr / (4 * np.pi * np.sin(small / 2) ** 2))


def _angle(opposite: float, one: float, other: float) -> float:
    """The angle of a spherical triangle between two sides, from the side opposite to it."""
    cosine = (np.cos(opposite) - np.cos(one) * np.cos(other)) / (np.sin(one) * np.sin(other))
    return float(np.arccos(np.clip(cosine, -1, 1)))
