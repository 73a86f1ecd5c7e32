"""The cards that ship: what they say of every label, and the one of SegFormer beside an export of the architecture."""

import numpy as np
import pytest
from salframe_segments.card import SHIPPED, read_card
from salframe_segments.networks import open_network

from salframe.framework.config import read_yaml
from salframe.graphs.vocabulary import NAMES, common_label

CARDS = {path.stem: path for path in sorted(SHIPPED.glob("*.yaml"))}


@pytest.mark.parametrize("name", CARDS)
def test_names_are_those_that_detectors_share(name):
    card = read_card(CARDS[name])
    names = {card.name_of(label) for label in card.labels} - {None}
    assert {own for own in names if common_label(own) != own} == set()
    assert names <= set(read_yaml(NAMES)["synonyms"])
    # A label that the vocabulary knows by itself is called as the vocabulary calls it.
    known = {
        word
        for part in ("synonyms", "kinds")
        for own, words in read_yaml(NAMES)[part].items()
        for word in (own, *words)
    }
    objects = {label: card.name_of(label) for label in card.labels if card.name_of(label)}
    assert {label: own for label, own in objects.items() if label in known and common_label(label) != own} == {}


def test_labels_stand_where_the_benchmark_has_them():
    labels = read_card(CARDS["deeplabv3-ade20k-151-tflite"]).labels
    assert len(labels) == len(set(labels)) == 151
    places = {0: "others", 1: "wall", 15: "door", 20: "chair", 24: "sofa", 59: "screen door", 90: "television"}
    assert {place: labels[place] for place in places} == places
    assert labels[131] == "screen"
    assert labels[150] == "flag"
    assert read_card(CARDS["deeplabv3-ade20k-151-onnx"]).labels == labels
    assert read_card(CARDS["deeplabv3-ade20k-32-tflite"]).labels == labels[:32]
    assert read_card(CARDS["segformer-b0-ade20k-onnx"]).labels == labels[1:]


def test_every_card_says_licence_and_terms_and_fixes_doors_and_windows():
    for path in CARDS.values():
        card = read_card(path)
        assert card.licence
        assert "non-commercial" in card.data_terms
        assert {"door", "window"} <= {card.fixed.get(label) for label in card.labels}


@pytest.mark.slow
def test_segformer_as_transformers_exports_it(tmp_path):
    """A random one: what the card says of input and output holds for the architecture; its scores mean nothing."""
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    pytest.importorskip("onnxscript")
    network = transformers.SegformerForSemanticSegmentation(transformers.SegformerConfig(num_labels=150)).eval()
    path = tmp_path / "segformer.onnx"
    image = torch.zeros(1, 3, 512, 512)
    names = {"input_names": ["pixel_values"], "output_names": ["logits"]}
    torch.onnx.export(network, (image,), path, **names, dynamo=True, external_data=False)
    view = np.random.default_rng(0).integers(0, 256, (1, 512, 512, 3), np.uint8)
    (received,) = open_network(path, read_card(CARDS["segformer-b0-ade20k-onnx"])).probabilities(view)
    assert received.shape == (128, 128, 150)
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    pixels = ((torch.from_numpy(view) / 255 - mean) / std).permute(0, 3, 1, 2)
    with torch.no_grad():
        expected = network(pixels).logits.softmax(1)[0].permute(1, 2, 0).numpy()
    np.testing.assert_allclose(received, expected, atol=1e-4)
