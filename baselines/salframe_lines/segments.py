"""Line segments of an equirectangular panorama: straight lines are great circles on the sphere, and straight again in
perspective views."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from salframe.panoramas.geometry import rays_to_pixels

FACE_FOV_RAD = np.deg2rad(100)
"""Of each of the six views, the faces of a cube; what exceeds 90 degrees is overlap, so that no segment is lost on the
seams."""
LSD_SCALE = 0.8
"""LineSegmentDetector's own reduction of the image (von Gioi et al. 2012, section 2.1)."""
MIN_LENGTH_PX = 10
EDGE_PX = 3
"""Segments this close to the end of a partial panorama are that end; pixels of the panorama."""


def find_segments(rgb: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
    """(N, 2, 3) float64 unit vectors in the panorama frame: the ends of the segments in an image (H, 2H, 3) uint8.

    OpenCV's LineSegmentDetector ("LSD: a line segment detector", von Gioi et al. 2012) on six views as fine as the
    panorama. It compares directions of gradients, so that light matters little: evening light costs weak segments, and
    raising the contrast first (CLAHE) costs more, since texture turns into segments. valid (H, 2H) bool: where the
    panorama was seen, None for all of it.
    """
    import cv2

    height = rgb.shape[0]
    gray = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD, LSD_SCALE)
    size_px, focal_px, samplings = _faces(height)
    found = [np.zeros((0, 2, 3))]
    for rotation, (columns, rows) in zip(_ROTATIONS, samplings, strict=True):
        segments = detector.detect(cv2.remap(gray, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))[0]
        if segments is None:
            continue
        # OpenCV scales the reduced image's pixel numbers back, not their centres, and these lie at +0.5 here
        pixels = segments.reshape(-1, 2, 2).astype(np.float64) + 0.5 / LSD_SCALE
        pixels = pixels[np.linalg.norm(pixels[:, 0] - pixels[:, 1], axis=1) >= MIN_LENGTH_PX]
        rays = np.concatenate([(pixels - size_px / 2) / focal_px, np.ones((len(pixels), 2, 1))], axis=2)
        found.append(rays / np.linalg.norm(rays, axis=2, keepdims=True) @ rotation.T)
    ends = np.concatenate(found)
    if valid is not None:
        inside = cv2.erode(valid.astype(np.uint8), np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8), borderValue=1)
        columns, rows = rays_to_pixels(ends, height)
        ends = ends[inside[np.minimum(rows.astype(int), height - 1), columns.astype(int) % (2 * height)].all(1)]
    return ends


def _rotations() -> np.ndarray:
    """(6, 3, 3) from the axes of each view (x right, y down, z forward) to the panorama frame."""
    forward = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)
    down = np.array([(0, 0, -1)] * 4 + [(1, 0, 0), (-1, 0, 0)], np.float64)
    return np.stack([np.cross(down, forward), down, forward], axis=2)


_ROTATIONS = _rotations()


@lru_cache(maxsize=4)
def _faces(height: int) -> tuple[int, float, list[tuple[np.ndarray, np.ndarray]]]:
    """Size and focal length (pixels) of the views of a panorama of this height, and the columns and rows they sample,
    in OpenCV's convention."""
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
