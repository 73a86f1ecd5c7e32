"""Each adapter returns the result of a direct call of the library."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from conformance import breaks, conforms, runnable
from salframe_keypoints.checkpoints import read_checkpoint
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.localizer import Keypoints
from salframe_keypoints.networks import LightGlue
from salframe_keypoints.sift import Sift

from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, WeightsError
from salframe.localization.map import LocalizationMap
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
DISTILLED_SETTINGS = {"checkpoint": DISTILLED, "architecture": DISTILLED_CONFIG, "fine": False}


@pytest.fixture(scope="module")
def images(rooms):
    """Return two overlapping perspective views of one room, 0.5 m apart."""
    rig = ViewRig(6, 480, 352, np.deg2rad(90))
    first, second = (rooms[0].panorama("a", pose) for pose in (np.eye(4), pose_2d(0.4, 0.3, 0.2)))
    return np.stack([rig.cut(first.rgb)[0], rig.cut(second.rgb)[0]])


def test_sift_matches_are_those_of_opencv(images, make_matcher):
    sift = make_matcher("sift")
    query, reference = sift.extract(images)
    plain = cv2.SIFT_create(nfeatures=512)
    (points_a, a), (points_b, b) = (
        plain.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None) for image in images
    )
    matches = [
        one
        for one, two in cv2.BFMatcher(cv2.NORM_L2).knnMatch(a[:512], b[:512], k=2)
        if one.distance < 0.8 * two.distance
    ]
    assert len(matches) > 50
    expected = [(*points_a[match.queryIdx].pt, *points_b[match.trainIdx].pt) for match in matches]
    pixels, position = sift.match(query, reference)
    received = np.hstack([pixels, reference.points_px[position]]) - 0.5
    # sorted, because the order of keypoints with equal response is undefined
    np.testing.assert_allclose(sorted(received.tolist()), sorted(expected), atol=1e-4)


def slow(name):
    return pytest.param(name, marks=pytest.mark.slow)


def of_name(name):
    return registry().get("feature-matcher", name)


def plain_use(name, monkeypatch):
    """Return a detector and a matcher of kornia, loaded by kornia from files instead of a download."""
    from kornia import feature
    from kornia.feature import aliked, disk, lightglue, xfeat

    features, *matcher = of_name(name).weights[0].paths()
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
def test_network_matches_are_those_of_kornia(name, images, make_matcher, monkeypatch):
    matcher = make_matcher(name)
    import torch

    detect, match = plain_use(name, monkeypatch)
    with torch.inference_mode():
        detections = [detect(torch.from_numpy(image[None]).permute(0, 3, 1, 2) / 255) for image in images]
        size = torch.tensor([[480, 352]])
        sides = [
            {"keypoints": points[None].float(), "descriptors": described[None], "image_size": size}
            for points, described in detections
        ]
        expected = match(*sides).numpy()

    stored = matcher.extract(images)
    # Compared as sets, because the order of sums, and so of points with nearly equal scores, depends on the machine.
    for view, (points, _) in zip(stored, detections, strict=True):
        assert share_alike(in_tenths(view.points_px - 0.5), in_tenths(points.numpy())) > 0.99
    exact = [
        ViewFeatures(points.numpy().astype(np.float32) + np.float32(0.5), described.numpy())
        for points, described in detections
    ]
    plainly = ends_px(*exact, expected)
    assert len(plainly) > 100
    assert share_alike(ends_px(*exact, matcher.match_descriptors(*exact)), plainly) > 0.99
    # descriptors are stored as float16, which changes a few matches at the threshold
    assert share_alike(ends_px(*stored, matcher.match_descriptors(*stored)), plainly) >= 0.97


def in_tenths(points):
    """Return points or pairs of points as a set, to a tenth of a pixel."""
    return set(map(tuple, np.round(np.asarray(points, np.float64), 1).tolist()))


def ends_px(query, reference, matches):
    """Return the ends of matches as a set, to a tenth of a pixel."""
    return in_tenths(np.hstack([query.points_px[matches[:, 0]], reference.points_px[matches[:, 1]]]))


def share_alike(one, other):
    """Return the intersection of two sets over their union."""
    return len(one & other) / len(one | other)


@pytest.mark.skipif(not DISTILLED.exists(), reason=f"no {DISTILLED}")
class TestLoftrCheckpoint:
    def test_a_coarse_checkpoint_matches_on_its_grid_as_kornia_does(self, images, make_matcher):
        matcher = make_matcher("loftr", **DISTILLED_SETTINGS)
        coarse = {}
        matcher._model.coarse_matching.register_forward_hook(lambda module, inputs, output: coarse.update(inputs[2]))
        query, reference = matcher.extract(images)
        pixels, position = matcher.match(query, reference)
        assert len(position) > 20
        np.testing.assert_array_equal(reference.points_px[position], coarse["mkpts0_c"].numpy())
        np.testing.assert_array_equal(pixels, coarse["mkpts1_c"].numpy())

    def test_it_localizes(self, rooms, configure):
        localizer = Keypoints(configure("loftr", DISTILLED_SETTINGS))
        built = LocalizationMap.build(
            localizer, [room.reference_frame(f"m{i}", np.eye(4), f"room {i}") for i, room in enumerate(rooms)]
        )
        answer = built.localize(rooms[1].query(pose_2d(0.4, -0.3, 2.0)))
        assert answer.status == "ok"
        assert answer.places[0].place == "room 1"
        assert np.linalg.norm(answer.T_world_query[:2, 3] - (0.4, -0.3)) < 0.15  # cells of 16 pixels, 3 deg

    @pytest.mark.parametrize("change", [{"fine": True}, {"architecture": {}}])
    def test_another_architecture_is_one_clear_line(self, make_matcher, change):
        with pytest.raises(
            WeightsError, match=r"loftr_coarse_distilled\.pt does not match the network LoFTR: "
        ) as caught:
            make_matcher("loftr", **{**DISTILLED_SETTINGS, **change})
        assert "\n" not in str(caught.value)


def test_a_file_that_is_no_loftr_checkpoint_is_one_clear_line(make_matcher, tmp_path):
    torch = pytest.importorskip("torch")
    torch.save({"state_dict": {"other.weight": torch.zeros(1)}}, tmp_path / "other.ckpt")
    with pytest.raises(WeightsError, match="is not a LoFTR checkpoint"):
        make_matcher("loftr", checkpoint=tmp_path / "other.ckpt")


@pytest.mark.parametrize("name", ["xfeat", "xfeat-nn", "aliked-nn", "aliked-lightglue", "disk-lightglue"])
@pytest.mark.parametrize("content", [{"other.weight": 1.0}, {"extractor": {"other.weight": 1.0}}, 1.0])
def test_another_networks_checkpoint_is_one_clear_line(name, content, make_matcher, tmp_path):
    torch = pytest.importorskip("torch")
    for file in of_name(name).weights[0].files:
        torch.save(content, tmp_path / file.name)
    with pytest.raises(WeightsError, match=r"(does not match the network|is not a) [A-Z]") as caught:
        make_matcher(name, checkpoint=tmp_path)
    assert of_name(name).weights[0].files[0].name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [{"matcher.other.weight": 1.0}, 1.0])
def test_a_checkpoint_that_is_no_lightglue_is_one_clear_line(content, tmp_path):
    torch = pytest.importorskip("torch")
    pytest.importorskip("kornia")
    torch.save(content, tmp_path / "matcher.pth")
    with pytest.raises(WeightsError, match=r"matcher\.pth (does not match the network|is not a) LightGlue") as caught:
        LightGlue("aliked", tmp_path / "matcher.pth")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_checkpoint_is_one_clear_line(make_matcher, tmp_path):
    pytest.importorskip("torch")
    (tmp_path / "text.ckpt").write_text("hello")
    with pytest.raises(WeightsError, match=r"text\.ckpt is not a torch checkpoint") as caught:
        make_matcher("loftr", checkpoint=tmp_path / "text.ckpt")
    assert "\n" not in str(caught.value)


def test_an_architecture_that_kornia_does_not_know_is_one_clear_line(make_matcher):
    with pytest.raises(ConfigError, match="kornia does not support the LoFTR architecture"):
        make_matcher("loftr", checkpoint=__file__, architecture={"resolution": [4, 4]})


def test_views_without_a_point_have_no_matches(make_matcher, images):
    for name in ("sift", "xfeat", "xfeat-nn"):
        matcher = make_matcher(name)
        empty, full = matcher.extract(np.stack([np.full_like(images[0], 90), images[1]]))
        assert len(empty.points_px) == 0
        for pixels, position in (matcher.match(empty, full), matcher.match(full, empty)):
            assert pixels.shape == (0, 2)
            assert len(position) == 0


@pytest.mark.parametrize(
    "name",
    ["sift", "loftr-compact", "xfeat", "xfeat-nn", *map(slow, ("aliked-nn", "aliked-lightglue", "disk-lightglue"))],
)
def test_it_keeps_the_promises_of_the_role(name):
    runnable(of_name(name).Config())
    assert conforms(of_name(name))


class Doubling(Sift):
    """Broken."""

    name = "broken"

    def match_descriptors(self, query, reference):
        return super().match_descriptors(query, reference) * 2


class Shifting(Sift):
    """Broken."""

    name = "broken"

    def match(self, query, reference):
        pixels, positions = super().match(query, reference)
        return pixels + 2, positions


class Beyond(Sift):
    """Broken."""

    name = "broken"

    def extract(self, images):
        return [ViewFeatures(view.points_px * 2, view.features) for view in super().extract(images)]


class Raw(Sift):
    """Broken."""

    name = "broken"

    def describe(self, view):
        return view.features.astype(np.float32)


class Unprepared(Sift):
    """Broken."""

    name = "broken"

    def extract(self, images):
        if images.shape[2] % 8:
            raise ValueError("no such views")
        return super().extract(images)


@pytest.mark.parametrize(
    ("component", "message"),
    [
        (Doubling, r"match of a view with itself: received IndexError: "),
        (
            Shifting,
            r"match of views with themselves: received 0% of the matches within 1 px of the .*, expected at least 90%",
        ),
        (Beyond, r"extract of a bedroom: received a point outside its image, expected points within 256 x 192 pixels"),
        (Raw, r"describe: received rows of length \[.*expected rows of unit length or zeros"),
        (Unprepared, r"views of 333 x 111 pixels, which prepare did not reject: received ValueError: no such views"),
    ],
)
def test_a_broken_matcher_is_told_in_one_line(component, message):
    breaks(message, component)
