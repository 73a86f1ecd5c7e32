"""Several views of one query: their panoramas, the motion between them, and the errors of that motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from pydantic import Field

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.framework.validation import Settings
from salframe.panoramas.geometry import is_rigid, translation
from salframe.panoramas.panorama import Panorama

RIGID_TOLERANCE = 1e-3
"""Tolerance of the check that a motion is rigid."""


class OdometryNoise(Settings):
    """Errors of the motion that odometry measures between the views of a query."""

    drift_share: float = Field(
        0.02,
        ge=0,
        le=1,
        description="standard deviation of the position error of odometry along x and along y, divided by the "
        "travelled distance (0.02: 2 cm per metre)",
    )
    heading_drift_deg: float = Field(
        1.0,
        ge=0,
        le=180,
        description="standard deviation (degrees) of the heading error of odometry between two successive views",
    )


@dataclass(frozen=True, eq=False)
class View:
    """One of several views of a query, in the order in which they were taken.

    Attributes:
        panorama: The panorama. A narrow camera shows a part of the sphere, `Panorama.valid`.
        T_last_view: (4, 4) rigid motion that maps coordinates of this view to those of the last view; the identity for
            the last view. None if the motion is unknown.
        position_m: (3,) float64 position of the panorama's centre in the base frame of the robot, in metres. The axes
            of the panorama are parallel to the base frame. T_last_view and the pose of the answer refer to the base
            frame. The default is the origin.

    Raises:
        DataError: The panorama is no Panorama, the motion is not rigid, or the position is not finite.
    """

    panorama: Panorama
    T_last_view: np.ndarray | None = None
    position_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        if not isinstance(self.panorama, Panorama):
            raise DataError(f"the field View.panorama has the type {type(self.panorama).__name__}, expected a Panorama")
        if not np.isfinite(check_array(self, "position_m", np.float64, 3)).all():
            raise DataError(f"the field View.position_m is {self.position_m.tolist()}, expected finite metres")
        if self.T_last_view is None:
            return
        if not is_rigid(self.T_last_view, RIGID_TOLERANCE):
            received = " ".join(str(np.asarray(self.T_last_view).tolist()).split())[:200]
            raise DataError(
                f"the field View.T_last_view of {self.panorama.id} is {received}, expected a rigid motion (4, 4) "
                "from this view to the last view, or None if the motion is unknown"
            )
        object.__setattr__(self, "T_last_view", np.array(self.T_last_view, np.float64))


def motions(views: Sequence[View]) -> np.ndarray | None:
    """Return the motions from the coordinates of each panorama to those of the last panorama, (V, 4, 4) float64.

    The result is None if a motion is unknown. The motion of the last view may be None, because it is the identity.

    Raises:
        DataError: There are no views, one of them is not a View, or the motion of the last view is not the identity.
    """
    if not views:
        raise DataError("received no views, expected at least one View(panorama, T_last_view)")
    for number, view in enumerate(views):
        if not isinstance(view, View):
            raise DataError(
                f"view number {number} (from 0) has the type {type(view).__name__}, expected View(panorama, "
                "T_last_view)"
            )
    last = views[-1].T_last_view
    if last is not None and not np.allclose(last, np.eye(4), atol=RIGID_TOLERANCE):
        raise DataError(
            f"T_last_view of the last view has the translation {last[:3, 3].tolist()} m and the rotation "
            f"{last[:3, :3].tolist()}, expected the identity, because T_last_view maps to the last view"
        )
    T_panorama_last = translation(-views[-1].position_m)
    motions = [
        T_panorama_last @ view.T_last_view @ translation(view.position_m)
        for view in views[:-1]
        if view.T_last_view is not None
    ]
    return np.stack([*motions, np.eye(4)]) if len(motions) == len(views) - 1 else None


def motion_variance_m2(T_last_view: np.ndarray, noise: OdometryNoise, range_m: np.ndarray, view: int) -> np.ndarray:
    """Return the variance of positions that are moved from a view to the last view, along each axis, in m^2.

    It is (drift_share x path)^2 + (heading drift x sqrt(steps) x range)^2. `path` is the distance travelled from the
    view to the last view. `steps` is the number of views after the view.

    Args:
        T_last_view: (V, 4, 4) motions of the views.
        noise: The errors of the motion.
        range_m: (N,) distances of the positions from the view in metres.
        view: Index of the view.

    Returns:
        (N,) float64.
    """
    path_m = np.linalg.norm(np.diff(T_last_view[view:, :3, 3], axis=0), axis=1).sum()
    heading_rad = np.radians(noise.heading_drift_deg) * np.sqrt(len(T_last_view) - 1 - view)
    return np.asarray((noise.drift_share * path_m) ** 2 + (heading_rad * range_m) ** 2)
