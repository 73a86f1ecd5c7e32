"""Compute the outlines of detections on the sphere."""

from __future__ import annotations

import numpy as np

from salframe.graphs.detections import Detections

MIN_SURFACE_POINTS = 20
"""Minimum number of points of an object that are treated as samples of its surface. Fewer points are treated as the
corners of its box."""
MAX_MASK_SIDE = 800
"""Maximum width and height, in cells, of the mask that an outline is computed from."""
MIN_SPACING = 2e-4
"""Minimum angle between neighbouring pixels, in radians. Points that are closer belong to one pixel."""
MIN_PART = 0.02
"""Minimum area of a part of an object, divided by the area of its largest part. Smaller parts are not drawn."""
_BOX = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T


def outline_objects(detections: Detections) -> list[list[np.ndarray]]:
    """Return the closed lines around the parts of each object, each (K, 3) float64, unit vectors in the panorama frame.

    The lines surround the points of the object. If the points are unknown, the lines surround the mask. If the mask is
    also unknown, the lines surround the box. If only the bearing and the solid angle of the object are known, the line
    is a circle around the bearing with this solid angle. Otherwise the object has no line.
    """
    return [_outline(detections, i) for i in range(len(detections))]


def _outline(detections: Detections, i: int) -> list[np.ndarray]:
    if detections.points_m is not None:
        points = np.asarray(detections.points_m[i], np.float64)
        length = np.linalg.norm(points, axis=1)
        known = np.isfinite(length) & (length > 0)
        if known.sum() >= MIN_SURFACE_POINTS:
            return _around_mask(points[known] / length[known, None])
        if known.any():
            return _around_corners(points[known] / length[known, None])
    if detections.rays is not None and len(detections.rays[i]) >= MIN_SURFACE_POINTS:
        return _around_mask(np.asarray(detections.rays[i], np.float64))
    centroid, size = detections.centroid_m[i], detections.size_m[i]
    if np.isfinite([*centroid, *size, detections.yaw_rad[i]]).all() and np.linalg.norm(centroid):
        c, s = np.cos(detections.yaw_rad[i]), np.sin(detections.yaw_rad[i])
        corners = centroid + (_BOX * size) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        return _around_corners(corners / np.linalg.norm(corners, axis=1, keepdims=True))
    bearing, solid_angle_sr = detections.bearing[i], detections.solid_angle_sr[i]
    if np.isfinite(bearing).all() and 0 < solid_angle_sr < 4 * np.pi:
        return [_circle(bearing, np.arccos(1 - solid_angle_sr / (2 * np.pi)))]
    return []


class _AzimuthalProjection:
    """Lambert's azimuthal equal-area projection of the sphere, centred on the mean direction of the rays (N, 3) of an
    object. Unlike an equirectangular image, it has no seam and no pole inside the object."""

    def __init__(self, rays: np.ndarray) -> None:
        middle = rays.mean(0)
        if np.linalg.norm(middle) < 1e-6:  # the rays surround the camera
            middle = rays[0]
        self._ahead = middle / np.linalg.norm(middle)
        self._left, self._up = _across(self._ahead)

    def flatten(self, rays: np.ndarray) -> np.ndarray:
        """Return the projections (N, 2) of unit vectors (N, 3) to the plane. Near the centre, lengths in the plane are
        angles in radians."""
        stretch = np.sqrt(2 / np.maximum(1 + rays @ self._ahead, 1e-9))
        return np.column_stack([rays @ self._left, rays @ self._up]) * stretch[:, None]

    def raise_up(self, points: np.ndarray) -> np.ndarray:
        """Return the unit vectors (N, 3) of points (N, 2) in the plane: the inverse of `flatten`."""
        square = np.minimum((points**2).sum(1), 4)
        flat = points @ np.stack([self._left, self._up])
        return flat * np.sqrt(1 - square / 4)[:, None] + np.outer(1 - square / 2, self._ahead)


def _across(ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit vectors to the left and up, orthogonal to the unit vector `ahead` and to each other. If `ahead`
    is nearly vertical, left and up are arbitrary."""
    left = np.cross([0, 0, 1] if abs(ahead[2]) < 0.99 else [1, 0, 0], ahead)
    left /= np.linalg.norm(left)
    return left, np.cross(ahead, left)


def _around_mask(rays: np.ndarray) -> list[np.ndarray]:
    """Return the closed lines around a mask. `rays` (N, 3) are the unit vectors through its pixels."""
    import cv2

    projection = _AzimuthalProjection(rays)
    points, spacing = projection.flatten(rays), _spacing(rays)
    cell = max(spacing / 3, float(np.ptp(points, axis=0).max()) / MAX_MASK_SIDE)
    reach = max(1, round(0.75 * spacing / cell))
    low = points.min(0) - (reach + 3) * cell
    place = np.round((points - low) / cell).astype(int)
    mask = np.zeros(place.max(0)[::-1] + reach + 4, np.uint8)
    mask[place[:, 1], place[:, 0]] = 255
    # Dilate until the pixels meet, then erode to half a pixel around the outermost pixels.
    mask = cv2.dilate(mask, _disk(reach))
    mask = cv2.erode(mask, _disk(round(0.25 * spacing / cell)))
    mask = (cv2.GaussianBlur(mask, (0, 0), 1.2) > 127).astype(np.uint8)
    lines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    areas = [cv2.contourArea(line) for line in lines]
    return [
        projection.raise_up(cv2.approxPolyDP(line, 0.5, True)[:, 0] * cell + low)
        for line, area in zip(lines, areas, strict=True)
        if area >= MIN_PART * max(areas) and len(line) > 2
    ]


def _spacing(rays: np.ndarray) -> float:
    """Return the angle between neighbouring pixels, in radians, from the rays (N, 3) through the pixels."""
    from scipy.spatial import cKDTree

    beside = np.median(cKDTree(rays).query(rays[:: max(1, len(rays) // 400)], 5)[0][:, 4])
    # Near the poles the columns of a panorama are dense; the spacing of its rows is constant.
    rows = np.diff(np.sort(np.arcsin(np.clip(rays[:, 2], -1, 1))))
    rows = rows[rows > MIN_SPACING]
    return float(max(beside, np.median(rows) if len(rows) else 0.0, MIN_SPACING))


def _disk(radius: int) -> np.ndarray:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return (x**2 + y**2 <= (radius + 0.25) ** 2).astype(np.uint8)


def _around_corners(rays: np.ndarray) -> list[np.ndarray]:
    """Return the closed line around the corners of a box, unit vectors (N, 3). Between two corners, it follows a great
    circle, the projection of a straight edge."""
    import cv2

    hull = rays[cv2.convexHull(_AzimuthalProjection(rays).flatten(rays).astype(np.float32), returnPoints=False)[:, 0]]
    share = np.linspace(0, 1, 16, endpoint=False)[:, None]
    line = np.concatenate([a + share * (b - a) for a, b in zip(hull, np.roll(hull, -1, 0), strict=True)])
    return [line / np.linalg.norm(line, axis=1, keepdims=True)] if len(hull) > 2 else []


def _circle(bearing: np.ndarray, radius_rad: float) -> np.ndarray:
    """Return a circle around a bearing, as unit vectors (72, 3)."""
    left, up = _across(bearing)
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)[:, None]
    return np.cos(radius_rad) * bearing + np.sin(radius_rad) * (np.cos(angle) * left + np.sin(angle) * up)
