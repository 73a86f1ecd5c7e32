"""Camera poses: reference frames in every room and doorway, and queries near the reference frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from salframe.panoramas.geometry import wrap_angle
from salframe.panoramas.rendered import FrameRole, FrameSpec
from salframe_house.building import Building
from salframe_house.lighting import Lighting

QueryYaw = Literal["uniform", "normal", "same"]

CAMERA_HEIGHT_M = 1.5
QUERY_LIGHTINGS: tuple[Lighting, ...] = ("evening", "dim")
"""Lightings of the queries."""
CLEARANCE_M = 0.25
REACH_M = 3.0
"""Maximum distance of a free point of a room from its nearest reference frame."""
MEAN_SHIFT_M = 0.70
"""Mean distance of a query from the nearest reference frame of its room."""
SHIFT_M = (0.3, 1.1)
"""Minimum and maximum distance of a query from the nearest reference frame of its room, if the mean is
`MEAN_SHIFT_M`."""
_MEAN_TOLERANCE_M = 0.01
_POSITION_STEP_M = 0.1  # grid spacing of candidate positions of reference frames
_GRID_M = 0.05  # grid spacing of candidate query positions
_MAP_CLEARANCE_M = 0.40
_HEIGHT_JITTER_M = 0.03
_NORMAL_YAW_RAD = np.radians(16.6) * np.sqrt(np.pi / 2)  # std of a normal angle with mean absolute value 16.6 deg


@dataclass(frozen=True)
class HouseFrame(FrameSpec):
    """A camera pose in a building.

    Attributes:
        place: Id of the room, or "transition-.." in a doorway.
        lighting: Lighting of the panorama.
    """

    lighting: Lighting


@dataclass(frozen=True)
class TiltedFrame(HouseFrame):
    """A camera pose in a building, tilted about a horizontal axis.

    Attributes:
        tilt_rad: Tilt of the camera.
        axis_rad: Azimuth of the axis of the tilt in the world.
    """

    tilt_rad: float
    axis_rad: float

    @property
    def pose(self) -> np.ndarray:
        axis = np.array([np.cos(self.axis_rad), np.sin(self.axis_rad), 0])
        pose = super().pose
        pose[:3, :3] = Rotation.from_rotvec(self.tilt_rad * axis).as_matrix() @ pose[:3, :3]
        return pose


def move_queries(
    frames: Sequence[HouseFrame], seed: int, tilt_deg: float, height_m: float = CAMERA_HEIGHT_M
) -> tuple[HouseFrame, ...]:
    """Return frames with tilted queries at another height; reference frames do not change.

    Args:
        frames: The frames.
        seed: Seed of the axes of the tilts.
        tilt_deg: Tilt of each query about a random horizontal axis.
        height_m: Mean height of the queries.
    """
    rng = np.random.default_rng((seed, 7))
    moved: list[HouseFrame] = []
    for frame in frames:
        axis_rad = rng.uniform(-np.pi, np.pi)
        if frame.is_query:
            frame = replace(frame, z_m=round(frame.z_m - CAMERA_HEIGHT_M + height_m, 4))
            if tilt_deg:
                frame = TiltedFrame(**asdict(frame), tilt_rad=float(np.radians(tilt_deg)), axis_rad=round(axis_rad, 6))
        moved.append(frame)
    return tuple(moved)


def choose_frames(
    building: Building,
    changed: Building,
    seed: int,
    queries_per_room: int = 3,
    query_yaw: QueryYaw = "uniform",
    query_shift_m: float = MEAN_SHIFT_M,
    frames_per_room: int | None = None,
    frames_per_position: int = 1,
    spacing_m: float = 1.0,
) -> tuple[HouseFrame, ...]:
    """Choose the frames of a building.

    Reference frames (roles "map" and "transition") show the building by day. Queries show its changed version in the
    evening or in dim light. Queries stand in free space, by default 0.3 to 1.1 m from the nearest reference frame of
    their room. The mean of these distances is within 0.01 m of `query_shift_m`, if the rooms are large enough.

    Args:
        building: The building at the time of mapping.
        changed: The building at the time of the queries.
        seed: Seed of the poses.
        queries_per_room: Number of queries in each room.
        query_yaw: Yaw of the queries: "uniform" over the circle; "normal": yaw of the nearest reference frame plus a
            normal angle of 16.6 deg mean absolute value; "same": yaw of the nearest reference frame.
        query_shift_m: Mean distance of a query from the nearest reference frame of its room. Minimum and maximum
            distance are proportional to this mean, as far as the size of the rooms allows.
        frames_per_room: Maximum number of reference frames in a room. Rooms that need more get this number of frames at
            new positions. The queries do not change.
        frames_per_position: Maximum number of reference frames at each of the positions that cover a room. The queries
            do not change.
        spacing_m: Distance of neighbouring frames at a position.
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
    if frames_per_room is not None:
        frames = _limit_frames(frames, building, frames_per_room)
    yaws = np.random.default_rng((building.seed, seed, 8))
    return (*frames, *_neighbours(frames, building, frames_per_position - 1, spacing_m, yaws), *queries)


