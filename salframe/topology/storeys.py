"""The storeys of reference frames, and the walks between them, from the heights of the cameras."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from salframe.panoramas.floors import MIN_STOREY_GAP_M
from salframe.panoramas.frames import ReferenceFrame
from salframe.topology.topological_map import EdgeKind

MIN_LEVEL_M = 2.2
"""Minimum difference, in metres, between the camera heights of two storeys if there are frames on the stairs between
them."""
LEVEL_M = 0.4
"""Maximum difference, in metres, between the height of a camera and the middle height of its storey if there are frames
on the stairs."""
MIN_LEVEL_FRAMES = 2
"""Minimum number of frames of a storey if there are frames on the stairs."""
MAX_STEP_M = 4.0
"""Maximum distance, in metres, between two successive frames of a recorded walk."""
MAX_LIFT_M = 1.0
"""Maximum horizontal length, in metres, of a ride in a lift."""


def storeys(camera_z_m: np.ndarray) -> list[np.ndarray]:
    """Return the indices of the cameras of each storey, lowest first.

    The camera heights of two storeys are separated by a gap of at least MIN_STOREY_GAP_M. If there are frames on the
    stairs between two storeys, there is no such gap. Then the storeys are the heights with the largest numbers of
    cameras, at least MIN_LEVEL_M apart. Cameras that are more than LEVEL_M higher or lower are on the stairs and belong
    to no storey.

    Args:
        camera_z_m: (N,) heights of the cameras in the world frame, in metres.
    """
    order = np.argsort(camera_z_m, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(camera_z_m[order]) >= MIN_STOREY_GAP_M) + 1)
    return [level for part in parts for level in _split_levels(part, camera_z_m)]


def _split_levels(part: np.ndarray, camera_z_m: np.ndarray) -> list[np.ndarray]:
    """Split a group of cameras whose heights have no gap into storeys. `part` has the indices of the cameras, sorted by
    height."""
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
        end: The first frame after the walk.
        kind: Stairs or lift.
        length_m: Length of the walk from `start` to `end` in metres.
    """

    start: ReferenceFrame
    end: ReferenceFrame
    kind: EdgeKind
    length_m: float


def find_walks(frames: Sequence[ReferenceFrame], ends: Container[str]) -> Iterator[StoreyChange]:
    """Yield the recorded walks between storeys.

    A walk by stairs has frames on the stairs, and its successive frames are at most MAX_STEP_M apart. A ride in a lift
    has a horizontal length of at most MAX_LIFT_M.

    Args:
        frames: The frames in the order of their recording.
        ends: Ids of the frames where a walk may start or end. The other frames can only be on the way.
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
