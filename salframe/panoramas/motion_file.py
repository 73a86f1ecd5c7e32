"""Read the motion between the views of a query from a CSV file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_csv_numbers
from salframe.panoramas.geometry import invert_pose, pose_2d

COLUMNS = ("t_s", "x_m", "y_m", "z_m", "yaw_deg")
"""Columns of a motion file: time in seconds, position in metres and heading in degrees, in any fixed frame, z up."""


def read_motion(path: Path, num_views: int) -> np.ndarray:
    """Return the motions that map coordinates of views to those of the last view, (V, 4, 4) float64.

    Args:
        path: CSV file with a header and one row for each view, in the order of the views. Other columns are ignored.
        num_views: Number of views V.

    Raises:
        DataError: The file cannot be read, a column is missing, a value is not a finite number, the number of rows
            differs from the number of views, or the times do not increase.
    """
    values = read_csv_numbers(path, COLUMNS)
    if len(values) != num_views:
        raise DataError(f"{path} has {len(values)} rows for {num_views} views, expected one row for each view")
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if len(late):
        before, after = values[late[0] : late[0] + 2, 0]
        raise DataError(
            f"{path}: t_s is {after:g} in row {late[0] + 2} after {before:g}, expected increasing times: sort the rows "
            "and the views by time"
        )
    poses = [pose_2d(x, y, math.radians(yaw), z) for _, x, y, z, yaw in values.tolist()]
    T_last_world = invert_pose(poses[-1])
    return np.stack([*(T_last_world @ pose for pose in poses[:-1]), np.eye(4)])
