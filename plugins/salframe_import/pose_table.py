"""The table of poses of pictures and cubemaps: poses.csv."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field, PositiveFloat

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files.reading import read_csv_numbers, read_csv_texts
from salframe.panoramas.importer import PlaceSource
from salframe.panoramas.pose_conventions import PoseConvention, convert_pose

POSITION, ANGLES, QUATERNION = ("x_m", "y_m", "z_m"), ("roll_deg", "pitch_deg"), ("qx", "qy", "qz", "qw")
LEVEL_CONVENTIONS: tuple[PoseConvention, ...] = ("ros", "compass", "image-plan")
"""Pose conventions in which yaw_deg can give the orientation, because z is up and x is forward."""
MAX_NORM_ERROR = 0.01
"""Maximum difference between the length of a quaternion and 1."""


class PoseSettings(ComponentConfig):
    """Settings of importers that read the poses from a CSV file."""

    poses: str = Field(
        "poses.csv", min_length=1, description="name of the CSV file with the poses, in the imported folder"
    )
    pose_convention: PoseConvention = Field(
        "ros",
        description="convention of the poses: the axes of world and camera, and the direction of the transformation; "
        "`salframe docs folder-format` explains each value",
    )
    position_unit_m: PositiveFloat = Field(
        1.0, description="length (m) of one unit of the positions (0.001: the positions are in millimetres)"
    )


@dataclass(frozen=True, eq=False)
class PoseRow:
    """A row of the table.

    Attributes:
        T_world_pano: (4, 4) pose of the panorama.
        places: Mapping from the source of a place name to the name; empty if the table has no place.
        t_s: Time in seconds; None if the table has no time.
    """

    T_world_pano: np.ndarray
    places: dict[PlaceSource, str]
    t_s: float | None


def read_pose_table(path: Path, config: PoseSettings) -> dict[str, PoseRow]:
    """Return the rows of a table of poses by the name in the column `picture`.

    The orientation is given by yaw_deg, and optionally pitch_deg and roll_deg, or by the quaternion qx, qy, qz, qw.

    Raises:
        DataError: A column is missing, a value is invalid, or a picture has two rows.
        ConfigError: The setting `pose_convention` does not apply to the columns of the table.
    """
    texts = read_csv_texts(path, ("picture", *POSITION), ("place", "yaw_deg", *QUATERNION))
    has_quaternion = set(QUATERNION) <= texts.keys()
    if has_quaternion == ("yaw_deg" in texts):
        received = "both" if has_quaternion else "neither"
        raise DataError(
            f"{path} has {received} the column yaw_deg {'and' if has_quaternion else 'nor'} the columns "
            f"{','.join(QUATERNION)}, expected one of the two"
        )
    if not has_quaternion and config.pose_convention not in LEVEL_CONVENTIONS:
        raise ConfigError(
            f"pose_convention is {config.pose_convention!r}, expected {' or '.join(LEVEL_CONVENTIONS)}, because "
            f"{path} has the column yaw_deg: set pose_convention, or use the columns {','.join(QUATERNION)}"
        )
    orientation = QUATERNION if has_quaternion else ("yaw_deg",)
    numbers = read_csv_numbers(path, (*POSITION, *orientation), (*ANGLES, "t_s"))
    names = [Path(text.strip()).as_posix() for text in texts["picture"]]
    places = [text.strip() for text in texts.get("place", [""] * len(names))]
    rows: dict[str, PoseRow] = {}
    for name, place, row in zip(names, places, numbers, strict=True):
        if name in rows:
            raise DataError(f"{path} has two rows for the picture {name}, expected one")
        pose = np.eye(4)
        pose[:3, 3] = row[:3]
        pose[:3, :3] = _rotation(row[3:-1], f"{path}: the quaternion of {name}")
        converted = convert_pose(pose, config.pose_convention, config.position_unit_m)
        t_s = float(row[-1]) if np.isfinite(row[-1]) else None
        rows[name] = PoseRow(converted, {PlaceSource.COLUMN: place} if place else {}, t_s)
    return rows


def _rotation(values: np.ndarray, where: str) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion qx, qy, qz, qw, or of yaw, roll and pitch in degrees."""
    from scipy.spatial.transform import Rotation

    if len(values) < 6:  # yaw, roll, pitch; NaN where the table has no such column
        yaw, roll, pitch = np.nan_to_num(values)
        matrix: np.ndarray = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()
        return matrix
    return quaternion_matrix(values[:4], where)


def quaternion_matrix(xyzw: np.ndarray, where: str) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion qx, qy, qz, qw. Raises DataError if its length is not 1."""
    from scipy.spatial.transform import Rotation

    length = float(np.linalg.norm(xyzw))
    if not abs(length - 1) <= MAX_NORM_ERROR:
        raise DataError(f"{where} has the length {length:.3g}, expected 1: check the columns and their order")
    matrix: np.ndarray = Rotation.from_quat(xyzw).as_matrix()
    return matrix
