"""Reads the occupancy map of a robot: the YAML file and the image of the ROS package map_server (nav2_map_server)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ConfigDict, Field

from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.validation import Settings, validate
from salframe.topology.free_space import FreeSpace


class _MapFile(Settings):
    """Keys of the YAML file. Other keys are ignored."""

    model_config = ConfigDict(extra="ignore")
    image: str
    resolution: float = Field(gt=0, allow_inf_nan=False)
    origin: tuple[float, float, float]
    negate: bool = False
    occupied_thresh: float = Field(0.65, ge=0, le=1)
    free_thresh: float = Field(0.25, ge=0, le=1)
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def read_map_server(path: Path) -> FreeSpace:
    """Read the free space of an occupancy map. Its frame must be the world frame of the reference frames.

    Args:
        path: YAML file with the keys image, resolution, origin and optionally negate and free_thresh. The origin is the
            position of the lower left corner. The image is a PGM or PNG file.

    Raises:
        DataError: A file cannot be read, a value is invalid, the mode is raw, or the map is rotated.
    """
    from PIL import Image

    try:
        file = validate(_MapFile, read_yaml(path), f"{path}:")
    except ConfigError as error:
        raise DataError(str(error)) from None
    if file.origin[2] != 0:
        raise DataError(f"{path} has an origin with a yaw of {file.origin[2]:g} rad, expected 0: rotate the map")
    if file.mode == "raw":
        raise DataError(f"{path} has the mode raw, expected trinary or scale")
    image = path.parent / file.image
    try:
        grey = np.asarray(Image.open(image).convert("L"), np.float64) / 255
    except (OSError, ValueError) as error:
        raise DataError(f"cannot read {image}, the image of {path}: {error}") from None
    occupancy = grey if file.negate else 1 - grey
    left_m, bottom_m, _ = file.origin
    origin_m = left_m, bottom_m + len(grey) * file.resolution
    walkable = occupancy < file.free_thresh
    return FreeSpace(walkable, np.zeros_like(walkable), origin_m, file.resolution)
