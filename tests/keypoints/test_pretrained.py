"""Matchers with networks of `transformers`: the real architectures with random weights, compared with direct calls of
the library."""

from __future__ import annotations

import importlib.util
import shutil

import cv2
import numpy as np
import pytest
from conformance import conforms
from salframe_keypoints.efficient_loftr import align_match_columns
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.localizer import Keypoints
from salframe_keypoints.superpoint import SuperPointNearest

from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, RequirementMissing, WeightsError
from salframe.framework.files.cache import Cache
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig

NAMES = ("superpoint-nn", "superpoint-superglue", "efficient-loftr")
SIZE_PX = 256, 160


@pytest.fixture(scope="module")
def checkpoints(tmp_path_factory):
    """A folder per matcher with a model saved by the library."""
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    torch.set_num_threads(1)
    torch.manual_seed(0)
    transformers.utils.logging.disable_progress_bar()
    models = {
        "superpoint-nn": transformers.SuperPointForKeypointDetection(transformers.SuperPointConfig()),
        "superpoint-superglue": transformers.SuperGlueForKeypointMatching(
            transformers.SuperGlueConfig(gnn_layers_types=["self", "cross"])
        ),
        "efficient-loftr": transformers.EfficientLoFTRForKeypointMatching(
            transformers.EfficientLoFTRConfig(stage_num_blocks=[1, 1, 1, 1])
        ),
    }
    root = tmp_path_factory.mktemp("checkpoints")
    for name, model in models.items():
        for module in model.modules():  # the small random weights of the library give all points the same descriptor
            if isinstance(module, (torch.nn.Conv2d, torch.nn.Linear)):
                torch.nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
        model.save_pretrained(root / name)
    return root


@pytest.fixture(scope="module")
def images(rooms):
    """Return two overlapping grey views of one room, 0.5 m apart."""
    rig = ViewRig(6, 256, 160, np.deg2rad(90))
    views = [rig.cut(rooms[0].panorama("p", pose, 256).rgb)[0] for pose in (np.eye(4), pose_2d(0.4, 0.3, 0.2))]
    return np.stack([cv2.cvtColor(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB) for view in views])


@pytest.fixture(scope="module")
def make(checkpoints, make_matcher):
    return lambda name, **settings: make_matcher(name, SIZE_PX, checkpoint=checkpoints / name, **settings)


def plain_input(images):
    """Return a pair of images as the processors of the library pass it to a model, at the size of the images."""
    import torch

    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float() / 255


def test_superpoint_is_the_librarys(checkpoints, images, make):
    import torch
    from transformers import SuperPointForKeypointDetection

    model = SuperPointForKeypointDetection.from_pretrained(checkpoints / "superpoint-nn", max_keypoints=200).eval()
    with torch.inference_mode():
        output = model(plain_input(images[:1]))
    (view,) = make("superpoint-nn", max_keypoints=200).extract(images[:1])
    assert len(view.points_px) == 200
    expected_px, descriptors = output.keypoints[0].numpy() * SIZE_PX, output.descriptors[0].numpy()
    # The order of points with equal scores is undefined, and so is the selection among those with the lowest score.
    off_px = np.linalg.norm(expected_px[:, None] - (view.points_px - 0.5), axis=2)
    known, partner = off_px.min(1) < 1e-3, off_px.argmin(1)
    last = output.scores[0].numpy().min()
    assert (output.scores[0].numpy()[~known] <= last + 1e-6).all()
    assert len(set(partner[known].tolist())) == known.sum() > 150
    np.testing.assert_allclose(view.features[partner[known]], descriptors[known], atol=1e-3)


def test_superglue_matches_are_the_librarys(checkpoints, images, make):
    import torch
    from transformers import SuperGlueForKeypointMatching
    from transformers.models.superglue.image_processing_pil_superglue import SuperGlueImageProcessorPil

    model = SuperGlueForKeypointMatching.from_pretrained(checkpoints / "superpoint-superglue").eval()
    model.keypoint_detector.keypoint_decoder.max_keypoints = 100
    with torch.inference_mode():
        output = model(plain_input(images)[None])
    plain = SuperGlueImageProcessorPil().post_process_keypoint_matching(output, [[(160, 256)] * 2])[0]
    expected = np.hstack([plain["keypoints0"].numpy(), plain["keypoints1"].numpy()])

    matcher = make("superpoint-superglue", max_keypoints=100)
    query, reference = matcher.extract(images)
    pixels, position = matcher.match(query, reference)
    received = np.hstack([pixels, reference.points_px[position]]) - 0.5
    assert len(expected) > 20
    # the library truncates its pixels to integers after a conversion to fractions of the image size, so they are up to
    # 1 px smaller
    offset = received[:, None] - expected[None]
    same = ((offset > -0.01) & (offset < 1.01)).all(2)
    # features are stored as float16, which changes some ambiguous matches of the random network
    assert same.any(1).mean() > 0.9
    assert same.any(0).mean() > 0.9


def test_superglue_gives_the_same_matches_twice_and_none_without_points(images, make):
    matcher = make("superpoint-superglue", max_keypoints=50)
    query, reference = matcher.extract(images)
    twice = [matcher.match_descriptors(query, reference) for _ in range(2)]
    np.testing.assert_array_equal(*twice)
    few = ViewFeatures(reference.points_px[:7], reference.features[:7])
    matches = matcher.match_descriptors(query, few)
    assert matches[:, 1].max(initial=0) < 7
    assert matcher.match_descriptors(few, query).shape[1] == 2
    none = ViewFeatures(np.zeros((0, 2), np.float32), np.zeros((0, 257), np.float16))
    assert matcher.match_descriptors(query, none).shape == matcher.match_descriptors(none, query).shape == (0, 2)
    assert matcher.describe(query).shape == (50, 256)


