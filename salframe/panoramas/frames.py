"""Reference frames and queries, whose panoramas are loaded on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.panoramas.panorama import Panorama


class FrameKind(StrEnum):
    """Whether a reference frame shows one place (scene), or the doorway between two places (transition)."""

    SCENE = "scene"
    TRANSITION = "transition"


def _no_panorama() -> Panorama:
    raise DataError("a frame of a saved map has no panorama: the map stores only its description")


@dataclass(frozen=True, eq=False)
class ReferenceFrame:
    """A panorama that a map is made from.

    Attributes:
        id: Id of the frame.
        place: Name of the place.
        T_world_pano: (4, 4) float64 pose.
        kind: Whether the frame shows a scene or a transition.
        load: Returns the panorama. Frames of a saved map have no panorama; their `load` raises DataError.
        content: Cache key of the panorama, in addition to the id; "": the content_key of the dataset. Datasets that
            have the same panorama have the same key.

    Raises:
        DataError: The kind is not a FrameKind, or the pose has another shape.
    """

    id: str
    place: str
    T_world_pano: np.ndarray
    kind: FrameKind = FrameKind.SCENE
    load: Callable[[], Panorama] = _no_panorama
    content: str = ""

    def __post_init__(self) -> None:
        check_array(self, "T_world_pano", np.float64, 4, 4)
        try:
            object.__setattr__(self, "kind", FrameKind(self.kind))
        except ValueError:
            kinds = ", ".join(FrameKind)
            raise DataError(f"the frame {self.id} has the kind {self.kind!r}, expected one of {kinds}") from None


@dataclass(frozen=True, eq=False)
class QueryFrame:
    """A panorama to localize. Its pose and place are part of the truth of the dataset.

    Attributes:
        id: Id of the query.
        load: Returns the panorama.
        content: As in ReferenceFrame.
    """

    id: str
    load: Callable[[], Panorama]
    content: str = ""


@dataclass(frozen=True)
class Truth:
    """The truth of a query, for the evaluation only.

    Attributes:
        place: Name of the place.
        T_world_pano: (4, 4) pose; None where it is unknown.
        instances: Ids of the visible instances.
    """

    place: str
    T_world_pano: np.ndarray | None = None
    instances: tuple[int, ...] = ()


@dataclass(frozen=True)
class Fold:
    """The reference frames of one map, and the queries to localize in it."""

    id: str
    references: tuple[ReferenceFrame, ...]
    queries: tuple[QueryFrame, ...]
