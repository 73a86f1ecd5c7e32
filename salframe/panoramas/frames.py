"""Reference frames and queries, whose panoramas are loaded on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.panoramas.geometry import is_rigid
from salframe.panoramas.panorama import Panorama


class FrameKind(StrEnum):
    """Whether a reference frame shows one place (scene), or the doorway between two places (transition)."""

    SCENE = "scene"
    TRANSITION = "transition"


POSE_TOLERANCE = 1e-3
"""Tolerance of the check that a pose is a rigid motion, as in the manifest of a folder."""


def check_pose(owner: object, where: str) -> None:
    """Check the field `T_world_pano` and replace it by a read-only (4, 4) float64 array.

    Raises:
        DataError: The pose is not a rigid motion: it has another shape, numbers that are not finite, a scale or a
            reflection.
    """
    pose = check_array(owner, "T_world_pano", np.float64, 4, 4)
    if not is_rigid(pose, POSE_TOLERANCE):
        raise DataError(
            f"{where} has the pose {pose.tolist()}, expected a rigid motion: a rotation without scale or reflection, a "
            "translation in metres, and the last row 0 0 0 1"
        )


def _no_panorama() -> Panorama:
    raise DataError(
        "a frame of a saved map has no panorama, because a map stores only descriptions (features): load the frame "
        "from the dataset of the map"
    )


@dataclass(frozen=True, eq=False)
class ReferenceFrame:
    """A panorama that a map is made from.

    Attributes:
        id: Id of the frame.
        place: Name of the place.
        T_world_pano: (4, 4) float64 pose.
        kind: Whether the frame shows a scene or a transition.
        load: Returns the panorama. Frames of a saved map have no panorama; their `load` raises DataError.
        content: Cache key of the panorama, in addition to the id. "" stands for the content_key of the dataset.
            Datasets that share a panorama use the same key for it.

    Raises:
        DataError: The kind is not a FrameKind, or the pose is not a rigid motion.
    """

    id: str
    place: str
    T_world_pano: np.ndarray
    kind: FrameKind = FrameKind.SCENE
    load: Callable[[], Panorama] = _no_panorama
    content: str = ""

    def __post_init__(self) -> None:
        check_pose(self, f"the frame {self.id}")
        try:
            object.__setattr__(self, "kind", FrameKind(self.kind))
        except ValueError:
            kinds = ", ".join(FrameKind)
            raise DataError(f"the frame {self.id} has the kind {self.kind!r}, expected one of {kinds}") from None


@dataclass(frozen=True, eq=False)
class QueryFrame:
    """A panorama to localize, or the last of several views. The dataset's `truth` has its pose and place.

    Attributes:
        id: Id of the query.
        load: Returns the panorama.
        content: As in ReferenceFrame.
        earlier: Views of the query that were taken before this panorama, in the order of time.
        T_last_view: (V, 4, 4) float64 rigid motions from the coordinates of each view to those of this panorama, for
            the earlier views and this panorama itself. None if they are unknown, or if there are no earlier views.

    Raises:
        DataError: A motion is not rigid, or the number of motions differs from the number of views.
    """

    id: str
    load: Callable[[], Panorama]
    content: str = ""
    earlier: tuple[QueryFrame, ...] = ()
    T_last_view: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.T_last_view is None:
            return
        motions = check_array(self, "T_last_view", np.float64, len(self.earlier) + 1, 4, 4)
        for number, motion in enumerate(motions):
            if not is_rigid(motion, POSE_TOLERANCE):
                raise DataError(
                    f"the query {self.id} has T_last_view[{number}] = {motion.tolist()}, expected a rigid motion: a "
                    "rotation without scale or reflection, a translation in metres, and the last row 0 0 0 1"
                )

    @property
    def views(self) -> tuple[QueryFrame, ...]:
        """All views of the query, in the order in which they were taken. The last one is this frame without the
        earlier views."""
        return (*self.earlier, replace(self, earlier=(), T_last_view=None))


@dataclass(frozen=True)
class Truth:
    """The truth of a query, for the evaluation only.

    Attributes:
        place: Name of the place.
        T_world_pano: (4, 4) pose, a rigid motion; None if it is unknown.
        instances: Ids of the visible instances.
    """

    place: str
    T_world_pano: np.ndarray | None = None
    instances: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.T_world_pano is not None:
            check_pose(self, f"the true answer of a query in the place {self.place}")


@dataclass(frozen=True)
class Fold:
    """The reference frames of one map, and the queries to localize in it."""

    id: str
    references: tuple[ReferenceFrame, ...]
    queries: tuple[QueryFrame, ...]
