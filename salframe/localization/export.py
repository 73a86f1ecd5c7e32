"""Export the reference frames of a map as a table for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.files.writing import atomic_path
from salframe.localization.localizer import Description
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import MapParts, read_map
from salframe.panoramas.frames import ReferenceFrame


def export_scenes(directory: Path, path: Path) -> None:
    """Write the reference frames of a map to a Parquet file, one row per frame.

    The columns are the frame id, the place, the kind (scene or transition), T_world_pano (16 numbers, row by row), and
    one column of nested lists for each array of the description.

    Args:
        directory: The saved map.
        path: The Parquet file.

    Raises:
        DataError: As `open_map`.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    frames, scenes = read_map(directory, _read_scenes)
    columns: dict[str, Any] = {
        "frame": [frame.id for frame in frames],
        "place": [frame.place for frame in frames],
        "kind": [str(frame.kind) for frame in frames],
        "T_world_pano": [frame.T_world_pano.ravel() for frame in frames],
    }
    for name in dict.fromkeys(name for scene in scenes for name in scene):
        columns[name] = _nested([scene.get(name) for scene in scenes])
    with atomic_path(path) as temporary:
        pq.write_table(pa.table(columns), temporary)


def _read_scenes(parts: MapParts) -> tuple[Sequence[ReferenceFrame], list[Description]]:
    saved = LocalizationMap.read(parts, indexed=False)
    return saved.frames, saved.descriptions()


def _nested(arrays: Sequence[np.ndarray | None]):
    """Return a column of nested lists from arrays with the same type and number of dimensions; None becomes null."""
    import pyarrow as pa

    example = next(array for array in arrays if array is not None)
    kind = pa.string() if example.dtype.kind == "U" else pa.from_numpy_dtype(example.dtype)
    for _ in range(example.ndim):
        kind = pa.list_(kind)
    return pa.array([None if array is None else array.tolist() for array in arrays], kind)
