"""Matching of objects that several detectors detected in one panorama, and the overlap of two objects.

A cap is a circle on the sphere around the bearing of an object, with the solid angle of the object.
"""

from __future__ import annotations

import numpy as np

from salframe.graphs.detections import Detections

SAME = 0.5
"""Minimum overlap of two detections of the same object, as a fraction of the smaller detection. A fraction of the union
would be too small if one detector detects only a part of the object. The value was checked on pairs of a `panoseg`
object and an annotated object with the same name (house-6, seed 100, 30 panoramas). Of 98 pairs within 0.3 m, 97 boxes
and 96 caps have a larger overlap. Of 11 pairs more than 1 m apart, no box and 1 cap have a larger overlap."""
SLACK_M = 0.1
"""Minimum side length of a box in metres when overlap is computed. Boxes around a picture on a wall are only a few
centimetres thick, and their positions differ by a similar distance."""


def same_objects(detections: Detections, source: np.ndarray) -> list[np.ndarray]:
    """Group the detections of several detectors by object.

    Two detections are the same object if their labels are equal, their detectors differ and their overlap exceeds SAME.
    A group has at most one detection per detector. Pairs with the largest overlap are joined first.

    Args:
        detections: Detections of all detectors, N in total.
        source: Detector (N,) int of each detection.

    Returns:
        Indices of the detections of each object, one array per object.
    """
    labels = np.array(detections.labels, dtype=np.str_)
    a, b = np.triu_indices(len(detections), 1)
    candidates = (labels[a] == labels[b]) & (source[a] != source[b])
    a, b = a[candidates], b[candidates]
    shared = np.array([overlap(detections, i, j) for i, j in zip(a, b, strict=True)])
    group_of = np.arange(len(detections))
    for pair in np.argsort(-shared, kind="stable"):
        if shared[pair] <= SAME:
            break
        group, other = (np.flatnonzero(group_of == group_of[i]) for i in (a[pair], b[pair]))
        if not np.isin(source[group], source[other]).any():
            group_of[other] = group_of[a[pair]]
    return [np.flatnonzero(group_of == name) for name in np.unique(group_of)]


def overlap(detections: Detections, i: int, j: int) -> float:
    """Return the overlap of the detections i and j as a fraction of the smaller detection.

    If both positions are known, volumes are compared. Otherwise solid angles are compared. The overlap is 0 if a
    bearing is unknown.
    """
    if np.isfinite(detections.centroid_m[[i, j]]).all() and np.isfinite(detections.size_m[[i, j]]).all():
        boxes = (
            (detections.centroid_m[k], np.maximum(detections.size_m[k], SLACK_M), float(detections.yaw_rad[k]))
            for k in (i, j)
        )
        return shared_volume(*boxes)
    if not np.isfinite(detections.bearing[[i, j]]).all():
        return 0.0
    apart_rad = angle_between(detections.bearing[i], detections.bearing[j])
    return shared_cap(apart_rad, *(cap_radius(float(detections.solid_angle_sr[k])) for k in (i, j)))


def shared_volume(a: tuple[np.ndarray, np.ndarray, float], b: tuple[np.ndarray, np.ndarray, float]) -> float:
    """Return the volume of the intersection of two upright boxes, divided by the volume of the smaller box.

    A box is a tuple of centre (3,) in metres, size (3,) in metres and yaw in radians.
    """
    low, high = (side([box[0][2] + sign * box[1][2] / 2 for box in (a, b)]) for side, sign in ((max, -1), (min, 1)))
    reach_m = sum(float(np.hypot(*box[1][:2])) / 2 for box in (a, b))
    if high <= low or np.hypot(*(a[0] - b[0])[:2]) >= reach_m:
        return 0.0
    area_m2 = _footprint(*a).intersection(_footprint(*b)).area
    return float(area_m2 * (high - low) / min(a[1].prod(), b[1].prod()))


def _footprint(centre_m: np.ndarray, size_m: np.ndarray, yaw_rad: float):  # type: ignore[no-untyped-def]
    """Return the outline of an upright box seen from above."""
    from shapely import Polygon

    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * size_m[:2] / 2
    return Polygon(corners @ np.array([[c, s], [-s, c]]) + centre_m[:2])


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Return the angle in radians between two unit vectors; accurate for small angles."""
    return float(2 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def cap_radius(solid_angle_sr: float) -> float:
    """Return the angular radius in radians of a cap with this solid angle; 0 (a point) if the solid angle is NaN."""
    share = 0.0 if np.isnan(solid_angle_sr) else solid_angle_sr / (4 * np.pi)
    return float(2 * np.arcsin(np.sqrt(np.clip(share, 0, 1))))


def shared_cap(apart_rad: float, one_rad: float, other_rad: float) -> float:
    """Return the solid angle of the intersection of two caps, divided by the solid angle of the smaller cap.

    If the smaller cap is a point, the result is 1 if it lies in the other cap, otherwise 0. The intersection of two
    caps is the sum of two sectors minus the two triangles between them (Girard). Each cap must cover less than half of
    the sphere.

    Args:
        apart_rad: Angle between the centres.
        one_rad: Angular radius of one cap.
        other_rad: Angular radius of the other cap.
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


def _angle(opposite: float, side_a: float, side_b: float) -> float:
    """Return the angle of a spherical triangle between two sides, from the side opposite to it."""
    cosine = (np.cos(opposite) - np.cos(side_a) * np.cos(side_b)) / (np.sin(side_a) * np.sin(side_b))
    return float(np.arccos(np.clip(cosine, -1, 1)))
