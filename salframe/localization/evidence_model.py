"""The role `evidence`: numbers that support places of the map as the place of a query."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from salframe.framework.component import Role
from salframe.framework.files.columns import Columns
from salframe.localization.localizer import Description
from salframe.panoramas.panorama import Panorama


@dataclass(frozen=True)
class EvidenceColumn:
    """A named column of evidence: one number for each hypothesis, a larger number supports it more.

    Attributes:
        name: Lower-case letters, digits and underscores.
        description: Meaning of the numbers, with their unit.
        weight: Weight of the column in the score of a place, unless it is set or fitted (`salframe fit`); None: it must
            be.
    """

    name: str
    description: str
    weight: float | None = None


@dataclass(frozen=True, eq=False)
class PlaceFrames:
    """K places of a map with P distinct names, and their scene frames. Several places may have the same name.

    Attributes:
        names: The distinct names.
        name: (K,) position in `names` of each place's name.
        frame: (F,) numbers in the map of the scene frames, one place after the other; each place has at least one.
        start: (K + 1,) position in `frame` of each place's first frame, and F.
    """

    names: Sequence[str]
    name: np.ndarray
    frame: np.ndarray
    start: np.ndarray

    def __len__(self) -> int:
        return len(self.name)

    @cached_property
    def place(self) -> np.ndarray:
        """(F,) index of the place of each frame."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    @cached_property
    def padded(self) -> np.ndarray:
        """(K, maximum number of frames of a place): the frames of each place; the last one is repeated."""
        count = np.diff(self.start)
        return self.frame[self.start[:-1, None] + np.minimum(np.arange(count.max()), count[:, None] - 1)]

    def max_of_frames(self, values: np.ndarray) -> np.ndarray:
        """Return the maximum (K,) over the scene frames of each place.

        Args:
            values: (S,) one number for each of the S reference frames of the map.
        """
        return np.maximum.reduceat(values[self.frame], self.start[:-1])  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class PlaceHypotheses:
    """H hypotheses of the place of a query. The first C also have a pose.

    Attributes:
        place: (H,) int64 index of the place in PlaceFrames.
        xy_m: (C, 2) float64 position of the query in the world, metres.
        yaw_rad: (C,) float64 heading of the query in the world.
        scale: (C,) float64 factor from the query's ranges to true ranges.
        likelihood: (H,) float64 log likelihood ratio (nats) of the query's objects, by the localizer's search of poses.
    """

    place: np.ndarray
    xy_m: np.ndarray
    yaw_rad: np.ndarray
    scale: np.ndarray
    likelihood: np.ndarray

    def __len__(self) -> int:
        return len(self.place)


class EvidenceModel(Role):
    """Computes numbers (columns of evidence) that measure how well a query fits each candidate place of a map.

    A component sets `columns` and implements `score`. A component that stores arrays of each panorama also sets
    `arrays` and implements `describe` and `index`. All other methods have a default. If a panorama lacks the parts that
    `describe` reads, `describe` returns no arrays, and the columns of such a query are 0.
    """

    role = "evidence"
    columns: ClassVar[tuple[EvidenceColumn, ...]]
    """The columns that `score` returns."""
    arrays: ClassVar[tuple[str, ...]] = ()
    """Names of all arrays that `describe` may return."""
    uses: ClassVar[frozenset[str]] = frozenset()
    """Parts of a panorama that `describe` reads if they are present, of "rgb", "range" and "annotations"."""
    uses_pose: ClassVar[bool] = False
    """Whether the columns depend on the pose of a hypothesis. Only such evidence compares poses in one place."""
    column_step: ClassVar[int | None] = 1
    """Turning the panorama by a multiple of this number of pixel columns changes no evidence; None: every turn may."""

    def describe(self, panorama: Panorama, description: Description) -> Description:
        """Return the arrays to add to the description of a panorama, of those named in `arrays`.

        Args:
            panorama: The panorama.
            description: Arrays of the localizer itself, such as those of the saliency graph.
        """
        return {}

    def join(self, descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
        """Return the arrays of one description of several views of a query. By default, those of the last view.

        Args:
            descriptions: The descriptions of V views, in the order in which they were taken.
            T_last_view: (V, 4, 4) rigid motions that map coordinates of the views to those of the last view.
        """
        return self.arrays_of(descriptions[-1])

    def pack(self, description: Description) -> Description:
        """Return the arrays that a map stores. By default, these are the arrays of `describe`."""
        return self.arrays_of(description)

    def unpack(self, packed: Description) -> Description:
        """Return the arrays that were packed, up to the rounding of `pack`."""
        return self.arrays_of(packed)

    def index(self, descriptions: Sequence[Description], places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        """Prepare the scoring of hypotheses in a map with S reference frames. By default, nothing is prepared.

        Args:
            descriptions: The arrays of `describe` of each reference frame; empty if it returned none.
            places: The places of the map.
            T_world_pano: (S, 3, 4) poses of the frames.
        """

    def open_index(self, packed: Columns, places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        """Prepare the scoring in a map that was opened. The scores must be the same as after `index`.

        By default, each row is unpacked and indexed. Override it to be fast on large maps.

        Args:
            packed: Packed descriptions of the reference frames, mapped into memory.
            places: As in `index`.
            T_world_pano: As in `index`.
        """
        self.index([self.unpack(row) for row in packed] if self.arrays else [{}] * len(packed), places, T_world_pano)

    @abstractmethod
    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        """Return the columns by name, (H,) float64 and finite each. Must not change its input.

        Args:
            description: The description of the query, by localizer and evidence.
            hypotheses: The hypotheses of its place.
        """

    def arrays_of(self, description: Description) -> Description:
        """Return the arrays of a description that are named in `arrays`."""
        return {name: description[name] for name in self.arrays if name in description}
