"""Sequences in the folder format: the views of a query in the order of time, and their motion by odometry."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_csv_numbers
from salframe.panoramas.geometry import invert_pose, pose_2d
from salframe.panoramas.motion_file import COLUMNS

MAX_GAP_S = 1.0
"""Maximum time in seconds between two odometry rows for interpolating a pose between them, and maximum time between a
view and the first or last row."""


class Odometry:
    """The poses of a camera over time, in any fixed frame with z up.

    Rows may be in any order. Between rows that are at most MAX_GAP_S apart, poses are interpolated: positions linearly,
    headings along the shorter arc.
    """

    def __init__(self, t_s: np.ndarray, position_m: np.ndarray, yaw_rad: np.ndarray) -> None:
        """Create the odometry from rows with increasing times.

        Args:
            t_s: (N,) times in seconds.
            position_m: (N, 3) positions in metres.
            yaw_rad: (N,) headings in radians.
        """
        self._t_s, self._position_m, self._yaw_rad = t_s, position_m, np.unwrap(yaw_rad)

    @classmethod
    def read(cls, path: Path) -> Odometry:
        """Read a CSV file with the columns t_s, x_m, y_m, z_m and yaw_deg.

        Raises:
            DataError: The file cannot be read, has no row, or has two different poses at one time.
        """
        values = read_csv_numbers(path, COLUMNS)
        if not len(values):
            raise DataError(f"{path} has no row, expected rows with {', '.join(COLUMNS)}: the camera pose over time")
        return cls.of_rows(values, str(path))

    @classmethod
    def of_rows(cls, rows: np.ndarray, where: str) -> Odometry:
        """Return the odometry with the poses in some rows.

        Args:
            rows: (N, 5) t_s, x_m, y_m, z_m, yaw_deg, in any order, at least one row.
            where: Name of the source of the rows, for errors.

        Raises:
            DataError: Two different poses have the same time.
        """
        values = np.unique(rows, axis=0)  # sorts by time
        repeated = np.flatnonzero(np.diff(values[:, 0]) == 0)
        if len(repeated):
            raise DataError(
                f"{where} has two different poses at t_s = {values[repeated[0], 0]:g}, expected one pose for each time"
            )
        return cls(values[:, 0], values[:, 1:4], np.radians(values[:, 4]))

    def pose(self, t_s: float) -> np.ndarray | None:
        """Return the pose (4, 4) at a time; None if no row is near enough."""
        after = int(np.searchsorted(self._t_s, t_s))
        before = max(after - 1, 0)
        after = min(after, len(self._t_s) - 1)
        first_s, last_s = self._t_s[before], self._t_s[after]
        if t_s in (first_s, last_s):
            before = after = before if t_s == first_s else after
        elif before == after:
            if abs(t_s - first_s) > MAX_GAP_S:
                return None
        elif last_s - first_s > MAX_GAP_S:
            return None
        share = 0.0 if before == after else (t_s - first_s) / (last_s - first_s)
        position = (1 - share) * self._position_m[before] + share * self._position_m[after]
        yaw_rad = (1 - share) * self._yaw_rad[before] + share * self._yaw_rad[after]
        return pose_2d(position[0], position[1], yaw_rad, position[2])

    def motions(self, t_s: Sequence[float]) -> np.ndarray | None:
        """Return the motions from the coordinates of views to the coordinates of the last view, (V, 4, 4) float64.

        `t_s` are the times of the views. The result is None if the pose at one of these times is unknown.
        """
        poses = [pose for time in t_s if (pose := self.pose(time)) is not None]
        if len(poses) < len(t_s):
            return None
        T_last_world = invert_pose(poses[-1])
        return np.stack([*(T_last_world @ pose for pose in poses[:-1]), np.eye(4)])
