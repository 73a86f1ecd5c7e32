"""Rules of the role `detection-decoder` for the conformance suite."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from salframe.framework.errors import WeightsError
from salframe.graphs.image_detections import ImageDetections
from salframe.testing.expectations import ConformanceError, call_twice, expect, same
from salframe_detectors.detection_decoder import DecodeRequest, DetectionDecoder

REQUEST = DecodeRequest(width_px=96, height_px=64, num_classes=3, min_score=0.25)
CELLS = sum((REQUEST.width_px // stride) * (REQUEST.height_px // stride) for stride in (8, 16, 32))
LAYOUTS: dict[str, tuple[tuple[int, ...], ...]] = {
    "a grid of three strides": ((CELLS, 5 + REQUEST.num_classes),),
    "candidates with objectness": ((40, 5 + REQUEST.num_classes),),
    "candidates in columns": ((4 + REQUEST.num_classes, 40),),
    "candidates in columns and prototypes of masks": ((4 + REQUEST.num_classes + 32, 40), (32, 16, 24)),
    "logits with a class for no object, and boxes": ((20, REQUEST.num_classes + 1), (20, 4)),
    "logits and boxes": ((20, REQUEST.num_classes), (20, 4)),
    "boxes, score and class": ((20, 6),),
}
"""Mapping from a description to the output shapes of a detection network, without the batch axis."""
BATCH = 2


def check_detection_decoder(make: Callable[[], DetectionDecoder]) -> None:
    """Check that a decoder returns valid boxes for any numbers, and raises WeightsError for unexpected shapes."""
    decoder = make()
    rng = np.random.default_rng(0)
    for layout, shapes in LAYOUTS.items():
        outputs = [rng.random((BATCH, *shape), np.float32) for shape in shapes]
        try:
            decoder.decode(outputs, REQUEST)
        except WeightsError:
            continue
        except Exception as error:
            line = f"{type(error).__name__}: {error}"
            raise ConformanceError(
                f"the function `decode` of the layout {layout} raised {line}, expected boxes or a WeightsError"
            ) from error
        for scale in (0.0, 1.0, 30.0):
            _check_layout(
                make, f"decode of {layout}, multiplied by {scale:g}", [np.float32(scale) * array for array in outputs]
            )


def _check_layout(make: Callable[[], DetectionDecoder], checked: str, outputs: Sequence[np.ndarray]) -> None:
    answer = call_twice(checked, make().decode, outputs, REQUEST)
    expect(isinstance(answer, list), checked, type(answer).__name__, "a list of ImageDetections")
    expect(len(answer) == BATCH, checked, f"{len(answer)} answers", f"one for each of {BATCH} images")
    for detections in answer:
        _check_detections(checked, detections)
    alone = call_twice(f"{checked}, the second image alone", make().decode, [array[1:] for array in outputs], REQUEST)
    expect(same(alone, answer[1:]), f"{checked}, the second image alone", "another answer", "the same as in a batch")


def _check_detections(checked: str, detections: ImageDetections) -> None:
    expect(isinstance(detections, ImageDetections), checked, type(detections).__name__, "ImageDetections")
    count = len(detections.score)
    shapes = [np.shape(part) for part in (detections.box_px, detections.score, detections.label)]
    expect(shapes == [(count, 4), (count,), (count,)], checked, f"shapes {shapes}", "(n, 4), (n,) and (n,)")
    finite = np.isfinite(detections.box_px).all() and np.isfinite(detections.score).all()
    expect(finite, checked, "a box or score that is not finite", "finite boxes and scores")
    expect(detections.label.dtype.kind in "iu", checked, f"labels of dtype {detections.label.dtype}", "whole numbers")
    in_classes = ((detections.label >= 0) & (detections.label < REQUEST.num_classes)).all()
    expect(
        in_classes, checked, f"labels {sorted(set(detections.label.tolist()))}", f"classes below {REQUEST.num_classes}"
    )
    valid_scores = ((detections.score >= REQUEST.min_score) & (detections.score <= 1)).all()
    expect(valid_scores, checked, f"scores {detections.score.tolist()}", f"scores from {REQUEST.min_score} to 1")
    size_px = REQUEST.width_px, REQUEST.height_px
    inside = ((detections.box_px >= 0) & (detections.box_px <= size_px * 2)).all()
    expect(inside, checked, "a box beyond the image", f"boxes within {size_px[0]} x {size_px[1]} pixels")
    if detections.mask is not None:
        fits = detections.mask.dtype == bool and detections.mask.shape == (count, *size_px[::-1])
        expect(fits, checked, f"masks {detections.mask.dtype} {detections.mask.shape}", "bool (n, height, width)")
