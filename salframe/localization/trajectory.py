"""Trajectories in the format of the TUM RGB-D benchmark, which evo and other programs read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

TUM_CONVENTIONS = (
    "timestamp tx ty tz qx qy qz qw; seconds, metres and unit quaternions; T_world_pano: camera with x ahead, y left, "
    "z up, in the world frame of the map, z up"
)
"""Columns, units, axes and quaternion order, stated in every file."""


def tum_lines(poses: Iterable[tuple[float, np.ndarray]], notes: Sequence[str] = ()) -> str:
    """Return a trajectory as lines `t_s x y z qx qy qz qw`, preceded by comments with the conventions and the notes.

    Args:
        poses: Times in seconds and poses T_world_pano (4, 4).
        notes: Comments, one line each.
    """
    from scipy.spatial.transform import Rotation

    lines = [f"# {note}" for note in (TUM_CONVENTIONS, *notes)]
    for t_s, pose in poses:
        numbers = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lines.append(" ".join([f"{t_s:.6f}", *(f"{number:.6f}" for number in numbers)]))
    return "\n".join(lines) + "\n"
