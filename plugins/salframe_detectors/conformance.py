"""The rules of the role `detection-decoder`, for the conformance suite."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from salframe.framework.errors import WeightsMissing
from salframe.testing.asking import ConformanceError, ask, expect, same
from salframe_detectors.detection_decoder import DetectionDecoder, Found, Question

ASKED = Question(width_px=96, height_px=64, classes=3, min_score=0.25)
CELLS = sum((ASKED.width_px // stride) * (ASKED.height_px // stride) for stride in (8, 16, 32))
LAYOUTS: dict[str, tuple[tuple[int, ...], ...]] = {
    "a grid of three strides": ((CELLS, 5 + ASKED.classes),),
    "candidates with objectness": ((40, 5 + ASKED.classes),),
    "candidates in columns": ((4 + ASKED.classes, 40),),
    "candidates in columns and prototypes of masks": ((4 + ASKED.classes + 32, 40), (32, 16, 24)),
    "logits with no object, and boxes": ((20, ASKED.classes + 1), (20, 4)),
    "logits and boxes": ((20, ASKED.classes), (20, 4)),
    "boxes, score and class": ((20, 6),),
}
"""Shapes after the batch axis that detection networks give, whatever the numbers mean."""
BATCH = 2


def check_detection_decoder(make: Callable[[], DetectionDecoder]) -> None:
    """Well-formed boxes within the images from whatever numbers, and WeightsMissing on shapes of another network."""
    decoder = make()
    rng = np.random.default_rng(0)
    for what, shapes in LAYOUTS.items():
        outputs = [rng.random((BATCH, *shape), np.float32) for shape in shapes]
        try:
            decoder.decode(outputs, ASKED)
        except WeightsMissing:
            continue
        except Exception as error:
            line = f"{type(error).__name__}: {error}"
            raise ConformanceError(f"decode of {what}: received {line}, expected boxes or WeightsMissing") from error
        for scale in (0.0, 1.0, 30.0):
            _check_layout(make, f"decode of {what} times {scale:g}", [np.float32(scale) * array for array in outputs])


def _check_layout(make: Callable[[], DetectionDecoder], checked: str, outputs: Sequence[np.ndarray]) -> None:
    answer = ask(checked, make().decode, outputs, ASKED)
    expect(isinstance(answer, list), checked, type(answer).__name__, "a list of Found")
    expect(len(answer) == BATCH, checked, f"{len(answer)} answers", f"one for each of {BATCH} images")
    for found in answer:
        _check_found(checked, found)
    alone = ask(f"{checked}, the second image alone", make().decode, [array[1:] for array in outputs], ASKED)
    expect(same(alone, answer[1:]), f"{checked}, the second image alone", "another answer", "the same as in a batch")


def _check_found(checked: str, found: Found) -> None:
    expect(isinstance(found, Found), checked, type(found).__name__, "Found")
    count = len(found.score)
    shapes = [np.shape(part) for part in (found.box_px, found.score, found.label)]
    expect(shapes == [(count, 4), (count,), (count,)], checked, f"shapes {shapes}", "(n, 4), (n,) and (n,)")
    finite = np.isfinite(found.box_px).all() and np.isfinite(found.score).all()
    expect(finite, checked, "a box or score that is not finite", "pixels and shares")
    expect(found.label.dtype.kind in "iu", checked, f"labels of dtype {found.label.dtype}", "whole numbers")
    known = ((found.label >= 0) & (found.label < ASKED.classes)).all()
    expect(known, checked, f"labels {sorted(set(found.label.tolist()))}", f"classes below {ASKED.classes}")
    wanted = ((found.score >= ASKED.min_score) & (found.score <= 1)).all()
    expect(wanted, checked, f"scores {found.score.tolist()}", f"shares of at least {ASKED.min_score}")
    size_px = ASKED.width_px, ASKED.height_px
    inside = ((found.box_px >= 0) & (found.box_px <= size_px * 2)).all()
    expect(inside, checked, "a box beyond the image", f"boxes within {size_px[0]} x {size_px[1]} pixels")
    if found.mask is not None:
        fits = found.mask.dtype == bool and found.mask.shape == (count, *size_px[::-1])
        expect(fits, checked, f"masks {found.mask.dtype} {found.mask.shape}", "bool (n, height, width)")
