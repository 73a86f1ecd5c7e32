"""Rotate the arbitrary axes of a COLMAP model upright, and compute its scale in metres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import DataError

MIN_AGREEMENT = 0.5
"""Minimum length of the mean up direction of the pictures. The length is 1 if all directions are equal, and 0.67 for
the six faces of a cube."""
BIN_SHARE, MIN_RELATIVE_SUPPORT = 0.05, 0.3
"""Points form a level if their distances below the cameras differ by at most the fraction BIN_SHARE. The floor is the
lowest level whose density of points is at least MIN_RELATIVE_SUPPORT times the maximum density. The lowest level is
used so that a table is not mistaken for the floor."""
MIN_POINTS = 50
"""Minimum number of points below the cameras that are needed to detect the floor."""
MAX_SPREAD = 0.5
"""Maximum difference of the heights of the cameras (10 to 90 %), relative to their height above the floor."""


def up_direction(T_model_cameras: Sequence[np.ndarray]) -> np.ndarray:
    """Return the mean up direction of pictures in the world of the model, unit vector (3,).

    The up direction of a picture is its -y axis. Pictures of a rig that look up and down cancel out.

    Args:
        T_model_cameras: (4, 4) poses of the optical frames (x right, y down, z forward).

    Raises:
        DataError: The up directions of the pictures do not agree.
    """
    mean = -np.mean([pose[:3, 1] for pose in T_model_cameras], axis=0)
    length = float(np.linalg.norm(mean))
    if length < MIN_AGREEMENT:
        raise DataError(
            f"the pictures of the COLMAP model have different up directions (the mean of {len(T_model_cameras)} unit "
            f"vectors has the length {length:.2f}, expected {MIN_AGREEMENT:g} to 1): turn the pictures upright and "
            "reconstruct again"
        )
    return mean / length


def upright_rotation(up: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) that turns a unit vector (3,) to +z."""
    x, y, z = up
    if z < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])  # of the rotation axis up x z
    return np.eye(3) + cross + cross @ cross / (1 + z)


def floor_height(points_z: np.ndarray, cameras_z: np.ndarray) -> float:
    """Return the z of the floor: the lowest level with many points.

    Args:
        points_z: (N,) heights of the points of the model.
        cameras_z: (K,) heights of the cameras, in the same unit.

    Raises:
        DataError: There are too few points below the cameras, the points show no level, or the cameras are at very
            different heights.
    """
    camera_z = float(np.median(cameras_z))
    below = np.sort(camera_z - points_z[points_z < camera_z])
    if len(below) < MIN_POINTS:
        raise DataError(
            f"the COLMAP model has {len(below)} points below the cameras, expected at least {MIN_POINTS} to find the "
            "floor: pass --set scale=METRES_PER_UNIT instead of camera_height"
        )
    first, last = (np.searchsorted(below, below * factor) for factor in (1 - BIN_SHARE / 2, 1 + BIN_SHARE / 2))
    support = last - first
    density = support / below  # levels near the cameras are narrow
    is_dense = support >= max(5, 0.01 * len(below))
    is_level = is_dense & (density >= MIN_RELATIVE_SUPPORT * density[is_dense].max(initial=0))
    if not is_level.any():
        raise DataError(
            "the points of the COLMAP model contain no horizontal floor below the cameras: pass --set "
            "scale=METRES_PER_UNIT instead of camera_height"
        )
    lowest = int(np.flatnonzero(is_level)[-1])
    candidates = np.flatnonzero(is_level & (below >= below[lowest] * (1 - BIN_SHARE)))
    mode = int(candidates[np.argmax(support[candidates])])
    height = float(np.median(below[first[mode] : last[mode]]))
    spread = float(np.subtract(*np.percentile(cameras_z, [90, 10])))
    if spread > MAX_SPREAD * height:
        raise DataError(
            f"the heights of the cameras of the COLMAP model above the floor differ by {spread / height:.0%} of "
            f"their median, expected at most {MAX_SPREAD:.0%}: pass --set scale=METRES_PER_UNIT instead of "
            "camera_height"
        )
    return camera_z - height
