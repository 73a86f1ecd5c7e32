"""From points to detections: centroids and upright minimum-area boxes
(docs/explanation/method.md#from-panorama-to-graph)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.graphs.detections import Detections

MIN_SIDE_M = 0.05
"""No object is thinner: flat sets of points (a picture seen head on) get a box this thick."""
MIN_POINTS = 5
"""Fewer points than this tell no position."""


def upright_box(points_m: np.ndarray) -> tuple[np.ndarray, float]:
    """The upright box of least area around points (N, 3), N >= 1: size_m (3,) with length >= width, and the length's
    yaw_rad in [0, pi)."""
    import cv2

    height = float(np.ptp(points_m[:, 2]))
    # Turned to the object's own bearing, so that turning the panorama turns the box and leaves its size alone.
    bearing = float(np.arctan2(*points_m[:, 1::-1].mean(0, dtype=np.float64)))
    c, s = np.cos(bearing), np.sin(bearing)
    flat = points_m[:, :2] @ np.array([[c, -s], [s, c]])
    hull = cv2.convexHull(flat.astype(np.float32)[:, None])[:, 0].astype(np.float64)
    edge = np.roll(hull, -1, 0) - hull
    angle = np.append(np.arctan2(edge[:, 1], edge[:, 0]), 0.0)
    along = np.stack([np.cos(angle), np.sin(angle)])
    length, width = np.ptp(hull @ along, axis=0), np.ptp(hull @ np.stack([-along[1], along[0]]), axis=0)
    # Among boxes that differ by less than rounding the most aligned with the bearing wins, whatever order the hull came
    # in.
    area = np.maximum(length, MIN_SIDE_M) * np.maximum(width, MIN_SIDE_M)
    tied = np.flatnonzero(area <= area.min() * (1 + 1e-5))
    best = tied[np.argmin(np.round(angle[tied] % (np.pi / 2), 5))]
    sides, yaw = np.array([length[best], width[best]]), angle[best]
    if sides[1] > sides[0]:
        sides, yaw = sides[::-1], yaw + np.pi / 2
    return np.maximum([*sides, height], MIN_SIDE_M), float((yaw + bearing) % np.pi)


def detections_from_points(labels: Sequence[str], scores: np.ndarray, points_m: Sequence[np.ndarray]) -> Detections:
    """Detections of objects given by the points (n_i >= 1, 3) behind their masks."""
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
    """Detections of objects given by the points (n_i, 3) behind their masks; where these are fewer than MIN_POINTS,
    or None for all, position and size are NaN. bearing (N, 3), solid_angle_sr (N,) and rays as in Detections."""
    known = [i for i, points in enumerate(points_m or ()) if len(points) >= MIN_POINTS]
    centroid, size = np.full((len(labels), 3), np.nan), np.full((len(labels), 3), np.nan)
    yaw = np.full(len(labels), np.nan)
    clouds = None
    if points_m is not None:
        placed = detections_from_points([labels[i] for i in known], scores[known], [points_m[i] for i in known])
        centroid[known], size[known], yaw[known] = placed.centroid_m, placed.size_m, placed.yaw_rad
        unknown = np.full((1, 3), np.nan, np.float32)
        clouds = tuple(points if i in known else unknown for i, points in enumerate(points_m))
    masks = None if rays is None else tuple(rays)
    return Detections(tuple(labels), scores, centroid, size, yaw, clouds, bearing, solid_angle_sr, masks)  # type: ignore[arg-type]
