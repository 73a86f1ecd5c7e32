"""The detector `transformers` on each architecture: objects in painted rooms in closed form, and outputs equal to those
of the library's own pipelines on the same views."""

from __future__ import annotations

import importlib.util
import shutil
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import tiny_models as tiny
from conformance import conforms
from hub_server import COMMIT, hub
from loopback import serving
from PIL import Image
from salframe_segments import view_models
from salframe_segments.transformers_detector import TransformersDetector
from salframe_segments.view_models import class_probabilities, open_view_model, tasks
from tiny_models import COLOURS, LABELS, SIDE_PX

from salframe.framework.components.identity import identity
from salframe.framework.components.installation import fetch_weights
from salframe.framework.components.presets import configure
from salframe.framework.errors import ConfigError, InputMissing, RequirementMissing, WeightsError
from salframe.framework.pretrained import PretrainedModel
from salframe.graphs.vocabulary import vocabulary_names
from salframe.panoramas.coverage import Rig
from salframe.panoramas.geometry import column_azimuth, equirectangular_rays, row_elevation, wrap_angle
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.turning import turned

HEIGHT, WALL_M = 256, 4.0
WORDS = ("chair", "office table", "plant")
NAMES = dict(zip(LABELS, ("chair", None, "dining table", "window", "robot arm"), strict=True))
"""Name in the graph of each label; None for structure."""
SEEDS = {tiny.detr_panoptic: 3}
"""Seeds with which a network gives objects, where 0 gives none."""


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Return a function that saves a model once and returns its folder."""
    root, saved = tmp_path_factory.mktemp("models"), {}

    def folder(make):
        if make not in saved:
            saved[make] = tiny.random_weights(make, root / make.__name__, SEEDS.get(make, 0))
        return saved[make]

    return folder


@pytest.fixture(scope="module")
def semantic(models):
    return build(models(tiny.segformer))


def build(folder, **settings) -> TransformersDetector:
    return TransformersDetector(configure("detector", "transformers", {"model": str(folder), **settings}))


def scene(*patches) -> tuple[Panorama, list[np.ndarray]]:
    """Patches (class, azimuth, elevation, width, height in degrees, range in m) before a wall, and the pixels (H, 2H)
    bool of each."""
    rgb = np.full((HEIGHT, 2 * HEIGHT, 3), COLOURS["wall"], np.uint8)
    range_m = np.full((HEIGHT, 2 * HEIGHT), WALL_M, np.float32)
    masks = []
    for name, azimuth, elevation, wide, high, away_m in patches:
        beside = np.abs(np.degrees(wrap_angle(column_azimuth(2 * HEIGHT) - np.radians(azimuth)))) < wide / 2
        above = np.abs(np.degrees(row_elevation(HEIGHT)) - elevation) < high / 2
        inside = above[:, None] & beside
        rgb[inside], range_m[inside] = COLOURS[name], away_m
        masks.append(inside)
    return Panorama("scene", rgb=rgb, range_m=range_m), masks


def views(count: int = 3, side_px: int = SIDE_PX) -> np.ndarray:
    """Random images (count, side, side, 3) with structure at several scales."""
    rng = np.random.default_rng(1)
    return np.stack(
        [
            np.array(Image.fromarray(rng.integers(0, 255, (8, 8, 3), np.uint8)).resize((side_px, side_px)))
            for _ in range(count)
        ]
    )


def test_objects_of_a_painted_room_are_found_where_they_are(semantic):
    panorama, masks = scene(
        ("armchair", 100, -10, 30, 24, 2.0), ("plant", -179, 5, 20, 20, 3.0), ("windowpane", -60, 5, 24, 20, 3.9)
    )
    found = semantic.detect(panorama)
    assert sorted(found.labels) == ["armchair", "plant", "window"]
    for label, mask, away_m in zip(("armchair", "plant", "window"), masks, (2.0, 3.0, 3.9), strict=True):
        i = found.labels.index(label)
        towards = equirectangular_rays(HEIGHT)[mask].mean(0)
        assert found.bearing[i] @ towards / np.linalg.norm(towards) > np.cos(np.radians(2))
        np.testing.assert_allclose(found.centroid_m[i], away_m * towards, atol=0.12)


def test_a_score_is_the_mean_probability_of_the_class(semantic):
    panorama, _ = scene(("armchair", 0, 0, 60, 60, 2.0))
    (score,) = semantic.detect(panorama).scores
    expected = tiny.class_probability("armchair")
    assert expected > 0.9
    assert 0.93 * expected < score < expected + 1e-6  # pixels at the edge are less sure


def test_windows_are_not_split_by_what_lies_behind_them(semantic):
    panorama, _ = scene(("windowpane", 10, 0, 20, 24, 3.9), ("windowpane", -10, 0, 20, 24, 8.0))
    assert semantic.detect(panorama).labels == ("window",)
    panorama, _ = scene(("plant", 10, 0, 20, 24, 3.0), ("plant", -10, 0, 20, 24, 6.0))
    assert semantic.detect(panorama).labels == ("plant", "plant")


def test_colour_alone_gives_bearings_and_a_part_of_a_panorama_its_objects(semantic):
    panorama, _ = scene(("television", 0, 0, 24, 24, 2.0), ("plant", 120, 0, 24, 24, 2.0))
    found = semantic.detect(replace(panorama, range_m=None))
    assert sorted(found.labels) == ["plant", "television"]
    assert np.isnan(found.centroid_m).all()
    ahead = equirectangular_rays(HEIGHT)[..., 0] > 0.8
    assert semantic.detect(replace(panorama, valid=ahead)).labels == ("television",)
    with pytest.raises(InputMissing, match="the detector 'transformers' needs"):
        semantic.detect(replace(panorama, rgb=None))


def test_turning_turns_the_objects_and_nothing_else(semantic):
    panorama, _ = scene(("armchair", 100, -5, 30, 24, 2.0), ("plant", 179, 0, 20, 20, 1.5))
    one, two = semantic.detect(panorama), semantic.detect(turned(panorama, 77))
    assert one.labels == two.labels
    np.testing.assert_array_equal(one.scores, two.scores)


def test_conformance(models):
    settings = {"model": str(models(tiny.segformer)), "min_score": 0.15, "size_px": (32, 32)}
    assert conforms(TransformersDetector, configure("detector", "transformers", settings))


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


def test_boxes_in_views_become_one_object_with_a_position(models, monkeypatch):
    """Each view reports the box of a red patch that it shows, as a chair."""
    detector = build(models(tiny.detr))
    panorama, (mask,) = scene(("armchair", 130, -10, 26, 24, 2.0))

    def detect(network, batch):
        found = []
        for view in batch:
            rows, columns = np.nonzero((view[..., 0] > 128) & (view[..., 1] < 64))
            boxes = [[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]] if len(rows) > 4 else []
            box_px = np.array(boxes, float).reshape(-1, 4)
            found.append(view_models.ImageDetections(box_px, np.full(len(boxes), 0.9), np.zeros(len(boxes), int)))
        return found

    monkeypatch.setattr(view_models.ViewModel, "detect", detect)
    found = detector.detect(panorama)
    assert found.labels == ("chair",)
    assert found.scores == pytest.approx([0.9])
    np.testing.assert_allclose(found.centroid_m[0], 2 * equirectangular_rays(HEIGHT)[mask].mean(0), atol=0.12)
    ahead = equirectangular_rays(HEIGHT)[..., 0] > 0.5
    assert detector.detect(replace(panorama, valid=ahead)).labels == ()


def test_views_that_a_part_of_a_panorama_does_not_show_are_not_run(models, monkeypatch):
    detector, counts = build(models(tiny.detr)), []
    run = view_models.ViewModel.detect
    monkeypatch.setattr(
        view_models.ViewModel, "detect", lambda network, batch: counts.append(len(batch)) or run(network, batch)
    )
    panorama, _ = scene()
    detector.detect(panorama)
    ahead = equirectangular_rays(HEIGHT)[..., 0] > 0.99
    detector.detect(replace(panorama, valid=ahead))
    visible = Rig(SIDE_PX, SIDE_PX, np.pi / 2).grid(HEIGHT).visible[:, ahead.ravel()].any(1).sum()
    assert counts == [16, visible]
    assert visible < 8


def test_zero_shot_labels_are_a_list_or_the_vocabulary_and_other_networks_have_their_own(models):
    assert build(models(tiny.owlv2), labels=["chair"])._objects._model.names == ("chair",)
    assert build(models(tiny.owlv2))._objects._model.names == vocabulary_names()
    with pytest.raises(ConfigError, match="has fixed labels: set labels=null"):
        build(models(tiny.detr), labels=["chair"])
    for labels in ([], ["chair", "chair"], [" "]):
        with pytest.raises(ConfigError, match="expected one or more different labels that are not empty"):
            build(models(tiny.owlv2), labels=labels)


def test_size_px_sets_the_size_of_the_views(models):
    model = PretrainedModel(models(tiny.segformer), tasks(), "cpu", (96, 64))
    (probability,) = class_probabilities(model, np.zeros((1, 64, 96, 3), np.uint8))
    assert probability.shape[:2] == (16, 24)


def test_one_line_says_what_does_not_fit(models, tmp_path, monkeypatch):
    def refused(folder, message, error=WeightsError, **settings):
        with pytest.raises(error, match=message) as caught:
            build(folder, **settings)
        assert "\n" not in str(caught.value)

    with pytest.raises(
        WeightsError, match="the detector 'transformers' has no network: set the setting `model` to the folder"
    ):
        TransformersDetector(configure("detector", "transformers", {}))
    refused(
        tmp_path / "gone", r"gone does not exist, expected a folder with config\.json and model\.safetensors, or hf:"
    )
    refused("hf:org/model", "the model hf:org/model is not downloaded; download it with: salframe weights fetch hf:")
    folder = tmp_path / "model"
    shutil.copytree(models(tiny.segformer), folder)
    tiny.edit_config(folder, architectures=["ViTForImageClassification"])
    refused(folder, r"has the architectures \['ViTForImageClassification'\], expected an architecture for this task")
    tiny.edit_config(folder, architectures=["DetrForObjectDetection"])
    refused(
        folder,
        r"does not match the network DetrForObjectDetection|has no tensors|returned NaN in the output \w+, and its "
        "file lacks",
    )
    tiny.edit_config(folder, architectures=["SegformerForSemanticSegmentation"], decoder_hidden_size=16)
    refused(folder, r"model\.safetensors does not match the network SegformerForSemanticSegmentation: ")
    (folder / "config.json").write_text("{")
    refused(folder, "is not JSON")
    shutil.copy(models(tiny.segformer) / "config.json", folder)
    (folder / "preprocessor_config.json").unlink()
    refused(folder, "the ImageProcessor in .* is missing or invalid: ")
    (folder / "model.safetensors").rename(folder / "pytorch_model.bin")
    refused(folder, r"model\.safetensors does not exist, expected .* other formats of weights, because they can")
    message = "the setting device is 'cuda', which this machine does not have, expected one of cpu"
    if not tiny.torch.cuda.is_available():
        refused(models(tiny.segformer), message, ConfigError, device="cuda")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    message = (
        r"transformers needs the Python packages torch and transformers, which are not installed: "
        r"pip install 'salframe\[transformers\]'"
    )
    refused(models(tiny.segformer), message, RequirementMissing)


def test_a_file_without_tensors_that_the_network_uses_is_refused_and_unused_ones_may_lack(models, tmp_path):
    from safetensors.torch import load_file, save_file

    folder = tmp_path / "model"
    shutil.copytree(models(tiny.segformer), folder)
    tensors = load_file(folder / "model.safetensors")
    used = "decode_head.classifier.weight"
    kept = {name: value for name, value in tensors.items() if name != used}
    save_file(kept, folder / "model.safetensors", {"format": "pt"})
    with pytest.raises(WeightsError, match=f"returned NaN in the output logits, and its file lacks the weights {used}"):
        build(folder)


def test_code_of_a_folder_is_not_executed(models, tmp_path):
    folder = tmp_path / "model"
    shutil.copytree(models(tiny.segformer), folder)
    (folder / "own.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'w')")
    tiny.edit_config(
        folder, model_type="own", auto_map={"AutoConfig": "own.Config", "AutoModelForSemanticSegmentation": "own.Model"}
    )
    with suppress(WeightsError):
        build(folder)
    assert not (tmp_path / "executed").exists()


def test_a_model_of_the_hub_runs_under_its_name_with_the_hashes_of_its_files(models, tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    with serving(hub(models(tiny.segformer))) as endpoint:
        monkeypatch.setenv("HF_ENDPOINT", endpoint)
        paths = fetch_weights("hf:org/model")
    detector = build("hf:org/model")
    panorama, _ = scene(("plant", 0, 0, 30, 30, 2.0))
    assert detector.detect(panorama).labels == ("plant",)
    named = identity(detector.config)
    pinned = identity(configure("detector", "transformers", {"model": f"hf:org/model@{COMMIT}"}))
    assert named["weights"] == pinned["weights"]
    assert len(named["weights"]) == len(paths) == 3
    paths[0].write_text(paths[0].read_text().replace("armchair", "robot"))
    with pytest.raises(WeightsError, match=r"has the sha256 hash .*, expected"):
        build("hf:org/model")


def test_the_content_of_a_folder_is_part_of_the_identity(models, tmp_path):
    folder = tmp_path / "model"
    shutil.copytree(models(tiny.segformer), folder)
    before = identity(configure("detector", "transformers", {"model": str(folder)}))
    assert before == identity(configure("detector", "transformers", {"model": str(models(tiny.segformer))}))
    tiny.edit_config(folder, id2label={"0": "sofa"})
    assert identity(configure("detector", "transformers", {"model": str(folder)})) != before
