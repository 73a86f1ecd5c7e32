"""A point of the world that pictures show as a green disc, and where a panorama must show it."""

from __future__ import annotations

import numpy as np

GREEN = np.array([0, 255, 0], np.uint8)
BACKGROUND = np.array([90, 60, 120], np.uint8)


def draw(width: int, height: int, column: float, row: float, radius_px: float = 4.0) -> np.ndarray:
    """Picture with a green disc at a pixel, whose centre is at +0.5."""
    y, x = np.mgrid[:height, :width] + 0.5
    picture = np.broadcast_to(BACKGROUND, (height, width, 3)).copy()
    picture[np.hypot(x - column, y - row) <= radius_px] = GREEN
    return picture


def shown_at(rgb: np.ndarray) -> tuple[float, float]:
    """Column and row of the disc in a panorama, which shows it whole."""
    green = rgb[..., 1].astype(float) - rgb[..., 0]
    rows, columns = np.nonzero(green > 128)
    assert len(rows), "the panorama does not show the point"
    return float(columns.mean()) + 0.5, float(rows.mean()) + 0.5


def expected_at(point_m: np.ndarray, T_world_pano: np.ndarray, height: int) -> tuple[float, float, float]:
    """Column, row and range of a point in a panorama (x forward, y left, z up), in closed form."""
    x, y, z = T_world_pano[:3, :3].T @ (np.asarray(point_m) - T_world_pano[:3, 3])
    range_m = float(np.sqrt(x * x + y * y + z * z))
    column = height * (1 - np.arctan2(y, x) / np.pi)
    row = height * (0.5 - np.arcsin(z / range_m) / np.pi)
    return float(column), float(row), range_m