def test_efficient_loftr_refines_matches_as_the_library_does(checkpoints, images, make, monkeypatch):
    import torch
    from transformers import EfficientLoFTRForKeypointMatching

    # Every cell matches the cell at the same position, so the order of the library is right.
    scores = 0.9 * torch.eye(20 * 32).view(1, 20, 32, 20, 32)
    find = EfficientLoFTRForKeypointMatching._get_matches_from_scores
    monkeypatch.setattr(
        EfficientLoFTRForKeypointMatching, "_get_matches_from_scores", lambda model, _: find(model, scores)
    )

    matcher = make("efficient-loftr")
    query, reference = matcher.extract(images)
    decoded = np.stack([cv2.imdecode(view.features, cv2.IMREAD_GRAYSCALE) for view in (query, reference)])
    model = EfficientLoFTRForKeypointMatching.from_pretrained(checkpoints / "efficient-loftr").eval()
    with torch.inference_mode():
        output = model(torch.from_numpy(decoded)[None, :, None].float() / 255)
    expected = output.keypoints[0][:, output.matches[0, 0] >= 0].numpy() * (256, 160) + 0.5
    inside = ((expected > 0) & (expected < (256, 160))).all((0, 2))
    query_px, reference_px = expected[:, inside]
    pixels, position = matcher.match(query, reference)
    assert len(pixels) == len(query_px) > 300
    on_grid = reference.points_px[position]
    assert np.abs(on_grid - reference_px).max() <= 1.001
    np.testing.assert_allclose(pixels - query_px, on_grid - reference_px, atol=1e-3)


def test_efficient_loftrs_cells_are_matched_one_to_one_whatever_their_order():
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    model = transformers.EfficientLoFTRForKeypointMatching(
        transformers.EfficientLoFTRConfig(stage_num_blocks=[1, 1, 1, 1])
    )
    partner = torch.from_numpy(np.random.default_rng(0).permutation(144))
    scores = torch.zeros(144, 144)
    scores[torch.arange(144), partner] = 0.9
    cells, confidence = align_match_columns(model._get_matches_from_scores)(scores.view(1, 12, 12, 12, 12))
    first, second = cells[0]
    matched = first >= 0
    assert matched.sum() > 20
    assert (partner[first[matched]] == second[matched]).all()
    assert ((second >= 0) == matched).all()
    assert (confidence[0, :, matched] == 0.9).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_localizer_of_the_matcher_builds_and_answers(name, checkpoints, configure, rooms, tmp_path):
    small = {"views": 3, "view_width_px": 128, "view_height_px": 96, "hypotheses": 20}
    localizer = Keypoints(configure(name, {"checkpoint": checkpoints / name, "max_keypoints": 32}, **small))
    built = LocalizationMap.build(
        localizer, [rooms[0].reference_frame("m", np.eye(4), "room 0", height=64)], Cache(tmp_path), "rooms"
    )
    blank = Panorama("blank", np.full((64, 128, 3), 90, np.uint8))
    for query in (rooms[0].query(np.eye(4), height=64), QueryFrame("blank", lambda: blank)):
        answer = built.localize(query)
        assert answer.status in ("ok", "no-pose", "no-features")  # random weights match at random
        assert answer.status == "no-features" or [place.place for place in answer.places] == ["room 0"]


@pytest.mark.parametrize("name", NAMES)
def test_a_checkpoint_that_is_not_given_is_told_with_its_address_and_licence(name):
    pytest.importorskip("torch")
    pytest.importorskip("transformers")
    with pytest.raises(
        WeightsError,
        match=r"set checkpoint to a folder with config\.json and model\.safetensors of https://huggingface\S+ \(",
    ):
        Keypoints.check(Keypoints.Config(features=name))


def test_what_is_not_installed_is_told_with_its_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        RequirementMissing,
        match=r"needs the Python packages torch and transformers, which are not installed: "
        r"pip install 'salframe\[transformers\]'",
    ):
        Keypoints.check(Keypoints.Config(features="superpoint-nn"))


def test_another_model_a_damaged_file_and_another_architecture_are_one_clear_line(checkpoints, tmp_path, make):
    def refused(match):
        with pytest.raises(WeightsError, match=match) as caught:
            SuperPointNearest(SuperPointNearest.Config(checkpoint=tmp_path / "model"))
        assert "\n" not in str(caught.value)

    refused(r"config\.json does not exist, expected a folder with")
    shutil.copytree(checkpoints / "superpoint-superglue", tmp_path / "model")
    refused("has the model_type 'superglue', expected 'superpoint'")
    shutil.copy(checkpoints / "superpoint-nn" / "config.json", tmp_path / "model")
    refused("model.safetensors does not match the network SuperPointForKeypointDetection: ")
    (tmp_path / "model" / "model.safetensors").write_bytes(b"hello")
    refused("model.safetensors does not match the network SuperPointForKeypointDetection: ")
    (tmp_path / "model" / "config.json").write_text("{")
    refused("is not JSON")


def test_views_that_efficient_loftr_cannot_take_are_refused(checkpoints, configure):
    config = configure("efficient-loftr", {"checkpoint": checkpoints / "efficient-loftr"}, view_width_px=240)
    with pytest.raises(
        ConfigError, match="are 240 and 352, expected multiples of 32 for the feature matcher 'efficient-loftr'"
    ):
        Keypoints(config)


@pytest.mark.parametrize("name", ["superpoint-nn", "superpoint-superglue"])
def test_it_keeps_the_promises_of_the_role(name, checkpoints):
    component = registry().get("feature-matcher", name)
    assert conforms(component, component.Config(checkpoint=checkpoints / name, max_keypoints=100))
