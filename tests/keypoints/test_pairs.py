"""Each adapter gives what the library gives when it is used plainly."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from salframe_keypoints.localizer import PAIRS, Keypoints
from salframe_keypoints.networks import LightGlueMatcher
from salframe_keypoints.pairs import View, read_checkpoint

from salframe.framework.errors import ConfigError, WeightsMissing
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.perspective import ViewRig

SHARED_DATA = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[2] / ".." / "shared" / "data"))
DISTILLED = SHARED_DATA.parent / "weights" / "loftr_coarse_distilled.pt"
DISTILLED_CONFIG = {
    "resolution": [16, 4],
    "resnetfpn": {"initial_dim": 8, "block_dims": [8, 16, 32, 32]},
    "coarse": {"d_model": 32, "d_ffn": 32, "nhead": 1, "layer_names": ["self", "cross"] * 2},
    "fine": {"d_model": 16, "d_ffn": 16, "nhead": 1},
}
DISTILLED_SETTINGS = {"checkpoint": DISTILLED, "loftr_config": DISTILLED_CONFIG, "loftr_fine": False}


@pytest.fixture(scope="module")
def images(rooms):
    """Two overlapping perspective views of one room, taken 0.5 m apart."""
    rig = ViewRig(6, 480, 352, np.deg2rad(90))
    first, second = (rooms[0].panorama("a", pose) for pose in (np.eye(4), pose_2d(0.4, 0.3, 0.2)))
    return np.stack([rig.cut(first.rgb)[0], rig.cut(second.rgb)[0]])


def test_sift_matches_are_those_of_opencv(images, configure):
    pair = PAIRS["sift"](configure("sift"))
    query, reference = pair.extract(images)
    plain = cv2.SIFT_create(nfeatures=512)
    (points_a, a), (points_b, b) = (
        plain.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None) for image in images
    )
    kept = [
        one
        for one, two in cv2.BFMatcher(cv2.NORM_L2).knnMatch(a[:512], b[:512], k=2)
        if one.distance < 0.8 * two.distance
    ]
    assert len(kept) > 50
    expected = [(*points_a[match.queryIdx].pt, *points_b[match.trainIdx].pt) for match in kept]
    pixels, position = pair.match(query, reference)
    np.testing.assert_allclose(np.hstack([pixels, reference.points_px[position]]) - 0.5, expected, atol=1e-4)


def slow(name):
    return pytest.param(name, marks=pytest.mark.slow)


def plain_use(name, monkeypatch):
    """A detector and a matcher of kornia, loaded by kornia's own code, though from our files instead of its download."""
    from kornia import feature
    from kornia.feature import aliked, disk, lightglue, xfeat

    features, *matcher = PAIRS[name].weights[0].paths()
    for module, path in [(aliked.aliked, features), (disk.disk, features), (xfeat, features), (lightglue, *matcher)][
        : 3 + len(matcher)
    ]:
        monkeypatch.setattr(module, "load_state_dict_from_url", lambda url, path=path, **options: read_checkpoint(path))
    kind = name.split("-")[0]
    if kind == "xfeat":
        network = feature.XFeat.from_pretrained(top_k=512)
        detect = lambda image: [network.detectAndCompute(image)[0][key] for key in ("keypoints", "descriptors")]  # noqa: E731
    else:
        network = (
            feature.DISK.from_pretrained() if kind == "disk" else feature.ALIKED.from_pretrained("aliked-n16", 512, 0.0)
        )
        options = {"n": 512} if kind == "disk" else {}
        detect = lambda image: [getattr(network(image, **options)[0], key) for key in ("keypoints", "descriptors")]  # noqa: E731
    if not matcher:
        return detect, lambda one, two: feature.match_mnn(one["descriptors"][0], two["descriptors"][0])[1]
    glue = feature.LightGlue(kind).eval()
    return detect, lambda one, two: glue({"image0": one, "image1": two})["matches"][0]


@pytest.mark.parametrize("name", ["xfeat", "xfeat-nn", *map(slow, ("aliked-nn", "aliked-lightglue", "disk-lightglue"))])
def test_network_matches_are_those_of_kornia(name, images, configure, monkeypatch):
    settings = configure(name)
    import torch

    detect, match = plain_use(name, monkeypatch)
    with torch.inference_mode():
        found = [detect(torch.from_numpy(image[None]).permute(0, 3, 1, 2) / 255) for image in images]
        size = torch.tensor([[480, 352]])
        sides = [
            {"keypoints": points[None].float(), "descriptors": described[None], "image_size": size}
            for points, described in found
        ]
        expected = match(*sides).numpy()

    pair = PAIRS[name](settings)
    query, reference = pair.extract(images)
    np.testing.assert_allclose(query.points_px - 0.5, found[0][0].numpy(), atol=1e-4)
    exact = [
        View(view.points_px, described.numpy()) for view, (_, described) in zip((query, reference), found, strict=True)
    ]
    np.testing.assert_array_equal(in_order(pair.match_descriptors(*exact)), in_order(expected))
    # what is stored is float16: the same matches but for a few at the threshold
    stored, plainly = set(map(tuple, pair.match_descriptors(query, reference))), set(map(tuple, expected))
    assert len(plainly) > 100
    assert len(stored & plainly) >= 0.97 * len(stored | plainly)


