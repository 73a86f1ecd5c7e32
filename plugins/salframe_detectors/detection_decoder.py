"""The role that the detector `onnx` reads its networks by: what the numbers mean that a network gives."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.framework.component import Role


@dataclass(frozen=True, eq=False)
class Found:
    """What a network found in one image.

    box_px (n, 4) left, top, right, bottom, pixel centres at +0.5; score (n,) in [0, 1]; label (n,) int, the class; mask
    (n, height, width) bool, or None where only boxes are known.
    """

    box_px: np.ndarray
    score: np.ndarray
    label: np.ndarray
    mask: np.ndarray | None = None

    def take(self, index: np.ndarray) -> Found:
        """What was found at these positions."""
        return Found(
            self.box_px[index], self.score[index], self.label[index], None if self.mask is None else self.mask[index]
        )

    def masks(self) -> Sequence[np.ndarray | None]:
        """The mask of each, None where only boxes are known."""
        return [None] * len(self.score) if self.mask is None else list(self.mask)


@dataclass(frozen=True)
class Question:
    """What a decoder needs to know besides the numbers: the images' size, how many classes there are, the least score
    wanted."""

    width_px: int
    height_px: int
    classes: int
    min_score: float


class DetectionDecoder(Role):
    """Reads boxes in images from the numbers that a detection network gives."""

    role = "detection-decoder"
    conformance = "salframe_detectors.conformance:check_detection_decoder"

    @abstractmethod
    def decode(self, outputs: Sequence[np.ndarray], asked: Question) -> list[Found]:
        """What was found in each image of a batch, before overlapping boxes are joined.

        outputs: the network's, float32, each with the batch as its first axis, in the network's order. Raises
        WeightsMissing where they have other shapes than such a network gives.
        """
