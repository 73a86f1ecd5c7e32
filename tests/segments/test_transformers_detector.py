"""The detector `transformers`: objects in painted rooms in closed form, settings, and files that do not fit."""

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
from salframe_segments import view_models
from salframe_segments.transformers_detector import TransformersDetector
from salframe_segments.view_models import class_probabilities, tasks
from tiny_models import COLOURS, SIDE_PX

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
    refused(folder, r"has the architectures \['ViTForImageClassification'\], expected one of those")
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
