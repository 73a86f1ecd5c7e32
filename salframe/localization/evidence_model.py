"""The role `evidence`: computes numbers that support places of the map as the place of a query."""

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
    """A named column of evidence: one number for each hypothesis. A larger number supports the hypothesis more.

    Attributes:
        name: Name of the column: lower-case letters, digits and underscores.
        description: Meaning of the numbers, with their unit.
        weight: Default weight of the column in the score of a place. None: there is no default; set the weight, or fit
            it with `salframe fit`.
        in_posterior: Whether the posterior uses the value of the first place, besides the differences between the
            scores of places. True for a value that means something by itself, such as a log likelihood ratio.
    """

    name: str
    description: str
    weight: float | None = None
    in_posterior: bool = False


@dataclass(frozen=True, eq=False)
class PlaceFrames:
    """K places of a map with P distinct names, and their scene frames (reference frames in rooms). Several places may
    have the same name.

    Attributes:
        names: The P distinct names.
        name: (K,) index in `names` of the name of each place.
        frame: (F,) indices in the map of the scene frames, place by place. Each place has at least one frame.
        start: (K + 1,) index in `frame` of the first frame of each place, then F.
    """

    names: Sequence[str]
    name: np.ndarray
    frame: np.ndarray
    start: np.ndarray

    def __len__(self) -> int:
        return len(self.name)

    @cached_property
    def place(self) -> np.ndarray:
        """(F,) index of the place of each scene frame (reference frame in a room)."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    @cached_property
    def padded(self) -> np.ndarray:
        """For each of the K places, the indices of its scene frames among the reference frames, (K, maximum number of
        scene frames of a place). The last frame of a place is repeated to fill its row."""
        count = np.diff(self.start)
        return self.frame[self.start[:-1, None] + np.minimum(np.arange(count.max()), count[:, None] - 1)]

    def max_of_frames(self, values: np.ndarray) -> np.ndarray:
        """Return the maximum, over the scene frames (reference frames in rooms) of each place, of a value of each
        frame, (K,).

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
        likelihood: (H,) float64 log likelihood ratio (nats) of the objects of the query, from the localizer's search
            over poses.
    """

    place: np.ndarray
    xy_m: np.ndarray
    yaw_rad: np.ndarray
    scale: np.ndarray
    likelihood: np.ndarray

    def __len__(self) -> int:
        return len(self.place)


class EvidenceModel(Role):
    """Computes evidence: named numbers (columns) that measure how well a query fits each candidate place of a map.

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
    """Whether the columns depend on the pose of a hypothesis. Only such evidence distinguishes poses in one place."""
    column_step: ClassVar[int | None] = 1
    """If the panorama is rotated by a multiple of this number of pixel columns, the evidence does not change. None: any
    rotation may change it."""

    def describe(self, panorama: Panorama, description: Description) -> Description:
        """Return arrays to add to the description of a panorama. Their names must be in `arrays`.

        Args:
            panorama: The panorama.
            description: The arrays that the localizer computed, such as the arrays of the saliency graph.
        """
        return {}

    def join(self, descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
        """Return the arrays for the joint description of several views of a query. By default, these are the arrays of
        the last view.

        Args:
            descriptions: The descriptions of V views, in the order in which they were taken.
            T_last_view: (V, 4, 4) poses of the views in the frame of the last view.
        """
        return self.arrays_of(descriptions[-1])

    def pack(self, description: Description) -> Description:
        """Return the arrays that a map stores. By default, these are the arrays of `describe`."""
        return self.arrays_of(description)

    def unpack(self, packed: Description) -> Description:
        """Return the arrays of `describe` from packed arrays, up to the rounding of `pack`."""
        return self.arrays_of(packed)

    def index(self, descriptions: Sequence[Description], places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        """Prepare the scoring of hypotheses in a map with S reference frames. By default, nothing is prepared.

        Args:
            descriptions: The arrays of `describe` for each reference frame; an empty mapping for a frame without such
                arrays.
            places: The places of the map.
            T_world_pano: (S, 3, 4) poses of the frames.
        """

    def open_index(self, packed: Columns, places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        """Prepare the scoring of hypotheses in a map that was opened. The scores must be the same as after `index`.

        By default, all descriptions are unpacked and passed to `index`. Override this method to open large maps fast.

        Args:
            packed: Packed descriptions of the reference frames, mapped into memory.
            places: As in `index`.
            T_world_pano: As in `index`.
        """
        self.index([self.unpack(row) for row in packed] if self.arrays else [{}] * len(packed), places, T_world_pano)

    @abstractmethod
    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        """Return a mapping from the name of each column to its values, (H,) float64, finite. Must not change its input.

        Args:
            description: The description of the query, with the arrays of the localizer and of `describe`.
            hypotheses: The hypotheses of the place of the query.
        """

    def arrays_of(self, description: Description) -> Description:
        """Return the arrays of a description that are named in `arrays`."""
        return {name: description[name] for name in self.arrays if name in description}
