"""Among the parts of a map: its method, its frames, and what the method remembers of each of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.array_files import ArrayKind
from salframe.framework.columns import Columns, Row, read_columns, write_columns
from salframe.framework.config import ComponentConfig, Settings
from salframe.framework.errors import DataError
from salframe.framework.files import read_model, write_json
from salframe.localization.answers import RIGID_TOLERANCE
from salframe.panoramas.frames import FrameKind, MapFrame
from salframe.panoramas.geometry import are_rotations

METHOD, FRAMES, SCENES, INDEX = "method.json", "frames", "scenes", "index"
_CHUNK = 1 << 14
"""Poses of so many frames are checked at once."""
_NAME = ArrayKind("U", ())
_FRAME = {"id": _NAME, "place": _NAME, "kind": _NAME, "pose": ArrayKind("f", (None,))}
_LEVEL, _TILTED = 5, 12
"""Numbers of a pose: x, y, z, cosine and sine of the yaw where it is turned about the vertical alone, as panoramas
mostly are; else the upper rows of its matrix."""


class SavedMethod(Settings):
    """method.json: the localizer's version and settings, and a digest of what its descriptions depend on."""

    version: str
    localizer: dict[str, Any]
    described_by: str


def read_method(parts: Path) -> SavedMethod:
    """The method among the parts of a map. Raises DataError where there is none."""
    if not (parts / METHOD).exists():
        raise DataError(f"{parts.parent} has no localizer: it was built from data without mapping frames")
    return read_model(parts / METHOD, SavedMethod)


def write_method(parts: Path, version: str, config: ComponentConfig, described_by: str) -> None:
    """Write which method makes a map, to a folder with its parts."""
    write_json(
        parts / METHOD, {"version": version, "localizer": config.model_dump(mode="json"), "described_by": described_by}
    )


def check_method(parts: Path, name: str, version: str, described_by: str) -> None:
    """Raises DataError where the method among the parts of a map is not this one, or its descriptions are made of
    something else than `described_by`."""
    saved = read_method(parts)
    kind = saved.localizer.get("kind")
    if (kind, saved.version) != (name, version):
        raise DataError(f"{parts.parent} was made by {kind} {saved.version}, expected {name} {version}: build it again")
    if saved.described_by != described_by:
        raise DataError(
            f"{parts.parent} was described with other settings, weights or files than {name} has now: build it again"
        )


class SavedFrames(Sequence[MapFrame]):
    """The S frames among the parts of a map, each made when it is first asked for; is_scene (S,) bool."""

    def __init__(self, rows: Columns) -> None:
        """rows: of `write_scenes`."""
        self._columns, self._rows, self._made = rows.columns, len(rows), dict[int, MapFrame]()
        kinds = np.array(rows.columns["kind"].words)
        self.is_scene = (kinds == FrameKind.SCENE)[rows.columns["kind"].values]

    def poses(self, low: int = 0, high: int | None = None) -> np.ndarray:
        """(high - low, 3, 4) float64: the upper rows of the poses of frames in a row, of all unless told."""
        high = len(self) if high is None else min(high, len(self))
        numbers, start = self._columns["pose"].values, self._columns["pose"].start[low : high + 1]
        first, is_level = start[:-1], np.diff(start) == _LEVEL
        T_world_pano = np.zeros((len(first), 3, 4))
        T_world_pano[is_level] = _level_poses(numbers[first[is_level, None] + np.arange(_LEVEL)])
        T_world_pano[~is_level] = numbers[first[~is_level, None] + np.arange(_TILTED)].reshape(-1, 3, 4)
        return T_world_pano

    def are_rigid(self, low: int, high: int) -> np.ndarray:
        """(high - low,) bool: whether the pose of each of the frames in a row is a rigid motion."""
        numbers, start = self._columns["pose"].values, self._columns["pose"].start[low : high + 1]
        first, is_level = start[:-1], np.diff(start) == _LEVEL
        rigid, (cos, sin) = np.zeros(len(first), bool), (numbers[first[is_level] + axis] for axis in (3, 4))
        rigid[is_level] = np.isclose(cos * cos + sin * sin, 1, atol=RIGID_TOLERANCE)
        tilted = numbers[first[~is_level, None] + np.arange(_TILTED)].reshape(-1, 3, 4)
        rigid[~is_level] = are_rotations(tilted[..., :3], RIGID_TOLERANCE)
        return rigid

    def __len__(self) -> int:
        return self._rows

    def __getitem__(self, number: Any) -> Any:
        if isinstance(number, slice):
            return [self[i] for i in range(len(self))[number]]
        number = range(len(self))[number]
        if number not in self._made:
            T_world_pano = np.eye(4)
            T_world_pano[:3] = self.poses(number, number + 1)[0]
            id, place, kind = (self._columns[name][number].item() for name in ("id", "place", "kind"))
            self._made[number] = MapFrame(id, place, T_world_pano, FrameKind(kind))
        return self._made[number]


def write_scenes(parts: Path, packed: Iterable[Row], frames: Iterable[MapFrame]) -> None:
    """Write what a method remembers of each frame of a map, as it packed it, and the frames, but for their panoramas,
    to a folder with the map's parts."""
    rows = (
        {
            "id": np.array(frame.id),
            "place": np.array(frame.place),
            "kind": np.array(str(frame.kind)),
            "pose": _pose_numbers(frame.T_world_pano[:3]),
        }
        for frame in frames
    )
    write_columns(parts / FRAMES, rows)
    write_columns(parts / SCENES, packed)


def read_scenes(parts: Path) -> tuple[Columns, SavedFrames]:
    """What `write_scenes` wrote. Raises DataError."""
    packed, frames = read_columns(parts / SCENES), _read_frames(parts / FRAMES)
    if len(packed) != len(frames):
        raise DataError(f"{parts} has {len(packed)} scenes and {len(frames)} frames, expected one for each")
    return packed, frames


def _pose_numbers(T_world_pano: np.ndarray) -> np.ndarray:
    """The numbers from which the upper rows of a pose (3, 4) are had again, every bit."""
    level = np.concatenate([T_world_pano[:, 3], T_world_pano[:2, 0]])
    return level if np.array_equal(_level_poses(level[None])[0], T_world_pano) else T_world_pano.ravel()


def _level_poses(numbers: np.ndarray) -> np.ndarray:
    """(N, 3, 4) upper rows of poses that are turned about the vertical alone, of their numbers (N, 5)."""
    x, y, z, cos, sin = numbers.T
    none, one = np.zeros(len(numbers)), np.ones(len(numbers))
    return np.stack([cos, -sin, none, x, sin, cos, none, y, none, none, one, z], 1).reshape(-1, 3, 4)


def _read_frames(folder: Path) -> SavedFrames:
    rows = read_columns(folder, _FRAME)
    if not rows:
        raise DataError(f"{folder} holds no frame: build the map again")
    if strange := set(rows.columns["kind"].words or ()) - set(FrameKind):
        raise DataError(f"{folder} has frames of the kind {min(strange)!r}: build the map again")
    if strange := set(np.diff(rows.columns["pose"].start).tolist()) - {_LEVEL, _TILTED}:
        raise DataError(f"{folder} has a pose of {min(strange)} numbers, expected {_LEVEL} or {_TILTED}")
    frames = SavedFrames(rows)
    for low in range(0, len(frames), _CHUNK):
        if not (rigid := frames.are_rigid(low, min(low + _CHUNK, len(frames)))).all():
            strays = frames[low + int(np.argmin(rigid))].id
            raise DataError(f"{folder}: the pose of {strays} is no rigid motion: build the map again")
    return frames
