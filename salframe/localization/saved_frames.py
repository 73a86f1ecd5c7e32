"""The reference frames of a saved map: rows of a table, mapped into memory and read on demand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.array_files import ArrayKind
from salframe.framework.files.columns import Columns, Row
from salframe.localization.answers import RIGID_TOLERANCE
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import are_rotations

_CHUNK = 1 << 14
"""Number of poses to check at a time."""
_NAME = ArrayKind("U", ())
FRAME_COLUMNS = {"id": _NAME, "place": _NAME, "kind": _NAME, "pose": ArrayKind("f", (None,))}
"""Kind and shape of each column of the table of reference frames in a saved map, by name."""
_LEVEL, _TILTED = 5, 12
"""Number of values in the two formats of a pose. Level, for an upright panorama: x, y, z, cosine and sine of the yaw.
Tilted: the first three rows of the pose matrix."""


class SavedFrames(Sequence[ReferenceFrame]):
    """The S reference frames of a saved map, each created when it is first read.

    Attributes:
        is_scene: (S,) bool, whether each frame is a scene frame (in a room) and not a transition frame (in a doorway).

    Raises:
        DataError: A frame has an unknown kind, or a pose that is not a rigid motion.
    """

    def __init__(self, rows: Columns) -> None:
        """Read a table with the rows of `frame_row`."""
        self._columns, self._rows, self._created = rows.columns, len(rows), dict[int, ReferenceFrame]()
        self._check(rows)
        kinds = np.array(rows.columns["kind"].words)
        self.is_scene = (kinds == FrameKind.SCENE)[rows.columns["kind"].values]

    def poses(self, low: int = 0, high: int | None = None) -> np.ndarray:
        """Return the poses of the frames from `low` to `high` - 1 (default: all frames), (N, 3, 4) float64: the first
        three rows of each pose matrix."""
        high = len(self) if high is None else min(high, len(self))
        numbers, start = self._columns["pose"].values, self._columns["pose"].start[low : high + 1]
        first, is_level = start[:-1], np.diff(start) == _LEVEL
        T_world_pano = np.zeros((len(first), 3, 4))
        T_world_pano[is_level] = _level_poses(numbers[first[is_level, None] + np.arange(_LEVEL)])
        T_world_pano[~is_level] = numbers[first[~is_level, None] + np.arange(_TILTED)].reshape(-1, 3, 4)
        return T_world_pano

    def __len__(self) -> int:
        return self._rows

    def __getitem__(self, number: Any) -> Any:
        if isinstance(number, slice):
            return [self[i] for i in range(len(self))[number]]
        number = range(len(self))[number]
        if number not in self._created:
            T_world_pano = np.eye(4)
            T_world_pano[:3] = self.poses(number, number + 1)[0]
            id, place, kind = (self._columns[name][number].item() for name in ("id", "place", "kind"))
            self._created[number] = ReferenceFrame(id, place, T_world_pano, FrameKind(kind))
        return self._created[number]

    def _check(self, rows: Columns) -> None:
        if not rows:
            raise DataError(f"{rows.folder} has no frames: build the map again")
        if unknown := set(rows.columns["kind"].words or ()) - set(FrameKind):
            raise DataError(
                f"{rows.folder} has a frame of the unknown kind {min(unknown)!r}, expected one of "
                f"{', '.join(FrameKind)}: build the map again"
            )
        if lengths := set(np.diff(rows.columns["pose"].start).tolist()) - {_LEVEL, _TILTED}:
            raise DataError(
                f"{rows.folder} has a pose of {min(lengths)} numbers, expected {_LEVEL} or {_TILTED} numbers: "
                "build the map again"
            )
        for low in range(0, len(self), _CHUNK):
            if not (rigid := self._are_rigid(low, min(low + _CHUNK, len(self)))).all():
                frame = self._columns["id"][low + int(np.argmin(rigid))].item()
                raise DataError(
                    f"{rows.folder}: the pose of the frame {frame} is not a rigid motion: build the map again"
                )

    def _are_rigid(self, low: int, high: int) -> np.ndarray:
        """Return whether each pose of the frames from `low` to `high` - 1 is a rigid motion, (high - low,) bool."""
        numbers, start = self._columns["pose"].values, self._columns["pose"].start[low : high + 1]
        first, is_level = start[:-1], np.diff(start) == _LEVEL
        rigid, (cos, sin) = np.zeros(len(first), bool), (numbers[first[is_level] + axis] for axis in (3, 4))
        rigid[is_level] = np.isclose(cos * cos + sin * sin, 1, atol=RIGID_TOLERANCE)
        tilted = numbers[first[~is_level, None] + np.arange(_TILTED)].reshape(-1, 3, 4)
        rigid[~is_level] = are_rotations(tilted[..., :3], RIGID_TOLERANCE)
        return rigid


def frame_row(frame: ReferenceFrame) -> Row:
    """Return the row of a frame in a table of frames. Its panorama is not saved."""
    return {
        "id": np.array(frame.id),
        "place": np.array(frame.place),
        "kind": np.array(str(frame.kind)),
        "pose": _pose_numbers(frame.T_world_pano[:3]),
    }


def _pose_numbers(T_world_pano: np.ndarray) -> np.ndarray:
    """Return the numbers that a pose (3, 4) is stored as: 5 numbers if they restore the pose exactly, otherwise 12."""
    level = np.concatenate([T_world_pano[:, 3], T_world_pano[:2, 0]])
    return level if np.array_equal(_level_poses(level[None])[0], T_world_pano) else T_world_pano.ravel()


def _level_poses(numbers: np.ndarray) -> np.ndarray:
    """Return the first three rows of the poses of upright frames, (N, 3, 4), from their numbers (N, 5)."""
    x, y, z, cos, sin = numbers.T
    zero, one = np.zeros(len(numbers)), np.ones(len(numbers))
    return np.stack([cos, -sin, zero, x, sin, cos, zero, y, zero, zero, one, z], 1).reshape(-1, 3, 4)
