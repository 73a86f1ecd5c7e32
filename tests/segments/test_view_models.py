"""Networks of each architecture on views: outputs equal to those of the library's own pipelines, and objects from
constructed outputs."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import tiny_models as tiny
from PIL import Image
from salframe_segments import view_models
from salframe_segments.view_models import class_probabilities, open_view_model, tasks
from tiny_models import COLOURS, LABELS, SIDE_PX

from salframe.framework.errors import ConfigError
from salframe.framework.pretrained import PretrainedModel

WORDS = ("chair", "office table", "plant")
NAMES = dict(zip(LABELS, ("chair", None, "dining table", "window", "robot arm"), strict=True))
"""Name in the graph of each label; None for structure."""


def views(count: int = 3, side_px: int = SIDE_PX) -> np.ndarray:
    """Random images (count, side, side, 3) with structure at several scales."""
    rng = np.random.default_rng(1)
    return np.stack(
        [
            np.array(Image.fromarray(rng.integers(0, 255, (8, 8, 3), np.uint8)).resize((side_px, side_px)))
            for _ in range(count)
        ]
    )


def pretrained(folder, **settings) -> PretrainedModel:
    return PretrainedModel(folder, tasks(), "cpu", **settings)


def test_class_probabilities_are_those_of_the_library(models):
    """The pipeline gives the best class of each pixel only; its processor gives the resized logits too."""
    folder, images = models(tiny.segformer), views()
    pipeline = tiny.transformers.pipeline("image-segmentation", model=str(folder), device="cpu")
    for image, probability in zip(images, class_probabilities(pretrained(folder), images), strict=True):
        assert probability.shape == (SIDE_PX // 4, SIDE_PX // 4, len(COLOURS))
        np.testing.assert_allclose(probability.sum(-1), 1, atol=1e-6)
        large = tiny.torch.nn.functional.interpolate(
            tiny.torch.from_numpy(np.log(probability)).permute(2, 0, 1)[None], size=(SIDE_PX, SIDE_PX), mode="bilinear"
        )
        ours = large[0].argmax(0).numpy()
        masks = {part["label"]: np.array(part["mask"]) > 0 for part in pipeline(Image.fromarray(image))}
        for number, label in enumerate(COLOURS):
            expected = masks.get(label, np.zeros_like(ours, bool))
            # The mean of logarithms differs from that of logits by what is equal for all classes.
            assert (expected == (ours == number)).mean() > 0.999


@pytest.mark.parametrize("make", [tiny.detr, tiny.rt_detr])
def test_boxes_are_those_of_the_pipeline(models, make):
    folder, images = models(make), views()
    pipeline = tiny.transformers.pipeline("object-detection", model=str(folder), device="cpu")
    network = open_view_model(pretrained(folder), 0.01, ())
    assert network.names == ("chair", "dining table", "window", "robot arm")
    total = 0
    for image, found in zip(images, network.detect(images), strict=True):
        expected = [part for part in pipeline(Image.fromarray(image), threshold=0.01) if NAMES[part["label"]]]
        assert [network.names[i] for i in found.label] == [NAMES[part["label"]] for part in expected]
        np.testing.assert_allclose(found.score, [part["score"] for part in expected], atol=1e-6)
        corners = np.array([list(part["box"].values()) for part in expected]).reshape(-1, 4)
        assert (np.abs(found.box_px - np.clip(corners, 0, SIDE_PX)) < 1 + 1e-4).all()  # the pipeline gives whole pixels
        total += len(expected)
    assert total > 5


@pytest.mark.parametrize("make", [tiny.mask2former, tiny.maskformer, tiny.detr_panoptic])
def test_masks_are_those_of_the_pipeline(models, make, tmp_path, monkeypatch):
    """The pipeline also gives pixels to a query that has a mask probability below 0.5 there, and hides none here."""
    folder = tmp_path / "sure"
    shutil.copytree(models(make), folder)
    tiny.scale_weights(folder, ("class_predictor", "class_labels_classifier"), 300)
    monkeypatch.setattr(view_models, "MIN_VISIBLE", 0)
    images = views()
    pipeline = tiny.transformers.pipeline("image-segmentation", model=str(folder), device="cpu")
    model, total = pretrained(folder), 0
    network = open_view_model(model, 0.7, ())
    for image, found in zip(images, network.detect(images), strict=True):
        settings = {"threshold": 0.7, "mask_threshold": 0.5, "overlap_mask_area_threshold": 0}
        parts = [part for part in pipeline(Image.fromarray(image), **settings) if NAMES[part["label"]]]
        assert found.mask.shape == (len(found.label), SIDE_PX, SIDE_PX)
        mask_logits = model.run(model.prepare(image[None])).to_tuple()
        large = [
            tiny.torch.nn.functional.interpolate(tensor, (SIDE_PX, SIDE_PX), mode="bilinear")[0]
            for tensor in mask_logits
            if isinstance(tensor, tiny.torch.Tensor) and tensor.ndim == 4 and tensor.shape[1] == 6
        ]
        probability = large[0].sigmoid().numpy()
        for mask, label, score, box in zip(found.mask, found.label, found.score, found.box_px, strict=True):
            alike = [
                np.array(part["mask"]) > 0
                for part in parts
                if abs(part["score"] - score) < 2e-6 and NAMES[part["label"]] == network.names[label]
            ]
            assert min(np.mean(mask != (part & (query >= 0.5))) for part in alike for query in probability) < 0.03
            rows, columns = np.nonzero(mask)
            assert box.tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        total += len(found.label)
    assert total > 3


def test_oneformer_gets_its_task_and_downloads_nothing(models, monkeypatch):
    """Its own processor needs torchvision to read outputs, and a file of the hub."""
    folder, images = models(tiny.oneformer), views()
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    model = pretrained(folder, takes_text=True)
    seen = []
    monkeypatch.setattr(model, "run", lambda inputs: seen.append(inputs) or PretrainedModel.run(model, inputs))
    monkeypatch.setattr(view_models, "MIN_VISIBLE", 0)
    network = open_view_model(model, 0.01, ())
    found = network.detect(images)
    assert sum(len(detections.label) for detections in found) > 3
    image_processor = tiny.transformers.OneFormerImageProcessorPil(size=tiny.SIZE)
    processor = tiny.transformers.OneFormerProcessor(image_processor=image_processor, tokenizer=tiny.clip_tokenizer())
    direct = tiny.transformers.OneFormerForUniversalSegmentation.from_pretrained(folder).eval()
    for image, inputs, detections in zip(images, seen, found, strict=True):
        expected = processor(images=[image], task_inputs=["panoptic"], return_tensors="pt")
        for name in ("pixel_values", "task_inputs"):
            np.testing.assert_array_equal(inputs[name].numpy(), expected[name].numpy())
        with tiny.torch.inference_mode():
            output = direct(**expected)
        scores = output.class_queries_logits[0].softmax(-1)
        best, label = scores.max(-1)
        for score, name in zip(detections.score, detections.label, strict=True):
            query = int((best - score).abs().argmin())
            assert best[query] == pytest.approx(score, abs=1e-6)
            assert network.names[name] == NAMES[LABELS[int(label[query])]]


class Output(dict):
    """An output of a network, with its tensors as items and attributes."""

    def __getattr__(self, name):
        return self[name]


def constructed(model, **outputs):
    """Replace the output of a model's network."""
    tensors = {name: tiny.torch.tensor(np.asarray(value, np.float32)) for name, value in outputs.items()}
    model.run = lambda inputs: Output(tensors)