def _frame(
    name: str, role: FrameRole, place: str, point_m, yaw_rad: float, lighting: Lighting, z_m: float = CAMERA_HEIGHT_M
) -> HouseFrame:
    """Return a frame at a point (x, y), with rounded pose."""
    x, y = (round(float(value), 4) for value in point_m)
    return HouseFrame(name, role, place, x, y, round(z_m, 4), round(float(yaw_rad), 6), lighting)


def _limit_frames(frames: list[HouseFrame], building: Building, max_frames: int) -> list[HouseFrame]:
    """Limit the number of frames in each room. Limited rooms get new positions; yaws do not change."""
    points, count = _map_points(building, max_frames), Counter(frame.place for frame in frames)
    limited = []
    for frame in frames:
        if count[frame.place] <= max_frames:
            limited.append(frame)
        elif (number := int(frame.id.rpartition("-")[2])) < max_frames:
            limited.append(_frame(frame.id, "map", frame.place, points[frame.place][number], frame.yaw_rad, "day"))
    return limited


def _neighbours(
    frames: list[HouseFrame], building: Building, count: int, spacing_m: float, rng: np.random.Generator
) -> list[HouseFrame]:
    """Return up to `count` more frames near each scene frame, `spacing_m` from each other and from it.

    A frame is left out if the room is too small, or if it would be nearer than `spacing_m` / 2 to another frame.
    """
    if not count:
        return []
    open_space = building.free_space(_MAP_CLEARANCE_M, _POSITION_STEP_M)
    taken: dict[str, list[tuple[float, float]]] = {frame.place: [] for frame in frames}
    for frame in frames:
        taken[frame.place].append((frame.x_m, frame.y_m))
    added = []
    for frame in (frame for frame in frames if frame.role == "map"):
        group = [(frame.x_m, frame.y_m)]
        free = open_space[frame.place]
        for number in range(count if len(free) else 0):
            nearest_m = cdist(free, taken[frame.place]).min(1)
            off_m = np.maximum(np.abs(nearest_m - spacing_m) - _POSITION_STEP_M / 2, 0)
            # Among positions at the distance, the one nearest to the whole group: the group stays compact.
            best = np.lexsort((cdist(free, group).mean(1), off_m))[0]
            if nearest_m[best] < spacing_m / 2:
                break
            group.append(tuple(free[best]))
            taken[frame.place].append(tuple(free[best]))
            name = f"{frame.id}-{number + 1}"
            added.append(_frame(name, "map", frame.place, free[best], rng.uniform(-np.pi, np.pi), "day"))
    return added


def _map_points(building: Building, max_points: float = np.inf) -> dict[str, np.ndarray]:
    """Choose positions of reference frames that cover the free floor of each room.

    Positions are added greedily. After each addition, every position moves to the centre of the floor nearest to it.

    Returns:
        Mapping from room id to (N, 2) positions in metres, N at most `max_points`.
    """
    open_space = building.free_space(_MAP_CLEARANCE_M, _POSITION_STEP_M)
    positions = {}
    for room, free in building.free_space(CLEARANCE_M, _POSITION_STEP_M).items():
        distance = cdist(open_space[room] if len(open_space[room]) else free, free)
        centres = [int(distance.mean(1).argmin())]
        while distance[centres].min(0).max() > REACH_M and len(centres) < max_points:
            centres.append(int(np.minimum(distance, distance[centres].min(0)).mean(1).argmin()))
            share = distance[centres].argmin(0)
            centres = [int(distance[:, share == i].max(1).argmin()) for i in range(len(centres))]
        positions[room] = (open_space[room] if len(open_space[room]) else free)[centres]
    return positions


