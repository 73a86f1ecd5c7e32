"""Detections from points: centroids and upright boxes of minimum area
(docs/explanation/method.md#from-panorama-to-graph)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.graphs.detections import Detections

MIN_SIDE_M = 0.05
"""Minimum side of a box, in metres. A flat set of points, such as a picture on a wall, gets a box of this thickness."""
MIN_POINTS = 5
"""Minimum number of points of an object from which its position is computed."""


def upright_box(points_m: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the upright box of minimum area around points.

    Args:
        points_m: (N, 3), N >= 1, in metres.

    Returns:
        size_m: (3,), length, width and height in metres, length >= width.
        yaw_rad: Azimuth of the longer horizontal side, in [0, pi).
    """
    import cv2

    height = float(np.ptp(points_m[:, 2]))
    # Rotate the points to the bearing of the object: rotating the panorama then rotates the box and keeps its size.
    bearing = float(np.arctan2(*points_m[:, 1::-1].mean(0, dtype=np.float64)))
    c, s = np.cos(bearing), np.sin(bearing)
    flat = points_m[:, :2] @ np.array([[c, -s], [s, c]])
    hull = cv2.convexHull(flat.astype(np.float32)[:, None])[:, 0].astype(np.float64)
    edge = np.roll(hull, -1, 0) - hull
    angle = np.append(np.arctan2(edge[:, 1], edge[:, 0]), 0.0)
    along = np.stack([np.cos(angle), np.sin(angle)])
    length, width = np.ptp(hull @ along, axis=0), np.ptp(hull @ np.stack([-along[1], along[0]]), axis=0)
    # Among boxes with equal areas (up to rounding), select the box that is best aligned with the bearing. The result
    # then does not depend on the order of the hull.
    area = np.maximum(length, MIN_SIDE_M) * np.maximum(width, MIN_SIDE_M)
    tied = np.flatnonzero(area <= area.min() * (1 + 1e-5))
    best = tied[np.argmin(np.round(angle[tied] % (np.pi / 2), 5))]
    sides, yaw = np.array([length[best], width[best]]), angle[best]
    if sides[1] > sides[0]:
        sides, yaw = sides[::-1], yaw + np.pi / 2
    return np.maximum([*sides, height], MIN_SIDE_M), float((yaw + bearing) % np.pi)


def detections_from_points(labels: Sequence[str], scores: np.ndarray, points_m: Sequence[np.ndarray]) -> Detections:
    """Return detections of objects from the points behind their masks.

    Args:
        labels: N labels.
        scores: (N,) scores of the detections.
        points_m: N arrays (n_i, 3), n_i >= 1, points of each object in the panorama frame in metres.
    """
    if not labels:
        return Detections.empty()
    boxes = [upright_box(points) for points in points_m]
    return Detections(
        tuple(labels),
        scores,
        np.array([points.mean(0, dtype=np.float64) for points in points_m]),
        np.array([size for size, _ in boxes]),
        np.array([yaw for _, yaw in boxes]),
        tuple(points_m),
    )


def detections_where_known(
    labels: Sequence[str],
    scores: np.ndarray,
    points_m: Sequence[np.ndarray] | None,
    bearing: np.ndarray | None = None,
    solid_angle_sr: np.ndarray | None = None,
    rays: Sequence[np.ndarray] | None = None,
) -> Detections:
    """Return detections of objects, some of which may have an unknown position.

    Args:
        labels: N labels.
        scores: (N,) scores of the detections.
        points_m: N arrays (n_i, 3), the points behind the masks in metres; None if no range is known. The position and
            the size of an object with fewer than MIN_POINTS points are NaN.
        bearing: (N, 3), as in Detections.
        solid_angle_sr: (N,), as in Detections.
        rays: N arrays, as in Detections.
    """
    measured = [i for i, points in enumerate(points_m or ()) if len(points) >= MIN_POINTS]
    centroid, size = np.full((len(labels), 3), np.nan), np.full((len(labels), 3), np.nan)
    yaw = np.full(len(labels), np.nan)
    clouds = None
    if points_m is not None:
        placed = detections_from_points(
            [labels[i] for i in measured], scores[measured], [points_m[i] for i in measured]
        )
        centroid[measured], size[measured], yaw[measured] = placed.centroid_m, placed.size_m, placed.yaw_rad
        unknown = np.full((1, 3), np.nan, np.float32)
        clouds = tuple(points if i in measured else unknown for i, points in enumerate(points_m))
    masks = None if rays is None else tuple(rays)
    return Detections(tuple(labels), scores, centroid, size, yaw, clouds, bearing, solid_angle_sr, masks)  # type: ignore[arg-type]


def box_solid_angle(size_m: np.ndarray, range_m: float) -> float:
    """Return the mean solid angle, in steradians, of a box (3,) viewed from a random side at a range.

    By Cauchy's formula, the mean projected area of a convex body is a quarter of its surface area. The solid angle is
    this projected area divided by the squared range.
    """
    length, width, height = size_m
    return float((length * width + width * height + height * length) / 2 / range_m**2)
