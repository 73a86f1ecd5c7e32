"""Scores of networks whose answers are known, in both formats, quantized too; and the networks that cards ship for."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from colour_network import COLOURS, SIDE_PX, kernel, write_card, write_network
from salframe_segments.card import card_beside, read_card, shipped_card
from salframe_segments.networks import open_network
from scipy.special import softmax

from salframe.framework.errors import WeightsError
from training.segments.measures import accuracy, confusion
from training.segments.photographs import read_views
from training.segments.thirteen import CLASSES, class_of

SHARED_FOLDER = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")).parent
SHARED = (
    "deeplabv3_mnv2_ade20k_151.onnx",
    "lite-model_deeplabv3-mobilenetv2-ade20k_1_default_1.tflite",
    "deeplabv3_mnv2_ade20k_uint8.tflite",
)


def write(path: Path, form: str) -> Path:
    if form == "onnx":
        return write_network(path.with_suffix(".onnx"))
    from tflite_network import write_tflite

    return write_tflite(path.with_suffix(".tflite"), quantized=form == "uint8")


def beside(path: Path):
    return open_network(path, read_card(card_beside(path)))


@pytest.mark.parametrize("form", ["onnx", "tflite", "uint8"])
def test_probabilities_are_those_of_the_closed_form(tmp_path, form):
    views = np.random.default_rng(0).integers(0, 256, (3, SIDE_PX, SIDE_PX, 3), np.uint8)
    weights, biases = kernel()
    expected = softmax(views @ weights.T + biases, -1)
    received = np.stack(list(beside(write(tmp_path / "net", form)).probabilities(views)))
    assert received.dtype == np.float32
    if form == "uint8":  # weights of 7 bits: logits are off by up to 2
        assert np.abs(received - expected).mean() < 0.01
    else:
        np.testing.assert_allclose(received, expected, atol=1e-4)
    sure = expected.max(-1) > 0.99
    np.testing.assert_array_equal(received.argmax(-1)[sure], expected.argmax(-1)[sure])


def test_a_network_with_a_free_batch_axis_is_the_same(tmp_path):
    views = np.random.default_rng(0).integers(0, 256, (3, SIDE_PX, SIDE_PX, 3), np.uint8)
    one, any_number = (beside(write_network(tmp_path / f"{n}.onnx", n)) for n in (1, "n"))
    for single, batched in zip(one.probabilities(views), any_number.probabilities(views), strict=True):
        np.testing.assert_allclose(single, batched, atol=1e-6)


@pytest.mark.parametrize("channels", ["rgb", "bgr"])
def test_colours_are_normalized_as_the_card_says(tmp_path, channels):
    path = write_network(tmp_path / "net.onnx")
    view = np.full((1, SIDE_PX, SIDE_PX, 3), COLOURS["armchair"], np.uint8)
    # (colour * 2 - 255) / (1, 2, 1) of red is (255, -127.5, -255), of blue in the order of BGR the reverse.
    taken = {"layout": "nchw", "size_px": [SIDE_PX, SIDE_PX], "channels": channels, "scale": 2}
    write_card(path, input={**taken, "mean": [255, 255, 255], "std": [1, 2, 1]})
    weights, biases = kernel()
    colour = np.array([255, -127.5, -255]) if channels == "rgb" else np.array([-255, -127.5, 255])
    (received,) = beside(path).probabilities(view)
    np.testing.assert_allclose(received[0, 0], softmax(weights @ colour + biases), atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"output": {"name": "gone", "layout": "nhwc", "values": "logits"}}, "has no tensor 'gone': set output.name"),
        (
            {"output": {"layout": "nhwc", "values": "logits"}},
            "has the type int32 without quantization parameters, so it contains no class scores",
        ),
        (
            {"input": {"layout": "nhwc", "size_px": [64, 96]}},
            r"takes float32 \(1, 96, 96, 3\) as input, expected float32 \(1, 96, 64, 3\)",
        ),
        ({"output": {"name": "logits", "layout": "nchw", "values": "logits"}}, "expected 4 axes and 5 channels"),
    ],
)
def test_a_tflite_network_that_does_not_fit_its_card_is_one_line(tmp_path, changes, message):
    path = write(tmp_path / "net", "tflite")
    own = read_card(card_beside(path)).model_dump(mode="json")
    write_card(path, **{**own, **changes})
    with pytest.raises(WeightsError, match=message) as caught:
        list(beside(path).probabilities(np.zeros((1, SIDE_PX, SIDE_PX, 3), np.uint8)))
    assert "\n" not in str(caught.value)


def test_no_network_at_all_is_one_line(tmp_path):
    pytest.importorskip("ai_edge_litert")
    path = tmp_path / "net.tflite"
    card = read_card(card_beside(write_network(tmp_path / "net.onnx")))
    for content in (b"", b"nothing of the kind" * 100):
        path.write_bytes(content)
        with pytest.raises(WeightsError, match=r"net\.tflite is not a valid TensorFlow Lite network") as caught:
            open_network(path, card)
        assert "\n" not in str(caught.value)
    with pytest.raises(WeightsError, match=r"cannot read .*gone\.tflite"):
        open_network(tmp_path / "gone.tflite", card)


@pytest.mark.parametrize("name", SHARED)
def test_the_networks_that_cards_ship_for_know_a_photograph(name):
    """Most pixels of a labelled room are named rightly: with another order of labels or channels next to none are."""
    photographs = SHARED_FOLDER / "photos" / "nyu"
    network = SHARED_FOLDER / "weights" / name
    for needed in (photographs, network):
        if not needed.exists():
            pytest.skip(f"no {needed} (set SALFRAME_SHARED_DATA)")
    if name.endswith(".tflite"):
        pytest.importorskip("ai_edge_litert")
    card = shipped_card(network)
    view = next(read_views(photographs))
    (received,) = open_network(network, card).probabilities(cv2.resize(view.rgb, card.input.size_px)[None])
    assert received.shape[2] == len(card.labels)
    np.testing.assert_allclose(received.sum(-1), 1, atol=1e-4)
    classes = np.array([CLASSES.index(class_of(card.name_of(label) or label)) for label in card.labels], np.uint8)
    named = cv2.resize(classes[received.argmax(-1)], view.labels.shape[::-1], interpolation=cv2.INTER_NEAREST)
    assert accuracy(confusion(view.labels, named)) > 0.55