def _queries(
    frames: list[HouseFrame],
    changed: Building,
    rng: np.random.Generator,
    per_room: int,
    yaw_mode: QueryYaw,
    mean_m: float,
) -> list[HouseFrame]:
    """Choose the queries: free positions near the reference frames, then yaw, height and lighting.

    Args:
        frames: Reference frames, including those in doorways.
        changed: The building at the time of the queries.
        rng: Random generator.
        per_room: Number of queries per room.
        yaw_mode: See `choose_frames`.
        mean_m: Mean distance from the nearest reference frame.
    """
    min_m, max_m = (limit * (mean_m / MEAN_SHIFT_M) for limit in SHIFT_M)
    free = changed.free_space(CLEARANCE_M, _GRID_M)
    room_frames = {room.id: [frame for frame in frames if frame.place == room.id] for room in changed.rooms}
    rooms = [room.id for room in changed.rooms for _ in range(per_room)]
    shift = {}
    for room in room_frames:
        shift[room] = cKDTree([(f.x_m, f.y_m) for f in room_frames[room]]).query(free[room])[0]
        within = (shift[room] >= min_m) & (shift[room] <= max_m)
        if within.any():
            free[room], shift[room] = free[room][within], shift[room][within]
    indices = [_near(shift[room], rng.uniform(min_m, max_m), rng) for room in rooms]
    _balance(rooms, indices, shift, mean_m, (min_m, max_m), rng)
    queries = []
    for number, (room, index) in enumerate(zip(rooms, indices, strict=True)):
        point = free[room][index]
        nearest = min(room_frames[room], key=lambda frame: float(np.hypot(frame.x_m - point[0], frame.y_m - point[1])))
        if mean_m == 0 and shift[room][index] < _GRID_M:
            point = nearest.x_m, nearest.y_m
        turn_rad = rng.uniform(-np.pi, np.pi) if yaw_mode == "uniform" else rng.normal(0.0, _NORMAL_YAW_RAD)
        angle = {"uniform": turn_rad, "normal": nearest.yaw_rad + turn_rad, "same": nearest.yaw_rad}[yaw_mode]
        z = CAMERA_HEIGHT_M + rng.uniform(-_HEIGHT_JITTER_M, _HEIGHT_JITTER_M)
        lighting = QUERY_LIGHTINGS[rng.choice(len(QUERY_LIGHTINGS))]
        # The id contains the frame number and not the room, because the room would reveal the position.
        name = f"query-{len(frames) + number:04d}"
        queries.append(_frame(name, "query", room, point, wrap_angle(angle), lighting, z))
    return queries


def _near(shift_m: np.ndarray, target_m: float, rng: np.random.Generator) -> int:
    """Return the index of a random point whose shift is within 3 cm of the target.

    If there is no such point, return the index of the point with the closest shift. The shift is the distance from the
    nearest reference frame.
    """
    close = np.flatnonzero(np.abs(shift_m - target_m) < 0.03)
    return int(rng.choice(close)) if len(close) else int(np.abs(shift_m - target_m).argmin())


def _balance(
    rooms: list[str],
    indices: list[int],
    shift_m: dict[str, np.ndarray],
    mean_m: float,
    limits_m: tuple[float, float],
    rng: np.random.Generator,
) -> None:
    """Redraw random queries, nearer or farther, until the mean distance is within 0.01 m of `mean_m`.

    This is necessary because not all rooms are large enough for the larger shifts.
    """
    values = np.array([shift_m[room][index] for room, index in zip(rooms, indices, strict=True)])
    for _ in range(200 * len(rooms)):
        excess = values.mean() - mean_m
        if abs(excess) <= _MEAN_TOLERANCE_M:
            return
        i = int(rng.integers(len(rooms)))
        target_m = rng.uniform(limits_m[0], values[i]) if excess > 0 else rng.uniform(values[i], limits_m[1])
        indices[i] = _near(shift_m[rooms[i]], target_m, rng)
        values[i] = shift_m[rooms[i]][indices[i]]
