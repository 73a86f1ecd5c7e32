"""From the numbers that detection networks of the known kinds give to boxes in their images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.framework.errors import WeightsMissing
from salframe_detectors.detection_decoder import DetectionDecoder, Found, Question

YOLOX_STRIDES_PX = (8, 16, 32)
MASK_COEFFICIENTS = 32
"""Prototype masks of YOLOv8's segmentation head."""


class Yolox(DetectionDecoder):
    """YOLOX's raw grid (B, cells, 5 + classes): offset from the cell and log size in strides, objectness, classes."""

    name = "yolox"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], asked: Question) -> list[Found]:
        """See DetectionDecoder."""
        cells = [(asked.height_px // stride, asked.width_px // stride, stride) for stride in YOLOX_STRIDES_PX]
        count = sum(rows * columns for rows, columns, _ in cells)
        (raw,) = _shaped(self.name, outputs, (count, 5 + asked.classes))
        corner = np.concatenate(
            [
                np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
                for rows, columns, _ in cells
            ]
        )
        stride_px = np.concatenate([np.full((rows * columns, 1), stride) for rows, columns, stride in cells])
        return [
            _pick(
                (image[:, :2] + corner) * stride_px,
                np.exp(np.minimum(image[:, 2:4], 20)) * stride_px,
                image[:, 4:5] * image[:, 5:],
                asked,
            )
            for image in raw
        ]


class Yolov5(DetectionDecoder):
    """YOLOv5 and YOLOv7 (B, candidates, 5 + classes): centre and size in pixels, objectness, classes."""

    name = "yolov5"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], asked: Question) -> list[Found]:
        """See DetectionDecoder."""
        (raw,) = _shaped(self.name, outputs, (None, 5 + asked.classes))
        return [_pick(image[:, :2], image[:, 2:4], image[:, 4:5] * image[:, 5:], asked) for image in raw]


class Yolov8(DetectionDecoder):
    """YOLOv8 to YOLO11 (B, 4 + classes, candidates): centre and size in pixels, classes."""

    name = "yolov8"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], asked: Question) -> list[Found]:
        """See DetectionDecoder."""
        (raw,) = _shaped(self.name, outputs, (4 + asked.classes, None))
        return [_pick(image[:2].T, image[2:4].T, image[4:].T, asked) for image in raw]


class Yolov8Seg(DetectionDecoder):
    """YOLOv8's segmentation: boxes as of yolov8, and masks.

    32 coefficients more a candidate, and (B, 32, h, w) prototypes that these weigh to masks.
    """

    name = "yolov8-seg"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], asked: Question) -> list[Found]:
        """See DetectionDecoder."""
        import cv2

        wanted = (4 + asked.classes + MASK_COEFFICIENTS, None), (MASK_COEFFICIENTS, None, None)
        raw, prototypes = _shaped(self.name, outputs, *wanted)
        answers = []
        for image, prototype in zip(raw, prototypes, strict=True):
            weights = image[4 + asked.classes :].T
            picked, kept = _pick_from(image[:2].T, image[2:4].T, image[4 : 4 + asked.classes].T, asked)
            masks = [
                cv2.resize(np.tensordot(w, prototype, 1), (asked.width_px, asked.height_px)) > 0 for w in weights[kept]
            ]
            mask = np.array(masks, bool).reshape(-1, asked.height_px, asked.width_px)
            answers.append(Found(picked.box_px, picked.score, picked.label, mask))
        return answers


class Detr(DetectionDecoder):
    """DETR: logits (B, queries, classes + 1), softmax, and boxes (B, queries, 4), centre and size as shares.

    The last class is "no object".
    """

    name = "detr"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], asked: Question) -> list[Found]:
        """See DetectionDecoder."""
        logits, boxes = _shaped(self.name, outputs, (None, asked.classes + 1), (None, 4))
        odds = np.exp(logits - logits.max(-1, keepdims=True))
        return _pick_shares(boxes, (odds / odds.sum(-1, keepdims=True))[..., :-1], asked)


class RtDetr(DetectionDecoder):
    """RT-DETR, Deformable DETR and others with focal loss: as detr with logits (B, queries, classes), sigmoid."""

    name = "rt-detr"
    version = "1"

    def decode(self, outputs: Sequence[np.ndarray], asked: Question) -> list[Found]:
        """See DetectionDecoder."""
        logits, boxes = _shaped(self.name, outputs, (None, asked.classes), (None, 4))
        return _pick_shares(boxes, 1 / (1 + np.exp(-logits)), asked)


def _shaped(name: str, outputs: Sequence[np.ndarray], *shapes: tuple[int | None, ...]) -> list[np.ndarray]:
    """The outputs with these shapes after the batch axis (None: any length), in this order. Raises WeightsMissing where
    one is absent."""
    found, left = [], list(range(len(outputs)))
    for shape in shapes:
        fitting = [i for i in left if _fits(outputs[i].shape[1:], shape)]
        if not fitting:
            received = ", ".join(_spell(output.shape[1:]) for output in outputs)
            raise WeightsMissing(
                f"the network gives {received} an image, the decoder {name} expects {', '.join(map(_spell, shapes))}"
            )
        left.remove(fitting[0])
        found.append(outputs[fitting[0]])
    return found


def _fits(received: Sequence[int], wanted: Sequence[int | None]) -> bool:
    return len(received) == len(wanted) and all(
        length in (None, got) for length, got in zip(wanted, received, strict=True)
    )


def _spell(shape: Sequence[int | None]) -> str:
    return f"({', '.join('*' if length is None else str(length) for length in shape)})"


def _pick_shares(boxes: np.ndarray, scores: np.ndarray, asked: Question) -> list[Found]:
    size_px = np.array([asked.width_px, asked.height_px])
    return [
        _pick(box[:, :2] * size_px, box[:, 2:] * size_px, score, asked)
        for box, score in zip(boxes, scores, strict=True)
    ]


def _pick(centre_px: np.ndarray, size_px: np.ndarray, scores: np.ndarray, asked: Question) -> Found:
    return _pick_from(centre_px, size_px, scores, asked)[0]


def _pick_from(
    centre_px: np.ndarray, size_px: np.ndarray, scores: np.ndarray, asked: Question
) -> tuple[Found, np.ndarray]:
    """The candidates (n, 2), (n, 2), (n, classes) that score enough, by their best class, cut at the border; and their
    positions."""
    label = scores.argmax(1)
    score = scores[np.arange(len(scores)), label].astype(np.float64)
    kept = np.flatnonzero(score >= asked.min_score)
    corners = np.hstack([centre_px - size_px / 2, centre_px + size_px / 2])[kept].astype(np.float64)
    box_px = np.clip(corners, 0, [asked.width_px, asked.height_px] * 2)
    return Found(box_px, np.clip(score[kept], 0, 1), label[kept]), kept
