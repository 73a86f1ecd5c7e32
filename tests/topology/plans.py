"""Hand-drawn floor plans for the tests of the topological map."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d

RESOLUTION_M = 0.05


def two_rooms(door_m: float = 0.9, wall_m: float = 0.6, label_threshold: bool = False, z_m: float = 0.0) -> FloorMasks:
    """Two rooms, west and east, 3 m x 3 m each, and a wall with a doorway in its middle; the middle of the doorway
    is at (0, 0).

    The threshold is free floor of no region, or of the west room.
    """
    room, wall, door = (round(metres / RESOLUTION_M) for metres in (3.0, wall_m, door_m))
    free = np.zeros((room + 2, 2 * room + wall + 2), bool)
    region = np.zeros(free.shape, np.int32)
    for number, left in ((1, 1), (2, 1 + room + wall)):
        free[1:-1, left : left + room] = True
        region[1:-1, left : left + room] = number
    top = 1 + (room - door) // 2
    free[top : top + door, 1 + room : 1 + room + wall] = True
    if label_threshold:
        region[top : top + door, 1 + room : 1 + room + wall] = 1
    middle = (1 + room + wall / 2) * RESOLUTION_M, (top + door / 2) * RESOLUTION_M
    return FloorMasks(
        free, region, np.zeros_like(free), RESOLUTION_M, (-middle[0], middle[1]), {1: "west", 2: "east"}, z_m
    )


def block(floor: FloorMasks, low_m: tuple[float, float], high_m: tuple[float, float]) -> FloorMasks:
    """Return the floor with an obstacle from one corner (x, y) to another."""
    obstacle = floor.obstacle.copy()
    left, right = (round((x - floor.origin_m[0]) / floor.resolution_m) for x in (low_m[0], high_m[0]))
    top, bottom = (round((floor.origin_m[1] - y) / floor.resolution_m) for y in (high_m[1], low_m[1]))
    obstacle[top:bottom, left:right] = True
    return FloorMasks(floor.free, floor.region, obstacle, floor.resolution_m, floor.origin_m, floor.regions, floor.z_m)


def frame(
    id: str, x_m: float, y_m: float, place: str = "west", kind: FrameKind = FrameKind.SCENE, z_m: float = 1.5
) -> ReferenceFrame:
    return ReferenceFrame(id, place, pose_2d(x_m, y_m, 0.3, z_m), kind)