def masks_at(*boxes, side_px=SIDE_PX // 4) -> np.ndarray:
    """Mask logits (n, side, side) that are 20 inside boxes of shares of the image, and -20 elsewhere."""
    masks = np.full((len(boxes), side_px, side_px), -20.0)
    for mask, (left, top, right, bottom) in zip(masks, np.array(boxes) * side_px, strict=True):
        mask[int(top) : int(bottom), int(left) : int(right)] = 20
    return masks


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (tiny.mask2former, ("class_queries_logits", "masks_queries_logits")),
        (tiny.maskformer, ("class_queries_logits", "masks_queries_logits")),
        (tiny.oneformer, ("class_queries_logits", "masks_queries_logits")),
        (tiny.detr_panoptic, ("logits", "pred_masks")),
    ],
)
def test_constructed_masks_become_objects_without_structure(models, make, names):
    model = pretrained(models(make), takes_text=make is tiny.oneformer)
    network = open_view_model(model, 0.5, ())
    # Chair, wall, window, and a query of no object.
    logits = np.full((1, 4, len(LABELS) + 1), -10.0)
    for query, label in enumerate((0, 1, 3, 5)):
        logits[0, query, label] = 10
    logits[0, 2, 3] = -9
    logits[0, 2, 5] = -10.0
    boxes = [(0, 0.5, 0.25, 1), (0.25, 0, 1, 1), (0, 0, 0.25, 0.5), (0.5, 0.5, 0.75, 0.75)]
    constructed(model, **{names[0]: logits, names[1]: masks_at(*boxes)[None]})
    (found,) = network.detect(views(1))
    # The window's probability is e / (e + 5) = 0.35.
    assert [network.names[i] for i in found.label] == ["chair"]
    np.testing.assert_allclose(found.box_px, [[0, 32, 16, 64]], atol=2)
    assert found.mask.sum() == pytest.approx(16 * 32, rel=0.1)
    assert found.score == pytest.approx([1], abs=1e-3)


