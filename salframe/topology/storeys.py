"""The storeys of reference frames, and the walks between them, from the heights of the cameras."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from salframe.panoramas.frames import ReferenceFrame
from salframe.topology.topological_map import EdgeKind

MIN_STOREY_M = 1.5
"""Minimum difference in height between two successive cameras of different storeys."""
MIN_LEVEL_M = 2.2
"""Minimum difference in height between the cameras of two storeys that frames on stairs connect."""
LEVEL_M = 0.4
"""Maximum difference in height between the cameras of a level and its middle."""
MIN_LEVEL_FRAMES = 2
"""Minimum number of frames of a level."""
MAX_STEP_M = 4.0
"""Maximum distance between two successive frames of a recorded walk."""
MAX_LIFT_M = 1.0
"""Maximum horizontal length of a ride in a lift."""


def storeys(camera_z_m: np.ndarray) -> list[np.ndarray]:
    """Return the indices of the cameras of each storey, lowest first.

    A storey ends where the next higher camera is at least MIN_STOREY_M higher. Storeys that frames on stairs connect
    have no such gap: they are the levels with most cameras, at least MIN_LEVEL_M apart. Cameras more than LEVEL_M from
    these levels are on the stairs and belong to no storey.

    Args:
        camera_z_m: (N,) heights of the cameras in the world frame.
    """
    order = np.argsort(camera_z_m, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(camera_z_m[order]) >= MIN_STOREY_M) + 1)
    return [level for part in parts for level in _split_levels(part, camera_z_m)]


def _split_levels(part: np.ndarray, camera_z_m: np.ndarray) -> list[np.ndarray]:
    """Return the levels of cameras `part` (indices, sorted by height) whose heights have no gap."""
    z_m = camera_z_m[part]
    count = np.searchsorted(z_m, z_m + LEVEL_M, "right") - np.searchsorted(z_m, z_m - LEVEL_M, "left")
    levels_m: list[float] = []
    for number in np.argsort(-count, kind="stable"):
        is_apart = all(abs(z_m[number] - level_m) >= MIN_LEVEL_M for level_m in levels_m)
        if is_apart and count[number] >= MIN_LEVEL_FRAMES:
            levels_m.append(float(z_m[number]))
    if len(levels_m) < 2:
        return [part]
    return [part[np.abs(z_m - level_m) <= LEVEL_M] for level_m in sorted(levels_m)]


@dataclass(frozen=True)
class StoreyChange:
    """A recorded walk from one storey to another.

    Attributes:
        start: The last frame before the walk.
        end: The first frame after it.
        kind: Stairs or lift.
        length_m: Length of the walk between them.
    """

    start: ReferenceFrame
    end: ReferenceFrame
    kind: EdgeKind
    length_m: float


def find_walks(frames: Sequence[ReferenceFrame], ends: Container[str]) -> Iterator[StoreyChange]:
    """Yield the walks between storeys in frames that are in the order of their recording.

    A walk by stairs has frames on the way. A ride in a lift has a horizontal length of at most MAX_LIFT_M. Successive
    frames that are more than MAX_STEP_M apart are no walk, unless they are at the two ends of a lift.

    Args:
        frames: The frames.
        ends: Ids of the frames where a walk may start or end. Others are on the way.
    """
    if not frames:
        return
    xyz_m = np.array([frame.T_world_pano[:3, 3] for frame in frames])
    storey = np.full(len(frames), -1)
    for number, members in enumerate(storeys(xyz_m[:, 2])):
        storey[members] = number
    storey[[frame.id not in ends for frame in frames]] = -1
    on_storey = np.flatnonzero(storey >= 0)
    for start, end in pairwise(on_storey.tolist()):
        if storey[start] == storey[end]:
            continue
        steps_m = np.diff(xyz_m[start : end + 1], axis=0)
        lengths_m = np.linalg.norm(steps_m, axis=1)
        is_lift = np.linalg.norm(steps_m[:, :2], axis=1).sum() <= MAX_LIFT_M
        if is_lift or (len(steps_m) > 1 and lengths_m.max() <= MAX_STEP_M):
            kind = EdgeKind.LIFT if is_lift else EdgeKind.STAIRS
            yield StoreyChange(frames[start], frames[end], kind, float(lengths_m.sum()))
