"""The free floor of a map as files of map_server of ROS: a PGM image and a YAML file per storey."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation

from salframe.framework.errors import DataError
from salframe.framework.files.writing import atomic_path, write_text
from salframe.panoramas.floors import FloorMasks

FREE, OCCUPIED, UNKNOWN = 254, 0, 205
"""Grey values as written by map_saver. Occupancy is (255 - value) / 255, if negate is 0."""
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""Thresholds of occupancy as written by map_saver: above the first occupied, below the second free, else unknown."""


def write_map_server(floors: Sequence[FloorMasks], path: Path) -> tuple[Path, ...]:
    """Write floors as map_server of ROS 1 and nav2 reads them, in the mode trinary.

    Free floor is free, obstacles and the pixels along the border of the free floor are occupied, all else is unknown.
    A map with several storeys gets a pair of files each: NAME-1.yaml and NAME-1.pgm for the lowest one, and so on.

    Args:
        floors: The floors.
        path: The YAML file. The PGM file has the same name.

    Returns:
        The written files.

    Raises:
        DataError: There are no floors.
    """
    if not floors:
        raise DataError("the map has no floors, expected a map that was built from data with floor masks")
    written: list[Path] = []
    for number, floor in enumerate(sorted(floors, key=lambda floor: floor.z_m), 1):
        yaml = path if len(floors) == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
        image = yaml.with_suffix(".pgm")
        _write_pgm(image, _grey(floor))
        write_text(yaml, _description(floor, image.name))
        written += [yaml, image]
    return tuple(written)


def _grey(floor: FloorMasks) -> np.ndarray:
    """Return the image (rows, columns) uint8 of a floor. Row 0 is at the maximum y."""
    grey = np.full(floor.free.shape, UNKNOWN, np.uint8)
    grey[binary_dilation(floor.free, np.ones((3, 3), bool))] = OCCUPIED
    grey[floor.free] = FREE
    grey[floor.obstacle] = OCCUPIED
    return grey


def _write_pgm(path: Path, grey: np.ndarray) -> None:
    rows, columns = grey.shape
    comment = "# row 0 is at the maximum y; 254 free, 0 occupied, 205 unknown"
    with atomic_path(path) as temporary:
        Path(temporary).write_bytes(f"P5\n{comment}\n{columns} {rows}\n255\n".encode() + grey.tobytes())


def _description(floor: FloorMasks, image: str) -> str:
    """Return the YAML of a floor. `origin` is the pose of the lower left pixel: x and y in metres, yaw in radians."""
    left_m, top_m = floor.origin_m
    bottom_m = top_m - len(floor.free) * floor.resolution_m
    lines = [
        "# Free floor for map_server (ROS 1 and nav2). World frame of the map: x, y in metres, z up.",
        "# origin: x_m, y_m, yaw_rad of the lower left corner; resolution: metres per pixel.",
        f"# Height of the floor: z = {floor.z_m:g} m.",
        f"image: {_quoted(image)}",
        "mode: trinary",
        f"resolution: {float(floor.resolution_m):.9g}",
        f"origin: [{left_m:.9g}, {bottom_m:.9g}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_THRESH}",
        f"free_thresh: {FREE_THRESH}",
    ]
    return "\n".join(lines) + "\n"


def _quoted(name: str) -> str:
    """Return a file name as a YAML string in single quotes."""
    return "'" + name.replace("'", "''") + "'"
