"""Choose the views of query sequences from the images of a moving camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.panoramas.geometry import pose_errors


@dataclass(frozen=True)
class ViewSpacing:
    """The spacing of the views of a sequence.

    A view is taken when the camera has moved by `distance_m` or turned by `turn_rad` since the last view.

    Attributes:
        num_views: Number of views of a sequence.
        period: Number of views from the end of one sequence to the end of the next, at least `num_views`.
        distance_m: Distance between two views in metres.
        turn_rad: Turn between two views in radians.
    """

    num_views: int
    period: int
    distance_m: float
    turn_rad: float

    def steps(self, poses: Sequence[np.ndarray]) -> list[int]:
        """Return the indices of the images that are views.

        Args:
            poses: (4, 4) poses of the images in temporal order.
        """
        steps: list[int] = []
        for number, pose in enumerate(poses):
            if not steps or self.is_view(pose, poses[steps[-1]]):
                steps.append(number)
        return steps

    def is_view(self, pose: np.ndarray, last: np.ndarray) -> bool:
        """Return whether an image at a pose (4, 4) is far enough from the last view."""
        distance_m, turn_rad = pose_errors(pose, last)
        return bool(distance_m >= self.distance_m or turn_rad >= self.turn_rad)


def choose_views(poses: Sequence[np.ndarray], spacing: ViewSpacing) -> list[list[int]]:
    """Return the indices of the images of each sequence, in order.

    First, the views are selected: images that are far enough from the preceding view. Then the views are divided into
    groups of `period`. The last `num_views` views of each group are a sequence.

    Args:
        poses: (4, 4) poses of the images in temporal order.
        spacing: Spacing of the views.
    """
    steps = spacing.steps(poses)
    ends = range(spacing.period, len(steps) + 1, spacing.period)
    return [steps[end - spacing.num_views : end] for end in ends]
