"""Range images of rooms with straight walls and boxes, computed in closed form for the tests of derived floors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays, pose_2d
from salframe.panoramas.panorama import Panorama

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Lowest and highest corner (x, y, z) in metres."""
CEILING_M = 2.6


def box_range(boxes: Sequence[Box], T_world_pano: np.ndarray, floor_m: float = 0.0, height: int = 192) -> np.ndarray:
    """Return the range (H, 2H) to the nearest of some boxes, the floor and the ceiling, by the slab method."""
    rays = equirectangular_rays(height).reshape(-1, 3).astype(np.float64) @ T_world_pano[:3, :3].T
    rays = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    camera_m = T_world_pano[:3, 3]
    floor_range = np.where(rays[:, 2] < 0, (floor_m - camera_m[2]) / rays[:, 2], np.inf)
    nearest = np.minimum(
        floor_range, np.where(rays[:, 2] > 0, (floor_m + CEILING_M - camera_m[2]) / rays[:, 2], np.inf)
    )
    for low, high in boxes:
        first, second = ((np.array(corner) - camera_m) / rays for corner in (low, high))
        enter, leave = np.minimum(first, second).max(1), np.maximum(first, second).min(1)
        nearest = np.where((enter <= leave) & (enter > 0), np.minimum(nearest, enter), nearest)
    return nearest.reshape(height, 2 * height).astype(np.float32)


def two_room_walls(door_m: float = 0.9, floor_m: float = 0.0) -> list[Box]:
    """Return the walls of two rooms, west from x = -4 to -0.1 and east from 0.1 to 4, y from -2 to 2, with a doorway
    around (0, 0)."""
    low, high = floor_m, floor_m + CEILING_M
    half = door_m / 2
    outer = [
        ((-4.2, -2.2), (4.2, -2.0)),
        ((-4.2, 2.0), (4.2, 2.2)),
        ((-4.2, -2.2), (-4.0, 2.2)),
        ((4.0, -2.2), (4.2, 2.2)),
    ]
    inner = [((-0.1, -2.0), (0.1, -half)), ((-0.1, half), (0.1, 2.0))]
    lintel: Box = ((-0.1, -half, floor_m + 2.05), (0.1, half, high))
    return [lintel, *(((x0, y0, low), (x1, y1, high)) for (x0, y0), (x1, y1) in outer + inner)]


def range_frame(
    id: str,
    place: str,
    x_m: float,
    y_m: float,
    boxes: Sequence[Box],
    yaw_rad: float = 0.4,
    floor_m: float = 0.0,
    kind: FrameKind = FrameKind.SCENE,
) -> ReferenceFrame:
    """Return a frame 1.5 m above the floor that sees some boxes."""
    pose = pose_2d(x_m, y_m, yaw_rad, floor_m + 1.5)
    return ReferenceFrame(id, place, pose, kind, lambda: Panorama(id, range_m=box_range(boxes, pose, floor_m)))
