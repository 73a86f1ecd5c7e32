"""The role `detection-decoder`: conversion of a detection network's outputs to boxes, for the detector `onnx`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.framework.component import Role


@dataclass(frozen=True, eq=False)
class ImageDetections:
    """Detections of a network in one image.

    Attributes:
        box_px: Boxes (n, 4): left, top, right, bottom; pixel centres at +0.5.
        score: Scores (n,) in [0, 1].
        label: Classes (n,) int.
        mask: Masks (n, height, width) bool; None if only boxes are known.
    """

    box_px: np.ndarray
    score: np.ndarray
    label: np.ndarray
    mask: np.ndarray | None = None

    def take(self, index: np.ndarray) -> ImageDetections:
        """Return the detections at these positions."""
        return ImageDetections(
            self.box_px[index], self.score[index], self.label[index], None if self.mask is None else self.mask[index]
        )

    def masks(self) -> Sequence[np.ndarray | None]:
        """Return the mask of each detection, None if only boxes are known."""
        return [None] * len(self.score) if self.mask is None else list(self.mask)


@dataclass(frozen=True)
class DecodeRequest:
    """Parameters of a decoder.

    Attributes:
        width_px: Width of the images.
        height_px: Height of the images.
        num_classes: Number of classes.
        min_score: Minimum score of a detection.
    """

    width_px: int
    height_px: int
    num_classes: int
    min_score: float


class DetectionDecoder(Role):
    """Decodes the outputs of a detection network to boxes in its images."""

    role = "detection-decoder"
    conformance = "salframe_detectors.conformance:check_detection_decoder"

    @abstractmethod
    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """Decode the detections in each image of a batch, before suppression of overlapping boxes.

        Args:
            outputs: Outputs of the network in its order, float32; the first axis of each is the batch.
            request: Image size, number of classes and minimum score.

        Returns:
            Detections of each image.

        Raises:
            WeightsError: The outputs have other shapes than expected.
        """
