"""The role `detection-decoder`: conversion of a detection network's outputs to boxes, for the detector `onnx`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from salframe.framework.component import Role
from salframe.graphs.image_detections import ImageDetections


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
    """Converts the outputs of a detection network to boxes in its input images."""

    role = "detection-decoder"
    conformance = "salframe_detectors.conformance:check_detection_decoder"

    @abstractmethod
    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """Decode the detections in each image of a batch. Overlapping boxes are suppressed later.

        Args:
            outputs: float32 outputs of the network, in the order of the network. The first axis of each is the batch.
            request: Image size, number of classes and minimum score.

        Returns:
            Detections of each image.

        Raises:
            WeightsError: The outputs have unexpected shapes.
        """