def boxes_of(*boxes) -> np.ndarray:
    """Boxes as shares, centre and size (1, n, 4), from corners as shares."""
    corners = np.array(boxes, float)
    return np.hstack([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]])[None]


@pytest.mark.parametrize(("make", "softmax"), [(tiny.detr, True), (tiny.rt_detr, False)])
def test_constructed_boxes_become_objects_without_structure(models, make, softmax):
    model = pretrained(models(make))
    network = open_view_model(model, 0.3, ())
    logits = np.full((1, 3, len(LABELS) + softmax), -8.0)
    logits[0, 0, 0], logits[0, 1, 1], logits[0, 2, 4] = 2.0, 5.0, 1.0
    constructed(model, logits=logits, pred_boxes=boxes_of((0.25, 0.5, 0.5, 1.25), (0, 0, 1, 1), (0.5, 0, 1, 0.25)))
    (found,) = network.detect(views(1))
    order = np.argsort(-found.score)
    assert [network.names[found.label[i]] for i in order] == ["chair", "robot arm"]
    np.testing.assert_allclose(found.box_px[order], [[16, 32, 32, 64], [32, 0, 64, 16]], atol=1e-4)
    if softmax:
        expected = [np.exp(a) / (np.exp(a) + 5 * np.exp(-8)) for a in (2.0, 1.0)]
    else:
        expected = [1 / (1 + np.exp(-a)) for a in (2.0, 1.0)]
    np.testing.assert_allclose(found.score[order], expected, rtol=1e-5)


def test_owlv2s_boxes_are_those_of_its_processor(models):
    folder, images = models(tiny.owlv2), views()
    network = open_view_model(pretrained(folder, takes_text=True), 0.05, WORDS)
    assert network.names == WORDS
    processor = tiny.transformers.AutoProcessor.from_pretrained(folder, backend="pil")
    direct = tiny.transformers.Owlv2ForObjectDetection.from_pretrained(folder).eval()
    total = 0
    for image, found in zip(images, network.detect(images), strict=True):
        texts = [[f"a photo of a {word}" for word in WORDS]]
        inputs = processor(text=texts, images=image, padding="max_length", max_length=32, return_tensors="pt")
        with tiny.torch.inference_mode():
            output = direct(**inputs)
        (expected,) = processor.post_process_grounded_object_detection(
            output, threshold=0.05, target_sizes=[(SIDE_PX, SIDE_PX)], text_labels=[list(WORDS)]
        )
        assert [WORDS[i] for i in found.label] == expected["text_labels"]
        np.testing.assert_allclose(found.score, expected["scores"].numpy(), atol=1e-6)
        np.testing.assert_allclose(found.box_px, expected["boxes"].numpy().clip(0, SIDE_PX), atol=1e-3)
        total += len(found.label)
    assert total > 5


