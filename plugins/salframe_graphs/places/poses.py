"""Poses of a query in the places of a map, and the objects of the places relative to the query at these poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.graphs.segments import Segments, ranges


@dataclass(frozen=True, eq=False)
class Poses:
    """C poses of a query in the world.

    Attributes:
        place: (C,) index of the place of each pose.
        shift_m: (C, 2) x and y in the world, metres.
        yaw_rad: (C,) heading in the world.
        camera_height_offset_m: (C,) height of the camera above its expected height; by default 0.
        scale: (C,) factor from the query's ranges to true ranges; by default 1.
    """

    place: np.ndarray
    shift_m: np.ndarray
    yaw_rad: np.ndarray
    camera_height_offset_m: np.ndarray = None  # type: ignore[assignment]  # set in __post_init__
    scale: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.camera_height_offset_m is None:
            object.__setattr__(self, "camera_height_offset_m", np.zeros(len(self.place)))
        if self.scale is None:
            object.__setattr__(self, "scale", np.ones(len(self.place)))

    def __len__(self) -> int:
        return len(self.place)

    @classmethod
    def concatenate(cls, parts: Sequence[Poses]) -> Poses:
        """Return the poses of all parts, one part after the other."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))

    def take(self, rows: np.ndarray) -> Poses:
        """Return the poses with the indices `rows`."""
        return Poses(
            self.place[rows],
            self.shift_m[rows],
            self.yaw_rad[rows],
            self.camera_height_offset_m[rows],
            self.scale[rows],
        )

    def with_places(self, place: np.ndarray) -> Poses:
        """Return a copy of the C poses with other indices (C,) of their places."""
        return Poses(place, self.shift_m, self.yaw_rad, self.camera_height_offset_m, self.scale)

    def where(self, chosen: np.ndarray, other: Poses) -> Poses:
        """Return the poses of `self` where `chosen` (C,) is true, and the poses of `other` elsewhere."""
        return Poses(
            self.place,
            np.where(chosen[:, None], self.shift_m, other.shift_m),
            np.where(chosen, self.yaw_rad, other.yaw_rad),
            np.where(chosen, self.camera_height_offset_m, other.camera_height_offset_m),
            np.where(chosen, self.scale, other.scale),
        )

    def put(self, rows: np.ndarray, other: Poses) -> Poses:
        """Return a copy in which the poses with the indices `rows` are replaced by the poses of `other`."""
        shift_m, yaw_rad, camera_height_offset_m, scale = (
            values.copy() for values in (self.shift_m, self.yaw_rad, self.camera_height_offset_m, self.scale)
        )
        shift_m[rows], yaw_rad[rows], camera_height_offset_m[rows], scale[rows] = (
            other.shift_m,
            other.yaw_rad,
            other.camera_height_offset_m,
            other.scale,
        )
        return Poses(self.place, shift_m, yaw_rad, camera_height_offset_m, scale)


@dataclass(frozen=True, eq=False)
class PoseColumns:
    """For each of C poses, the objects of its place, one pose after the other.

    Attributes:
        objects: (T,) indices of the objects in the index.
        segments: For each pose, the part of `objects` that belongs to it.
    """

    objects: np.ndarray
    segments: Segments

    def take(self, poses: np.ndarray) -> tuple[PoseColumns, np.ndarray]:
        """Return the objects of a subset of the poses, and the positions of these objects among all T objects."""
        count = self.segments.count[poses]
        position = ranges(self.segments.start[poses], count)
        return PoseColumns(self.objects[position], Segments(count)), position


@dataclass(frozen=True, eq=False)
class RelativeObjects:
    """T objects of places relative to the camera of a query.

    Attributes:
        objects: (T,) indices of the objects in the index.
        offset: (T,) complex128, horizontal positions x + iy in the query frame, metres.
        height_m: (T,) heights above the query's camera.
        yaw_rad: (T,) heading of the query in the world.
        scale: (T,) factor from the query's ranges to true ranges.
    """

    objects: np.ndarray
    offset: np.ndarray
    height_m: np.ndarray
    yaw_rad: np.ndarray
    scale: np.ndarray

    def take(self, rows: np.ndarray | slice) -> RelativeObjects:
        """Return the objects with the indices `rows`."""
        return RelativeObjects(*(getattr(self, name)[rows] for name in RelativeObjects.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class RefinedPoses:
    """C poses with their scores, of which R were refined.

    Attributes:
        poses: The poses.
        score: (C,) score of each pose.
        rows: (R,) indices of the refined poses. Their initial scores were near the best score.
        refined: The columns of `share`, grouped by refined pose.
        share: (n, T) probability that each query object is each object of the place of a refined pose.
    """

    poses: Poses
    score: np.ndarray
    rows: np.ndarray
    refined: Segments
    share: np.ndarray

    def share_of(self, pose: int) -> np.ndarray | None:
        """Return the columns (n, m) of `share` for the pose with this index; None if it was not refined."""
        row = int(np.searchsorted(self.rows, pose))
        if row == len(self.rows) or self.rows[row] != pose:
            return None
        return self.share[:, slice(*self.refined.start[row : row + 2])]
