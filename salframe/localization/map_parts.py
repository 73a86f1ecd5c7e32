"""Among the parts of a map: its method, its frames, and what the method remembers of each of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.array_files import ArrayKind
from salframe.framework.columns import read_columns, write_columns
from salframe.framework.config import Settings
from salframe.framework.errors import DataError
from salframe.framework.files import read_model
from salframe.localization.answers import RIGID_TOLERANCE
from salframe.panoramas.frames import FrameKind, MapFrame
from salframe.panoramas.geometry import is_rigid

METHOD, FRAMES, SCENES = "method.json", "frames", "scenes"
_NAME = ArrayKind("U", ())
_FRAME = {"id": _NAME, "place": _NAME, "kind": _NAME, "T_world_pano": ArrayKind("f", (3, 4))}


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


def write_frames(parts: Path, frames: Sequence[MapFrame]) -> None:
    """Write the frames of a map, but for their panoramas, to a folder with its parts."""
    rows = [
        {
            "id": np.array(frame.id),
            "place": np.array(frame.place),
            "kind": np.array(str(frame.kind)),
            "T_world_pano": frame.T_world_pano[:3],
        }
        for frame in frames
    ]
    write_columns(parts / FRAMES, rows)


def read_frames(parts: Path) -> list[MapFrame]:
    """The frames among the parts of a map that has a method. Raises DataError."""
    frames, rows = [], read_columns(parts / FRAMES, _FRAME)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for row, T_world_pano in zip(rows, poses, strict=True):
        T_world_pano[:3] = row["T_world_pano"]
        id, place, kind = (row[name].item() for name in ("id", "place", "kind"))
        if kind not in list(FrameKind) or not is_rigid(T_world_pano, RIGID_TOLERANCE):
            raise DataError(
                f"{parts / FRAMES}: {id} is a {kind!r} frame or its pose is no rigid motion: build it again"
            )
        frames.append(MapFrame(id, place, T_world_pano, FrameKind(kind)))
    return frames
