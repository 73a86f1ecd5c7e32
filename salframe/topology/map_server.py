"""Occupancy maps of ROS (map_server, nav2_map_server): a YAML file and a PGM image per storey, read and written."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ConfigDict, Field
from scipy.ndimage import binary_dilation

from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files.bounded import read_bytes
from salframe.framework.files.writing import atomic_path, write_text
from salframe.framework.validation import Settings, validate
from salframe.panoramas.floors import FloorMasks
from salframe.topology.free_space import FreeSpace

FREE, OCCUPIED, UNKNOWN = 254, 0, 205
"""Grey values as written by map_saver. Occupancy is (255 - value) / 255, if negate is 0."""
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""Thresholds of occupancy as written by map_saver. A pixel is occupied above the first threshold, free below the second
threshold, and otherwise unknown."""


class _MapFile(Settings):
    """Keys of the YAML file of an occupancy map. Other keys are ignored."""

    model_config = ConfigDict(extra="ignore")
    image: str
    resolution: float = Field(gt=0, allow_inf_nan=False)
    origin: tuple[float, float, float]
    negate: bool = False
    occupied_thresh: float = Field(0.65, ge=0, le=1)
    free_thresh: float = Field(0.25, ge=0, le=1)
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def read_map_server(path: Path) -> FreeSpace:
    """Read the free space of an occupancy map. The frame of the occupancy map must be the world frame of the reference
    frames.

    Args:
        path: YAML file with the keys image, resolution, origin and optionally negate and free_thresh. The origin is the
            position of the lower left corner. The image is a PGM or PNG file.

    Raises:
        DataError: A file cannot be read, a value is invalid, the mode is raw, or the map is rotated.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        file = validate(_MapFile, read_yaml(path), f"{path}:")
    except ConfigError as error:
        raise DataError(str(error)) from None
    if file.origin[2] != 0:
        raise DataError(f"{path} has an origin with a yaw of {file.origin[2]:g} rad, expected 0: rotate the map")
    if file.mode == "raw":
        raise DataError(f"{path} has the mode raw, expected trinary or scale: save it in one of these modes")
    image = path.parent / file.image
    try:
        grey = np.asarray(Image.open(BytesIO(read_bytes(image))).convert("L"), np.float64) / 255
    except UnidentifiedImageError:  # its message names an object in memory
        raise DataError(f"{image}, the image of {path}, is not an image, expected a file such as PGM or PNG") from None
    except (OSError, ValueError) as error:
        raise DataError(f"cannot read {image}, the image of {path}: {error}") from None
    occupancy = grey if file.negate else 1 - grey
    left_m, bottom_m, _ = file.origin
    origin_m = left_m, bottom_m + len(grey) * file.resolution
    walkable = occupancy < file.free_thresh
    return FreeSpace(walkable, np.zeros_like(walkable), origin_m, file.resolution)


def write_map_server(floors: Sequence[FloorMasks], path: Path) -> tuple[Path, ...]:
    """Write floors as occupancy maps for map_server of ROS 1 and nav2, in the mode trinary.

    Free floor is free. Obstacles and the pixels along the border of the free floor are occupied. All other pixels are
    unknown. If there are several storeys, each gets a pair of files: NAME-1.yaml and NAME-1.pgm for the lowest storey,
    and so on.

    Args:
        floors: The floors.
        path: The YAML file. The PGM file has the same name.

    Returns:
        The written files.

    Raises:
        DataError: There are no floors.
    """
    if not floors:
        raise DataError(
            f"cannot write {path}: the map has no floors, expected a map that was built from data with floor masks or "
            "range"
        )
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