def in_order(matches):
    return sorted(map(tuple, matches))


@pytest.mark.skipif(not DISTILLED.exists(), reason=f"no {DISTILLED}")
class TestLoftrCheckpoint:
    def test_a_coarse_checkpoint_matches_on_its_grid_as_kornia_does(self, images, configure):
        pair = PAIRS["loftr"](configure("loftr", **DISTILLED_SETTINGS))
        coarse = {}
        pair._model.coarse_matching.register_forward_hook(lambda module, inputs, output: coarse.update(inputs[2]))
        query, reference = pair.extract(images)
        pixels, position = pair.match(query, reference)
        assert len(position) > 20
        np.testing.assert_array_equal(reference.points_px[position], coarse["mkpts0_c"].numpy())
        np.testing.assert_array_equal(pixels, coarse["mkpts1_c"].numpy())

    def test_it_localizes(self, rooms, configure):
        localizer = Keypoints(configure("loftr", **DISTILLED_SETTINGS))
        localizer.build([room.frame(f"m{i}", np.eye(4), f"room {i}") for i, room in enumerate(rooms)])
        answer = localizer.localize(rooms[1].frame("query", pose_2d(0.4, -0.3, 2.0)))
        assert answer.status == "ok"
        assert answer.places[0].place == "room 1"
        assert np.linalg.norm(answer.T_world_query[:2, 3] - (0.4, -0.3)) < 0.15  # cells of 16 pixels, 3 deg

    @pytest.mark.parametrize("change", [{"loftr_fine": True}, {"loftr_config": {}}])
    def test_another_architecture_is_one_clear_line(self, configure, change):
        with pytest.raises(WeightsMissing, match=r"loftr_coarse_distilled\.pt does not fit LoFTR: ") as caught:
            PAIRS["loftr"](configure("loftr", **{**DISTILLED_SETTINGS, **change}))
        assert "\n" not in str(caught.value)


def test_a_file_that_is_no_loftr_checkpoint_is_one_clear_line(configure, tmp_path):
    torch = pytest.importorskip("torch")
    torch.save({"state_dict": {"other.weight": torch.zeros(1)}}, tmp_path / "other.ckpt")
    with pytest.raises(WeightsMissing, match="is no LoFTR checkpoint"):
        PAIRS["loftr"](configure("loftr", checkpoint=tmp_path / "other.ckpt"))


@pytest.mark.parametrize("name", ["xfeat", "xfeat-nn", "aliked-nn", "aliked-lightglue", "disk-lightglue"])
@pytest.mark.parametrize("content", [{"other.weight": 1.0}, {"extractor": {"other.weight": 1.0}}, 1.0])
def test_another_networks_checkpoint_is_one_clear_line(name, content, configure, tmp_path):
    torch = pytest.importorskip("torch")
    for file in PAIRS[name].weights[0].files:
        torch.save(content, tmp_path / file.name)
    with pytest.raises(WeightsMissing, match=r"(does not fit|is no) [A-Z]") as caught:
        PAIRS[name](configure(name, checkpoint=tmp_path))
    assert PAIRS[name].weights[0].files[0].name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [{"matcher.other.weight": 1.0}, 1.0])
def test_a_checkpoint_that_is_no_lightglue_is_one_clear_line(content, configure, tmp_path):
    torch = pytest.importorskip("torch")
    torch.save(content, tmp_path / "matcher.pth")
    with pytest.raises(WeightsMissing, match=r"matcher\.pth (does not fit|is no) LightGlue") as caught:
        LightGlueMatcher("aliked", tmp_path / "matcher.pth", Keypoints.Config())
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_checkpoint_is_one_clear_line(configure, tmp_path):
    pytest.importorskip("torch")
    (tmp_path / "text.ckpt").write_text("hello")
    with pytest.raises(WeightsMissing, match=r"text\.ckpt is no torch checkpoint") as caught:
        PAIRS["loftr"](configure("loftr", checkpoint=tmp_path / "text.ckpt"))
    assert "\n" not in str(caught.value)


def test_an_architecture_that_kornia_does_not_know_is_one_clear_line(configure, tmp_path):
    with pytest.raises(ConfigError, match="loftr_config is no architecture that kornia knows"):
        PAIRS["loftr"](configure("loftr", checkpoint=__file__, loftr_config={"resolution": [4, 4]}))


def test_views_without_a_point_have_no_matches(configure, images):
    for name in ("sift", "xfeat", "xfeat-nn"):
        pair = PAIRS[name](configure(name))
        empty, full = pair.extract(np.stack([np.full_like(images[0], 90), images[1]]))
        assert len(empty.points_px) == 0
        for pixels, position in (pair.match(empty, full), pair.match(full, empty)):
            assert pixels.shape == (0, 2)
            assert len(position) == 0
