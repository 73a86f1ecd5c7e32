"""Decoders for the output formats of common detection networks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import WeightsError
from salframe.graphs.image_detections import ImageDetections
from salframe_detectors.detection_decoder import DecodeRequest, DetectionDecoder

YOLOX_STRIDES_PX = (8, 16, 32)
MASK_COEFFICIENTS = 32
"""Number of prototype masks of YOLOv8's segmentation head."""


class Yolox(DetectionDecoder):
    """YOLOX: outputs (B, cells, 5 + classes) for B images, with offset from the grid cell, logarithm of the size,
    objectness and class scores."""

    name = "yolox"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """See DetectionDecoder."""
        cells = [(request.height_px // stride, request.width_px // stride, stride) for stride in YOLOX_STRIDES_PX]
        count = sum(rows * columns for rows, columns, _ in cells)
        (raw,) = _select_outputs(self.name, outputs, (count, 5 + request.num_classes))
        corner = np.concatenate(
            [
                np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
                for rows, columns, _ in cells
            ]
        )
        stride_px = np.concatenate([np.full((rows * columns, 1), stride) for rows, columns, stride in cells])
        return [
            _select(
                (image[:, :2] + corner) * stride_px,
                np.exp(np.minimum(image[:, 2:4], 20)) * stride_px,
                image[:, 4:5] * image[:, 5:],
                request,
            )
            for image in raw
        ]


class Yolov5(DetectionDecoder):
    """YOLOv5 and YOLOv7: outputs (B, candidates, 5 + classes) for B images, with centre and size in pixels, objectness
    and class scores."""

    name = "yolov5"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """See DetectionDecoder."""
        (raw,) = _select_outputs(self.name, outputs, (None, 5 + request.num_classes))
        return [_select(image[:, :2], image[:, 2:4], image[:, 4:5] * image[:, 5:], request) for image in raw]


class Yolov8(DetectionDecoder):
    """YOLOv8 to YOLO11: outputs (B, 4 + classes, candidates) for B images, with centre and size in pixels, and class
    scores."""

    name = "yolov8"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """See DetectionDecoder."""
        (raw,) = _select_outputs(self.name, outputs, (4 + request.num_classes, None))
        return [_select(image[:2].T, image[2:4].T, image[4:].T, request) for image in raw]


class Yolov8Seg(DetectionDecoder):
    """YOLOv8 segmentation: boxes as in `yolov8`, and masks.

    A second output contains 32 prototype masks for each image (B, 32, h, w). Each candidate has 32 more values than in
    `yolov8`, the weights of the prototype masks. Its mask is the weighted sum of the prototype masks.
    """

    name = "yolov8-seg"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """See DetectionDecoder."""
        import cv2

        expected = (4 + request.num_classes + MASK_COEFFICIENTS, None), (MASK_COEFFICIENTS, None, None)
        raw, prototypes = _select_outputs(self.name, outputs, *expected)
        answers = []
        for image, prototype in zip(raw, prototypes, strict=True):
            weights = image[4 + request.num_classes :].T
            detections, indices = _select_with_indices(
                image[:2].T, image[2:4].T, image[4 : 4 + request.num_classes].T, request
            )
            masks = [
                cv2.resize(np.tensordot(w, prototype, 1), (request.width_px, request.height_px)) > 0
                for w in weights[indices]
            ]
            mask = np.array(masks, bool).reshape(-1, request.height_px, request.width_px)
            answers.append(ImageDetections(detections.box_px, detections.score, detections.label, mask))
        return answers


class Detr(DetectionDecoder):
    """DETR: logits (B, candidates, classes + 1) for B images, converted by softmax, and boxes (B, candidates, 4).

    Boxes are centre and size, divided by the image size. The last class means "no object".
    """

    name = "detr"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """See DetectionDecoder."""
        logits, boxes = _select_outputs(self.name, outputs, (None, request.num_classes + 1), (None, 4))
        odds = np.exp(logits - logits.max(-1, keepdims=True))
        return _select_relative(boxes, (odds / odds.sum(-1, keepdims=True))[..., :-1], request)


class RtDetr(DetectionDecoder):
    """RT-DETR, Deformable DETR and similar networks: as `detr`, with logits (B, candidates, classes) and sigmoid."""

    name = "rt-detr"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], request: DecodeRequest) -> list[ImageDetections]:
        """See DetectionDecoder."""
        logits, boxes = _select_outputs(self.name, outputs, (None, request.num_classes), (None, 4))
        return _select_relative(boxes, 1 / (1 + np.exp(-logits)), request)


def _select_outputs(name: str, outputs: Sequence[np.ndarray], *shapes: tuple[int | None, ...]) -> list[np.ndarray]:
    """Return the outputs that have `shapes` after the batch axis, in the order of `shapes`. None matches any length.

    Raises:
        WeightsError: One of the shapes has no output.
    """
    matches, remaining = [], list(range(len(outputs)))
    for shape in shapes:
        candidates = [i for i in remaining if _fits(outputs[i].shape[1:], shape)]
        if not candidates:
            received = ", ".join(_format_shape(output.shape[1:]) for output in outputs)
            raise WeightsError(
                f"the output arrays of the network have the shapes {received} for each image, expected "
                f"{', '.join(map(_format_shape, shapes))} for the decoder {name!r} (* is any length): "
                "set decoder to the output format of the network"
            )
        remaining.remove(candidates[0])
        matches.append(outputs[candidates[0]])
    return matches


def _fits(received: Sequence[int], expected: Sequence[int | None]) -> bool:
    return len(received) == len(expected) and all(
        length in (None, actual) for length, actual in zip(expected, received, strict=True)
    )


def _format_shape(shape: Sequence[int | None]) -> str:
    return f"({', '.join('*' if length is None else str(length) for length in shape)})"


def _select_relative(boxes: np.ndarray, scores: np.ndarray, request: DecodeRequest) -> list[ImageDetections]:
    size_px = np.array([request.width_px, request.height_px])
    return [
        _select(box[:, :2] * size_px, box[:, 2:] * size_px, score, request)
        for box, score in zip(boxes, scores, strict=True)
    ]


def _select(centre_px: np.ndarray, size_px: np.ndarray, scores: np.ndarray, request: DecodeRequest) -> ImageDetections:
    return _select_with_indices(centre_px, size_px, scores, request)[0]


def _select_with_indices(
    centre_px: np.ndarray, size_px: np.ndarray, scores: np.ndarray, request: DecodeRequest
) -> tuple[ImageDetections, np.ndarray]:
    """Select the candidates whose best class scores at least min_score, and clip their boxes to the image.

    Args:
        centre_px: Centres (n, 2) in pixels.
        size_px: Widths and heights (n, 2) in pixels.
        scores: Scores (n, classes).
        request: Image size and minimum score.

    Returns:
        The detections, and their indices among the candidates.
    """
    label = scores.argmax(1)
    score = scores[np.arange(len(scores)), label].astype(np.float64)
    indices = np.flatnonzero(score >= request.min_score)
    corners = np.hstack([centre_px - size_px / 2, centre_px + size_px / 2])[indices].astype(np.float64)
    box_px = np.clip(corners, 0, [request.width_px, request.height_px] * 2)
    return ImageDetections(box_px, np.clip(score[indices], 0, 1), label[indices]), indices
