"""Panoramas on demand: those that a map is made from, and those that it is asked about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.panoramas.panorama import Panorama


class FrameKind(StrEnum):
    """What a reference frame shows: a place of its own, or the doorway between two."""

    SCENE = "scene"
    TRANSITION = "transition"


def _no_panorama() -> Panorama:
    raise DataError("a frame of a saved map holds no panorama: only what its method remembers of it")


@dataclass(frozen=True, eq=False)
class ReferenceFrame:
    """A reference frame: its id, its place, where it stands, T_world_pano (4, 4) float64, and what it shows.

    `load` gives its panorama; frames of a saved map have none, and raise DataError. `content` is what caches know the
    panorama by beside the id, "" the data set's content_key: data sets that show the same give the same. Raises
    DataError on a kind that is none of FrameKind and on a pose of another shape.
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
            known = ", ".join(FrameKind)
            raise DataError(f"the frame {self.id} has the kind {self.kind!r}, expected one of {known}") from None


@dataclass(frozen=True, eq=False)
class QueryFrame:
    """A panorama to localize: its id and `load`, which gives it; `content` as in ReferenceFrame. Where it was taken is the
    data set's truth."""

    id: str
    load: Callable[[], Panorama]
    content: str = ""


@dataclass(frozen=True)
class Truth:
    """What only the evaluator sees of a query: pose (4, 4) or None, place, ids of the visible instances."""

    place: str
    T_world_pano: np.ndarray | None = None
    instances: tuple[int, ...] = ()


@dataclass(frozen=True)
class Fold:
    """One map and the queries asked of it."""

    id: str
    references: tuple[ReferenceFrame, ...]
    queries: tuple[QueryFrame, ...]
