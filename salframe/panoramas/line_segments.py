"""Line segments of an equirectangular panorama. They are detected in perspective views, because only there straight
lines of the room are straight."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from salframe.panoramas.geometry import rays_to_pixels

FACE_FOV_RAD = np.deg2rad(100)
"""Field of view of each of the six views, the faces of a cube. The views overlap, so that no segment is lost at their
borders."""
LSD_SCALE = 0.8
"""Scale at which LineSegmentDetector processes an image (von Gioi et al. 2012, section 2.1)."""
MIN_LENGTH_PX = 10
"""Minimum length of a segment, in pixels of a view."""
EDGE_PX = 3
"""Margin along the border of a partial panorama, in pixels. Segments there are the border itself."""


def find_segments(rgb: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
    """Detect line segments in a panorama.

    OpenCV's LineSegmentDetector ("LSD: a line segment detector", von Gioi et al. 2012) runs on six views with the
    resolution of the panorama. It compares directions of gradients, so its result depends little on the light. Weak
    segments are lost in evening light. Contrast enhancement (CLAHE) is not used, because it turns texture into
    segments.

    Args:
        rgb: (H, 2H, 3) uint8 panorama.
        valid: (H, 2H) bool, the valid pixels. None if all pixels are valid.

    Returns:
        (N, 2, 3) float64 unit vectors to the ends of the segments in the panorama frame.
    """
    import cv2

    height = rgb.shape[0]
    gray = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD, LSD_SCALE)
    size_px, focal_px, samplings = _faces(height)
    detections = [np.zeros((0, 2, 3))]
    for rotation, (columns, rows) in zip(_ROTATIONS, samplings, strict=True):
        segments = detector.detect(cv2.remap(gray, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))[0]
        if segments is None:
            continue
        # OpenCV rescales the integer pixel coordinates of the reduced image. Here pixel centres are at +0.5
        pixels = segments.reshape(-1, 2, 2).astype(np.float64) + 0.5 / LSD_SCALE
        pixels = pixels[np.linalg.norm(pixels[:, 0] - pixels[:, 1], axis=1) >= MIN_LENGTH_PX]
        rays = np.concatenate([(pixels - size_px / 2) / focal_px, np.ones((len(pixels), 2, 1))], axis=2)
        detections.append(rays / np.linalg.norm(rays, axis=2, keepdims=True) @ rotation.T)
    ends = np.concatenate(detections)
    if valid is not None:
        inside = cv2.erode(valid.astype(np.uint8), np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8), borderValue=1)
        columns, rows = rays_to_pixels(ends, height)
        ends = ends[inside[np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)].all(1)]
    return ends


def _rotations() -> np.ndarray:
    """Return (6, 3, 3) rotations from the axes of each view (x right, y down, z forward) to the panorama frame."""
    forward = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)
    down = np.array([(0, 0, -1)] * 4 + [(1, 0, 0), (-1, 0, 0)], np.float64)
    return np.stack([np.cross(down, forward), down, forward], axis=2)


_ROTATIONS = _rotations()


@lru_cache(maxsize=4)
def _faces(height: int) -> tuple[int, float, list[tuple[np.ndarray, np.ndarray]]]:
    """Return size and focal length, in pixels, of the views of a panorama of this height, and their sampling.

    The sampling is the columns and rows of each view in the panorama, in the convention of OpenCV.
    """
    focal_px = height / np.pi
    size_px = round(2 * focal_px * np.tan(FACE_FOV_RAD / 2))
    y, x = np.mgrid[:size_px, :size_px] + 0.5
    rays = np.stack([(x - size_px / 2) / focal_px, (y - size_px / 2) / focal_px, np.ones_like(x)], axis=-1)
    pixels = [rays_to_pixels(rays @ rotation.T, height) for rotation in _ROTATIONS]
    return (
        size_px,
        focal_px,
        [((columns - 0.5).astype(np.float32), (rows - 0.5).astype(np.float32)) for columns, rows in pixels],
    )
