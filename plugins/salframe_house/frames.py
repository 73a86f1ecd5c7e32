"""Where panoramas are taken: reference frames in every room and doorway, queries a little way from them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from salframe.panoramas.geometry import wrap_angle
from salframe.panoramas.rendered import FrameRole, FrameSpec
from salframe_house.building import Building
from salframe_house.lighting import Lighting

QueryYaw = Literal["uniform", "normal", "same"]

CAMERA_HEIGHT_M = 1.5
LATER: tuple[Lighting, ...] = ("evening", "dim")  # of queries
CLEARANCE_M = 0.25
REACH_M = 3.0  # every free point of a room lies this near a reference frame
MEAN_SHIFT_M = 0.70  # of a query from its room's nearest reference frame
SHIFT_M = (0.3, 1.1)  # least and most, where that is the mean
_MEAN_TOLERANCE_M = 0.01
_GRID_M = 0.05  # of the places for queries
_MAP_CLEARANCE_M = 0.40
_HEIGHT_JITTER_M = 0.03
_NORMAL_YAW_RAD = np.radians(16.6) * np.sqrt(np.pi / 2)  # deviation of a normal angle with mean absolute 16.6 deg


@dataclass(frozen=True)
class HouseFrame(FrameSpec):
    """A panorama of a building, and in which light it is taken. `place` is the room's id, or "transition-.." in a
    doorway."""

    lighting: Lighting


def choose_frames(
    building: Building,
    changed: Building,
    seed: int,
    queries_per_room: int = 3,
    query_yaw: QueryYaw = "uniform",
    query_shift_m: float = MEAN_SHIFT_M,
    frames_per_room: int | None = None,
) -> tuple[HouseFrame, ...]:
    """Map and transition frames of a building by day, and queries of its changed version in the evening or in dim
    light.

    Queries stand in free space, 0.3 to 1.1 m from the nearest map frame of their room; the mean of these shifts is
    within 0.01 m of 0.70 m. Another mean of `query_shift_m` scales both, as far as rooms allow. Their yaw is uniform
    over the circle, that of this reference frame plus a normal angle of 16.6 deg mean absolute value, or the same. Where a
    room has more than `frames_per_room` reference frames, so many take their place, and the queries stand where they would.
    """
    rng = np.random.default_rng((building.seed, seed, 6))
    frames = []
    for room, points in _map_points(building).items():
        frames += [
            _frame(f"map-{room}-{i}", "map", room, point, rng.uniform(-np.pi, np.pi), "day")
            for i, point in enumerate(points)
        ]
    for number, door in enumerate(building.doors, 1):
        name = f"transition-{number:02d}"
        frames.append(_frame(name, "transition", name, door.centre_m, rng.uniform(-np.pi, np.pi), "day"))
    queries = _queries(frames, changed, rng, queries_per_room, query_yaw, query_shift_m)
    return (*(frames if frames_per_room is None else _fewer(frames, building, frames_per_room)), *queries)


def _frame(
    name: str, role: FrameRole, place: str, point_m, yaw_rad: float, lighting: Lighting, z_m: float = CAMERA_HEIGHT_M
) -> HouseFrame:
    x, y = (round(float(value), 4) for value in point_m)
    return HouseFrame(name, role, place, x, y, round(z_m, 4), round(float(yaw_rad), 6), lighting)


def _fewer(frames: list[HouseFrame], building: Building, most: int) -> list[HouseFrame]:
    """The frames, of each room at most so many, which then stand as suits their number; yaws stay."""
    points, count = _map_points(building, most), Counter(frame.place for frame in frames)
    fewer = []
    for frame in frames:
        if count[frame.place] <= most:
            fewer.append(frame)
        elif (number := int(frame.id.rpartition("-")[2])) < most:
            fewer.append(_frame(frame.id, "map", frame.place, points[frame.place][number], frame.yaw_rad, "day"))
    return fewer


def _map_points(building: Building, most: float = np.inf) -> dict[str, np.ndarray]:
    """Room id -> (N, 2) places in the open near all of its free floor, N at most `most`: greedy medians, each then put
    in the middle of its share."""
    open_space = building.free_space(_MAP_CLEARANCE_M, 0.1)
    chosen = {}
    for room, free in building.free_space(CLEARANCE_M, 0.1).items():
        distance = cdist(open_space[room] if len(open_space[room]) else free, free)
        centres = [int(distance.mean(1).argmin())]
        while distance[centres].min(0).max() > REACH_M and len(centres) < most:
            centres.append(int(np.minimum(distance, distance[centres].min(0)).mean(1).argmin()))
            share = distance[centres].argmin(0)
            centres = [int(distance[:, share == i].max(1).argmin()) for i in range(len(centres))]
        chosen[room] = (open_space[room] if len(open_space[room]) else free)[centres]
    return chosen


def _queries(
    frames: list[HouseFrame], changed: Building, rng: np.random.Generator, per_room: int, yaw: QueryYaw, mean_m: float
) -> list[HouseFrame]:
    min_m, max_m = (limit * (mean_m / MEAN_SHIFT_M) for limit in SHIFT_M)
    free = changed.free_space(CLEARANCE_M, _GRID_M)
    own = {room.id: [frame for frame in frames if frame.place == room.id] for room in changed.rooms}
    rooms = [room.id for room in changed.rooms for _ in range(per_room)]
    shift = {}
    for room in own:
        shift[room] = cKDTree([(f.x_m, f.y_m) for f in own[room]]).query(free[room])[0]
        within = (shift[room] >= min_m) & (shift[room] <= max_m)
        if within.any():
            free[room], shift[room] = free[room][within], shift[room][within]
    chosen = [_near(shift[room], rng.uniform(min_m, max_m), rng) for room in rooms]
    _balance(rooms, chosen, shift, mean_m, (min_m, max_m), rng)
    queries = []
    for number, (room, index) in enumerate(zip(rooms, chosen, strict=True)):
        point = free[room][index]
        nearest = min(own[room], key=lambda frame: float(np.hypot(frame.x_m - point[0], frame.y_m - point[1])))
        if mean_m == 0 and shift[room][index] < _GRID_M:
            point = nearest.x_m, nearest.y_m
        turn_rad = rng.uniform(-np.pi, np.pi) if yaw == "uniform" else rng.normal(0.0, _NORMAL_YAW_RAD)
        angle = {"uniform": turn_rad, "normal": nearest.yaw_rad + turn_rad, "same": nearest.yaw_rad}[yaw]
        z = CAMERA_HEIGHT_M + rng.uniform(-_HEIGHT_JITTER_M, _HEIGHT_JITTER_M)
        lighting = LATER[rng.choice(len(LATER))]
        # Known by its number among all frames: its room would tell where it was taken.
        name = f"query-{len(frames) + number:04d}"
        queries.append(_frame(name, "query", room, point, wrap_angle(angle), lighting, z))
    return queries


def _near(shift_m: np.ndarray, wanted_m: float, rng: np.random.Generator) -> int:
    """A random one of the points whose shift is about the wanted one, or that which comes nearest."""
    close = np.flatnonzero(np.abs(shift_m - wanted_m) < 0.03)
    return int(rng.choice(close)) if len(close) else int(np.abs(shift_m - wanted_m).argmin())


def _balance(
    rooms: list[str],
    chosen: list[int],
    shift_m: dict[str, np.ndarray],
    mean_m: float,
    limits_m: tuple[float, float],
    rng: np.random.Generator,
) -> None:
    """Draw random queries again, nearer or farther, until the mean shift is right: not all rooms have room for the
    larger shifts."""
    values = np.array([shift_m[room][index] for room, index in zip(rooms, chosen, strict=True)])
    for _ in range(200 * len(rooms)):
        excess = values.mean() - mean_m
        if abs(excess) <= _MEAN_TOLERANCE_M:
            return
        i = int(rng.integers(len(rooms)))
        wanted = rng.uniform(limits_m[0], values[i]) if excess > 0 else rng.uniform(values[i], limits_m[1])
        chosen[i] = _near(shift_m[rooms[i]], wanted, rng)
        values[i] = shift_m[rooms[i]][chosen[i]]
