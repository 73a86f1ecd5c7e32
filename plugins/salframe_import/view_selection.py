"""Choose the views of query sequences from the images of a moving camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.panoramas.geometry import pose_errors


@dataclass(frozen=True)
class ViewSpacing:
    """When the views of a sequence are taken.

    Attributes:
        num_views: Number of views of a sequence.
        period: A sequence begins at every such view; the views between sequences are not part of one.
        distance_m: Distance between two views in metres.
        turn_rad: Turn between two views in radians. A view is taken after either.
    """

    num_views: int
    period: int
    distance_m: float
    turn_rad: float


def choose_views(poses: Sequence[np.ndarray], spacing: ViewSpacing) -> list[list[int]]:
    """Return the images of each sequence, in order.

    The images that are far enough from the one before are numbered; of every `period` of them, the last `num_views` are
    a sequence.

    Args:
        poses: (4, 4) poses of the images in the order of time.
        spacing: When views are taken.
    """
    steps: list[int] = []
    for number, pose in enumerate(poses):
        if steps:
            distance_m, turn_rad = pose_errors(pose, poses[steps[-1]])
            if distance_m < spacing.distance_m and turn_rad < spacing.turn_rad:
                continue
        steps.append(number)
    ends = range(spacing.period, len(steps) + 1, spacing.period)
    return [steps[end - spacing.num_views : end] for end in ends]
