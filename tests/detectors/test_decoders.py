"""Known boxes written as each kind of network gives them, and read back."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conformance import breaks, conforms
from salframe_detectors.decoders import Yolov5
from salframe_detectors.detection_decoder import DecodeRequest, DetectionDecoder

from salframe.framework.components.registry import registry
from salframe.framework.errors import WeightsError
from salframe.graphs.image_detections import ImageDetections, suppress

REQUEST = DecodeRequest(width_px=96, height_px=64, num_classes=3, min_score=0.25)
BOXES = np.array([[10.0, 8.0, 30.0, 40.0], [50.0, 20.0, 90.0, 60.0]])
LABEL, SCORE = np.array([2, 0]), np.array([0.9, 0.5])
CENTRE, SIZE = (BOXES[:, :2] + BOXES[:, 2:]) / 2, BOXES[:, 2:] - BOXES[:, :2]
CLASSES = np.eye(3)[LABEL]


def odds(p):
    return np.log(p / (1 - p))


def as_yolox():
    """Each box in a cell of another stride: (centre / stride - cell, log(size / stride))."""
    raw = np.zeros((96 // 8 * 64 // 8 + 96 // 16 * 64 // 16 + 96 // 32 * 64 // 32, 8))
    for i, (stride, first) in enumerate(((8, 0), (32, 96 + 24))):
        cell = (CENTRE[i] // stride).astype(int)
        row = first + cell[1] * (96 // stride) + cell[0]
        # Objectness 1, so that the class has the score.
        raw[row] = [*(CENTRE[i] / stride - cell), *np.log(SIZE[i] / stride), 1.0, *(CLASSES[i] * SCORE[i])]
    return [raw[None]]


def as_yolov5():
    return [np.hstack([CENTRE, SIZE, np.sqrt(SCORE)[:, None], CLASSES * np.sqrt(SCORE)[:, None]])[None]]


def as_yolov8():
    return [np.hstack([CENTRE, SIZE, CLASSES * SCORE[:, None]]).T[None]]


def as_yolov8_seg():
    """Prototype 0 is positive in the left half of the image, 1 in the right half; the boxes take one each."""
    prototypes = np.zeros((32, 16, 24))
    prototypes[0, :, :12], prototypes[0, :, 12:] = 1, -1
    prototypes[1] = -prototypes[0]
    weights = np.eye(32)[[0, 1]] * 5
    return [np.hstack([CENTRE, SIZE, CLASSES * SCORE[:, None], weights]).T[None], prototypes[None]]


def as_detr():
    logits = np.full((4, 4), -9.0)  # two queries of four see something; the fourth class is "no object"
    logits[2:, 3] = 9
    for i in range(2):
        logits[i, [LABEL[i], 3]] = odds(SCORE[i]), 0
    boxes = np.vstack([np.hstack([CENTRE / (96, 64), SIZE / (96, 64)]), np.full((2, 4), 0.5)])
    return [logits[None], boxes[None]]


def as_rt_detr():
    logits = np.full((4, 3), -9.0)
    logits[[0, 1], LABEL] = odds(SCORE)
    boxes = np.vstack([np.hstack([CENTRE / (96, 64), SIZE / (96, 64)]), np.full((2, 4), 0.5)])
    return [boxes[None], logits[None]]  # their order does not matter


WRITERS = {
    "yolox": as_yolox,
    "yolov5": as_yolov5,
    "yolov8": as_yolov8,
    "yolov8-seg": as_yolov8_seg,
    "detr": as_detr,
    "rt-detr": as_rt_detr,
}


def decoder(name) -> DetectionDecoder:
    return registry().get("detection-decoder", name)()


@pytest.mark.parametrize("name", WRITERS)
def test_known_boxes_come_back(name):
    outputs = [np.concatenate([output, np.zeros_like(output)]).astype(np.float32) for output in WRITERS[name]()]
    first, second = decoder(name).decode(outputs, REQUEST)
    assert first.box_px == pytest.approx(BOXES, abs=1e-3)
    assert first.label.tolist() == LABEL.tolist()
    assert first.score == pytest.approx(SCORE, abs=1e-3)
    if name not in ("detr", "rt-detr"):  # of all zeros a softmax makes equal shares
        assert len(second.score) == 0


def test_masks_are_those_of_the_prototypes():
    (found,) = decoder("yolov8-seg").decode([output.astype(np.float32) for output in as_yolov8_seg()], REQUEST)
    left = np.broadcast_to(np.arange(96) < 48, (64, 96))
    assert found.mask.shape == (2, 64, 96)
    assert (found.mask[0] == left).mean() > 0.98
    assert (found.mask[1] == ~left).mean() > 0.98


def test_candidates_that_score_less_are_left_out_and_boxes_end_at_the_border():
    raw = np.array([[90.0, 60, 40, 40, 1, 0.6, 0, 0], [20, 20, 10, 10, 1, 0.2, 0.1, 0]], np.float32)
    (found,) = decoder("yolov5").decode([raw[None]], REQUEST)
    assert found.box_px.tolist() == [[70, 40, 96, 64]]


def test_other_shapes_are_told():
    with pytest.raises(
        WeightsError, match=r"have the shapes \(8, 100\) for each image, expected \(126, 8\) for the decoder 'yolox'"
    ):
        decoder("yolox").decode([np.zeros((1, 8, 100), np.float32)], REQUEST)
    with pytest.raises(
        WeightsError,
        match=r"have the shapes \(100, 3\) for each image, expected \(\*, 4\), \(\*, 4\) for the decoder 'detr'",
    ):
        decoder("detr").decode([np.zeros((1, 100, 3), np.float32)], REQUEST)


def test_of_overlapping_boxes_of_a_class_the_best_is_kept():
    # 0 and 1 overlap by 90 / 110, 0 and 2 as much with another class, 3 stands apart.
    box = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [1, 0, 11, 10], [30, 0, 40, 10]], float)
    found = ImageDetections(box, np.array([0.6, 0.8, 0.7, 0.5]), np.array([1, 1, 0, 1]))
    kept = suppress(found, 0.45)
    assert sorted(zip(kept.label.tolist(), kept.score.tolist(), strict=True)) == [(0, 0.7), (1, 0.5), (1, 0.8)]
    assert len(suppress(found, 0.85).score) == 4
    assert len(suppress(found.take(np.zeros(0, int)), 0.45).score) == 0


def test_the_decoder_that_the_documentation_adds_works():
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "roles" / "detection-decoder.md").read_text()
    written: dict = {}
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], written)
    raw = np.hstack([BOXES, SCORE[:, None], LABEL[:, None]])[None]
    (found,) = written["EndToEnd"]().decode([np.concatenate([raw, raw * (1, 1, 1, 1, 0.1, 1)], 1)], REQUEST)
    assert found.box_px.tolist() == BOXES.tolist()
    assert (found.score.tolist(), found.label.tolist()) == (SCORE.tolist(), LABEL.tolist())
    assert conforms(written["EndToEnd"])


@pytest.mark.parametrize("name", WRITERS)
def test_it_keeps_the_promises_of_the_role(name):
    assert conforms(registry().get("detection-decoder", name))


class Overflowing(Yolov5):
    """Broken."""

    name = "broken"

    def decode(self, outputs, request):
        return [ImageDetections(one.box_px + 50, one.score, one.label) for one in super().decode(outputs, request)]


class Doubtful(Yolov5):
    """Broken."""

    name = "broken"

    def decode(self, outputs, request):
        return super().decode(outputs, replace(request, min_score=0.1))


class Surprised(Yolov5):
    """Broken."""

    name = "broken"

    def decode(self, outputs, request):
        return super().decode([outputs[0].reshape(-1, 11)], request)


@pytest.mark.parametrize(
    ("component", "message"),
    [
        (Overflowing, r"received a box beyond the image, expected boxes within 96 x 64 pixels"),
        (Doubtful, r"received scores \[.*expected scores from 0\.25 to 1"),
        (Surprised, r"raised ValueError: cannot reshape .*, expected boxes or a WeightsError"),
    ],
)
def test_a_broken_decoder_is_told_in_one_line(component, message):
    breaks(message, component)


def test_of_too_many_boxes_the_best_are_kept():
    """200,000 boxes, all but 300 on top of each other: the hundred best of those that stand apart."""
    rng = np.random.default_rng(0)
    corner = np.full((200_000, 2), 5.0)
    corner[:300] = np.stack([np.arange(300) * 20.0, np.full(300, 100.0)], 1)
    score = rng.uniform(0.3, 0.5, 200_000)
    score[:300] = np.linspace(0.99, 0.6, 300)
    found = suppress(ImageDetections(np.hstack([corner, corner + 10]), score, np.zeros(200_000, int)), 0.45)
    np.testing.assert_array_equal(found.box_px[:, 0], np.arange(100) * 20.0)
