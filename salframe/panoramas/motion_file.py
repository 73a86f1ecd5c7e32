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


TILT_COLUMNS = ("roll_deg", "pitch_deg")
"""Optional columns of a motion file: angles of an IMU in degrees, about the forward and the left axis of the camera, as
in ROS. The camera is turned by the heading, then the pitch, then the roll."""


def read_motion(path: Path, num_views: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the motion between views.

    Args:
        path: CSV file with a header and one row for each view, in the order of the views. Other columns are ignored.
        num_views: Number of views V.

    Returns:
        The motions that map coordinates of views to those of the last view, (V, 4, 4) float64; and the up direction in
        the coordinates of each view, (V, 3) float64, None if the file has no roll and pitch.

    Raises:
        DataError: The file cannot be read, a column is missing, a value is not a finite number, the number of rows
            differs from the number of views, or the times do not increase.
    """
    from scipy.spatial.transform import Rotation

    values = read_csv_numbers(path, COLUMNS, TILT_COLUMNS)
    if len(values) != num_views:
        raise DataError(f"{path} has {len(values)} rows for {num_views} views, expected one row for each view")
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if len(late):
        before, after = values[late[0] : late[0] + 2, 0]
        raise DataError(
            f"{path}: t_s goes from {before:g} to {after:g} in row {late[0] + 2}, expected increasing times: sort the "
            "rows and the views by time"
        )
    has_tilt = np.isfinite(values[:, 5:]).all(0)
    if has_tilt.any() and not has_tilt.all():
        raise DataError(f"{path} has only one of the columns roll_deg and pitch_deg, expected both or neither")
    angles_deg = np.nan_to_num(values[:, [4, 6, 5]])  # heading, pitch, roll
    poses = np.tile(np.eye(4), (num_views, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("ZYX", angles_deg, degrees=True).as_matrix()
    poses[:, :3, 3] = values[:, 1:4]
    if not has_tilt.any():
        poses[:, :3, :3] = [pose_2d(0, 0, math.radians(yaw))[:3, :3] for yaw in values[:, 4].tolist()]
    T_last_view = np.stack([*(invert_pose(poses[-1]) @ poses[:-1]), np.eye(4)])
    return T_last_view, poses[:, 2, :3] if has_tilt.all() else None
