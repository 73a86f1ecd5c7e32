"""The paths of agents as trajectories in the TUM format."""

from __future__ import annotations

import numpy as np

from salframe.evaluation.runs.records import Record
from salframe.evaluation.tasks.navigation.rows import EpisodeRow, Position
from salframe.framework.files.writing import write_text
from salframe.localization.trajectory import tum_lines
from salframe.panoramas.geometry import pose_2d

FOLDER = "trajectories"
"""Folder of the trajectories, in the folder of a method."""


def write_trajectories(record: Record[EpisodeRow]) -> None:
    """Write two trajectories for each episode of a method: EPISODE-true.tum and EPISODE-estimated.tum.

    The timestamp is the number of the panorama. The estimated trajectory has the poses that the agent estimated.
    Panoramas without an estimated pose are left out, and a comment in the file states their number.
    """
    folder = record.folder / FOLDER
    for row in record.rows:
        if row is None or row.path is None or row.believed is None:
            continue
        folder.mkdir(exist_ok=True)
        estimated = [(number, pose) for number, pose in enumerate(row.believed) if pose is not None]
        notes = [
            f"navigate: episode {row.episode} in {row.world}, goal {row.goal}",
            "timestamps: number of the panorama",
        ]
        missing = f"{len(row.believed) - len(estimated)} panoramas without an estimated pose are left out"
        write_text(folder / f"{row.episode}-true.tum", tum_lines(_timed(list(enumerate(row.path))), notes))
        write_text(folder / f"{row.episode}-estimated.tum", tum_lines(_timed(estimated), [*notes, missing]))


def _timed(poses: list[tuple[int, Position]]) -> list[tuple[float, np.ndarray]]:
    """Return times and poses (4, 4) of numbered positions x, y, z, yaw."""
    return [(float(number), pose_2d(x, y, yaw_rad, z)) for number, (x, y, z, yaw_rad) in poses]