def test_grounding_dinos_boxes_are_those_of_its_processor(models):
    folder, images = models(tiny.grounding_dino), views(side_px=2 * SIDE_PX)
    model = pretrained(folder, takes_text=True)
    assert model.size_px == (2 * SIDE_PX, 2 * SIDE_PX)
    network = open_view_model(model, 0.01, WORDS)
    processor = tiny.transformers.AutoProcessor.from_pretrained(folder, backend="pil")
    direct = tiny.transformers.GroundingDinoForObjectDetection.from_pretrained(folder).eval()
    for image, found in zip(images, network.detect(images), strict=True):
        inputs = processor(text=[list(WORDS)], images=image, return_tensors="pt")
        with tiny.torch.inference_mode():
            output = direct(**inputs)
        (expected,) = processor.post_process_grounded_object_detection(
            output, threshold=0.01, target_sizes=[(2 * SIDE_PX, 2 * SIDE_PX)]
        )
        scores, boxes = expected["scores"].numpy(), expected["boxes"].numpy().clip(0, 2 * SIDE_PX)
        assert len(scores) == 6
        # Boxes whose best token is that of the sentence, or a full stop at its end, have no label.
        for score, box in zip(found.score, found.box_px, strict=True):
            i = np.abs(scores - score).argmin()
            assert scores[i] == pytest.approx(score, abs=1e-6)
            np.testing.assert_allclose(box, boxes[i], atol=1e-3)


def test_grounding_dinos_tokens_belong_to_their_labels(models):
    model = pretrained(models(tiny.grounding_dino), takes_text=True)
    network = open_view_model(model, 0.3, WORDS)
    # [CLS] chair . office table . plant . [SEP]
    logits = np.full((1, 5, 256), -np.inf)
    logits[0, :, :9] = -5
    for query, token in enumerate((1, 3, 4, 6, 0)):
        logits[0, query, token] = query
    constructed(model, logits=logits, pred_boxes=boxes_of(*[(0.25, 0.25, 0.5, 0.75)] * 5))
    (found,) = network.detect(views(1, 2 * SIDE_PX))
    assert [network.names[i] for i in found.label] == ["chair", "office table", "office table", "plant"]
    np.testing.assert_allclose(found.score, 1 / (1 + np.exp(-np.arange(4.0))), rtol=1e-5)
    np.testing.assert_allclose(found.box_px, [[32, 32, 64, 96]] * 4, atol=1e-4)


def test_a_long_list_of_labels_is_split_into_several_texts(tmp_path):
    folder = tiny.random_weights(lambda path: tiny.grounding_dino(path, max_text_len=6), tmp_path / "short")
    model = pretrained(folder, takes_text=True)
    network, texts = open_view_model(model, 0.3, WORDS), []

    def run(inputs):
        texts.append([tiny.WORDS[i] for i in inputs["input_ids"][0]])
        logits = np.full((1, 1, 6), -5.0)
        logits[0, 0, 1] = len(texts)
        tensors = {"logits": logits, "pred_boxes": boxes_of((0, 0, 0.5, 0.5))}
        return Output({name: tiny.torch.tensor(value) for name, value in tensors.items()})

    model.run = run
    (found,) = network.detect(views(1, 2 * SIDE_PX))
    assert texts == [
        ["[CLS]", "chair", ".", "[SEP]"],
        ["[CLS]", "office", "table", ".", "[SEP]"],
        ["[CLS]", "plant", ".", "[SEP]"],
    ]
    assert [network.names[i] for i in found.label] == list(WORDS)
    with pytest.raises(ConfigError, match="the label 'office office office office', which is too long for"):
        open_view_model(model, 0.3, ["chair", "office office office office"])
