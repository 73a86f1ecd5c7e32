"""What every feature and matcher pair has in common. An adapter is one class in a module of its own and one line in
PAIRS."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from salframe.framework.errors import WeightsMissing
from salframe.framework.weights import Weights

if TYPE_CHECKING:
    from salframe_keypoints.localizer import Keypoints


@dataclass(frozen=True, eq=False)
class View:
    """One perspective view as a pair remembers it.

    points_px (K, 2): x and y of the points that can be matched, pixel centres at +0.5; features: their descriptors (K,
    D), or whatever else the pair matches by. Both are stored as they are, so their dtypes are what a map costs.
    """

    points_px: np.ndarray
    features: np.ndarray


class Pair(ABC):
    """A feature extractor and the matcher that goes with it."""

    requires: ClassVar[tuple[str, ...]] = ()
    extra: ClassVar[str] = "salframe[keypoints]"
    """The pip requirement that brings them."""
    weights: ClassVar[tuple[Weights, ...]] = ()

    @classmethod
    def files(cls, config: Keypoints.Config) -> tuple[Path, ...]:
        """The files that the networks are loaded from, verified; they are part of what a description is known by.
        Raises WeightsMissing."""
        return tuple(path for weights in cls.weights for path in weights.paths(config.checkpoint))

    @abstractmethod
    def __init__(self, config: Keypoints.Config) -> None:
        """Load what extraction and matching need."""

    @abstractmethod
    def extract(self, images: np.ndarray) -> list[View]:
        """A View for each of the images (V, h, w, 3) uint8 RGB."""

    @abstractmethod
    def restrict(self, view: View, seen: np.ndarray) -> View:
        """The view without the points on pixels that are not part of the panorama; seen (K,) bool, one a point."""

    @abstractmethod
    def match(self, query: View, reference: View) -> tuple[np.ndarray, np.ndarray]:
        """Matches of two views: (M, 2) pixels of the query, and (M,) int positions in `reference.points_px`."""

    @abstractmethod
    def retrieval_features(self, view: View) -> np.ndarray:
        """(N, D) float32 local descriptors of unit length that the global descriptor of a view is pooled from."""


class DescriptorPair(Pair):
    """A pair that finds points with descriptors in each view and then matches those."""

    @abstractmethod
    def match_descriptors(self, query: View, reference: View) -> np.ndarray:
        """(M, 2) int: positions of matched points in the query and in the reference."""

    def restrict(self, view: View, seen: np.ndarray) -> View:
        """See Pair."""
        return View(view.points_px[seen], view.features[seen])

    def match(self, query: View, reference: View) -> tuple[np.ndarray, np.ndarray]:
        """See Pair."""
        matches = self.match_descriptors(query, reference)
        return query.points_px[matches[:, 0]], matches[:, 1]

    def retrieval_features(self, view: View) -> np.ndarray:
        """The descriptors themselves, brought to unit length."""
        return unit_rows(view.features)


def read_checkpoint(path: Path) -> Any:
    """What a torch checkpoint holds, on the CPU, without running code from it. Raises WeightsMissing where it is none."""
    import torch

    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises whatever its unpickler stumbles over
        raise WeightsMissing(f"{path} is no torch checkpoint: {type(error).__name__} {_one_line(error)}") from None


def load_strictly(module: Any, state: Any, path: Path, computed: str | None = None) -> None:
    """Put a state into a torch module, every tensor of both accounted for. Raises WeightsMissing.

    `computed` names a buffer of the module that is not learned: it stays, whether or not the state has it.
    """
    try:
        module.load_state_dict(dict(state) | ({computed: module.get_buffer(computed)} if computed else {}))
    except (RuntimeError, TypeError, ValueError) as error:
        raise WeightsMissing(f"{path} does not fit {type(module).__name__}: {_one_line(error)}") from None


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 200 else f"{text[:200]}..."


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """(N, D) float32 rows of unit length; a row of zeros stays."""
    vectors = np.asarray(vectors, np.float32)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def gray(images: Sequence[np.ndarray]) -> list[np.ndarray]:
    """(h, w) uint8 luminance of each (h, w, 3) uint8 RGB image."""
    import cv2

    return [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in images]
