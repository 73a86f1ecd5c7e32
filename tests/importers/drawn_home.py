"""A furnished room whose range and colour are known in closed form. Nothing here uses salframe."""

from __future__ import annotations

import numpy as np
from foreign_formats import Stand, image_rays, panorama_rays, upright_pose

LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([3.5, 3.0, 2.6])
FURNITURE = (
    ((-2.0, 1.8, 0.0), (-0.8, 3.0, 0.8)),
    ((2.6, -1.5, 0.0), (3.5, 0.2, 1.9)),
    ((1.2, 2.5, 0.0), (2.8, 3.0, 1.1)),
)
"""Low and high corners of boxes in the room."""
MARKER, MARKER_M = np.array([3.5, 1.4, 1.2]), 0.25
"""Centre and radius of a red disk on the wall at x = 3.5."""
STANDS = ((0.4, 0.3, 1.5), (1.3, 1.1, 1.5), (-0.9, -0.3, 1.5), (1.9, -0.4, 1.5))
HEADINGS_DEG = (20.0, 130.0, -75.0, 250.0)


def cast(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distance to the nearest surface along directions (..., 3), in lengths of the directions."""
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.where(direction > 0, HIGH - origin, LOW - origin) / direction
        nearest = np.nanmin(np.where(direction == 0, np.inf, walls), -1)
        for low, high in FURNITURE:
            one, two = (low - origin) / direction, (high - origin) / direction
            enter, leave = np.minimum(one, two).max(-1), np.maximum(one, two).min(-1)
            nearest = np.where((enter < leave) & (enter > 0), np.minimum(nearest, enter), nearest)
    return nearest


def paint(point: np.ndarray) -> np.ndarray:
    """Colour (..., 3) uint8 RGB of points, green and blue, and red on the disk."""
    x, y, z = np.moveaxis(point, -1, 0)
    shade = np.stack([np.zeros_like(x), 120 + 60 * np.sin(2 * x + y), 120 + 60 * np.cos(2 * z + x - y)], -1)
    on_disk = np.linalg.norm(point - MARKER, axis=-1) < MARKER_M
    return np.where(on_disk[..., None], [255.0, 0.0, 0.0], shade).astype(np.uint8)


def draw(origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colour and distance along rays in the world."""
    distance = cast(np.asarray(origin, float), rays)
    return paint(origin + rays * distance[..., None]), distance


def panorama(T_world_pano: np.ndarray, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour and range along the ray of a panorama."""
    return draw(T_world_pano[:3, 3], panorama_rays(height) @ T_world_pano[:3, :3].T)


def image(T_world_camera: np.ndarray, calibration: dict) -> tuple[np.ndarray, np.ndarray]:
    """Colour and z-depth of a camera."""
    return draw(T_world_camera[:3, 3], image_rays(calibration) @ T_world_camera[:3, :3].T)


def stands() -> list[Stand]:
    """Four stands in the room, two in the west and two in the east."""
    return [
        Stand(f"p{number}", "west" if position[0] < 1 else "east", upright_pose(position, heading), image, panorama)
        for number, (position, heading) in enumerate(zip(STANDS, HEADINGS_DEG, strict=True))
    ]
