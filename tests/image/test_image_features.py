from __future__ import annotations

import numpy as np
import pytest
from compass import HEIGHT, compass
from conformance import breaks, conforms, runnable
from salframe_image.localizer import ImageFeatures, peak_rad
from salframe_image.network_input import as_batch
from salframe_image.networks import EfficientNetLite0, OwnNetwork

from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure as configure_preset
from salframe.framework.components.presets import settings
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing, WeightsError
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw, wrap_angle
from salframe.panoramas.panorama import Panorama

HALL = np.array([[1, 0], [0, 1], [-1, 0]])
CELLAR = np.array([[0, 1], [1, 0], [0, -1]])  # the same colours in reverse


@pytest.fixture
def configure(same_network):
    """Returns a config of the localizer with a network whose features are the image.

    Power 1 is the mean colour of a view, with negative values set to 0.
    """

    def make(network=None, **settings) -> ImageFeatures.Config:
        chosen = {"kind": "onnx", "model": same_network, "size_px": 32, **(network or {})}
        return ImageFeatures.Config(**{"network": chosen, "power": 1.0, **settings})

    return make


@pytest.fixture
def known(configure):
    frames = [("hall", HALL, pose_2d(1, 2, 0.4, 1.5)), ("cellar", CELLAR, pose_2d(7, 2, -2, 1.5))]
    described = [reference_frame(name, compass(colours, pose), pose) for name, colours, pose in frames]
    return LocalizationMap.build(ImageFeatures(configure()), described)


def reference_frame(name, panorama, pose) -> ReferenceFrame:
    return ReferenceFrame(name, name, pose, load=lambda: panorama)


def query(panorama) -> QueryFrame:
    return QueryFrame("query", lambda: panorama)


def test_a_view_is_pooled_by_its_generalised_mean(configure):
    rgb = np.full((HEIGHT, 2 * HEIGHT, 3), (200, 150, 100), np.uint8)  # above the horizon
    rgb[HEIGHT // 2 :] = (130, 250, 100)
    received = ImageFeatures(configure(power=3.0)).describe(Panorama("two colours", rgb))["features"]
    above, below = np.maximum([[73, 23, -27], [3, 123, -27]], 0) / 128
    expected = np.cbrt((above**3 + below**3) / 2)
    assert received.dtype == np.float16
    np.testing.assert_allclose(received, np.tile(expected / np.linalg.norm(expected), (12, 1)), atol=2e-3)


def test_features_that_are_pooled_already_are_taken_as_they_are(write_network, configure):
    from onnx import helper

    pooled = write_network("pooled.onnx", [helper.make_node("ReduceMean", ["x"], ["y"], axes=[2, 3], keepdims=0)])
    received = ImageFeatures(configure({"model": pooled})).describe(compass(HALL))["features"]
    expected = mean_colours(compass(HALL))
    np.testing.assert_allclose(received, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=2e-3)


def mean_colours(panorama):
    """Return the (12, 3) mean of each 120-degree view, (grey - 127) / 128, from explicit rays."""
    focal = 16 / np.tan(np.deg2rad(60))
    x = (np.arange(32) + 0.5 - 16) / focal
    colours = []
    for view in range(12):
        azimuth = np.pi / 6 * view - np.arctan(x)
        column = ((np.pi - azimuth) * HEIGHT / np.pi - 0.5) % (2 * HEIGHT)
        low = np.floor(column).astype(int)
        row, share = panorama.rgb[0].astype(float), (column - low)[:, None]
        colours.append(((1 - share) * row[low] + share * row[(low + 1) % (2 * HEIGHT)]).mean(0))
    return (np.array(colours) - 127) / 128


@pytest.mark.parametrize("yaw_rad", [-2.9, -1.3, 0.0, 0.25, 0.4, 1.0, 3.1])
def test_place_and_heading_are_found_and_the_position_is_the_map_frames(known, yaw_rad):
    answer = known.localize(query(compass(HALL, pose_2d(1.6, 2.3, yaw_rad, 1.5))))
    assert answer.status == "ok"
    assert [place.place for place in answer.places] == ["hall", "cellar"]
    assert answer.places[0].score == pytest.approx(
        1, abs=0.06
    )  # between two views, the nearest turn is up to 15 degrees off: cos is 0.966
    np.testing.assert_array_equal(answer.T_world_query[:3, 3], [1, 2, 1.5])
    assert abs(wrap_angle(pose_yaw(answer.T_world_query) - yaw_rad)) < 0.02


def test_what_was_not_seen_does_not_count(known):
    valid = np.zeros((HEIGHT, 2 * HEIGHT), bool)
    valid[:, : HEIGHT + HEIGHT // 2] = True  # azimuth from pi to -pi / 2
    partial = compass(HALL, pose_2d(0, 0, 1.0), valid)
    features = known.localizer.describe(partial)["features"]
    azimuth = np.arange(12) * 30
    np.testing.assert_array_equal(features.any(1), (azimuth <= 180) | (azimuth >= 270))
    hidden = Panorama("other colours there", np.where(valid[..., None], partial.rgb, 255 - partial.rgb), valid=valid)
    inside = azimuth[azimuth < 120] // 30  # views that end before the invalid part begins
    np.testing.assert_array_equal(known.localizer.describe(hidden)["features"][inside], features[inside])
    answer = known.localize(query(partial))
    assert answer.places[0].place == "hall"
    assert abs(wrap_angle(pose_yaw(answer.T_world_query) - 1.0)) < 0.1


def test_where_nothing_is_seen_there_is_no_answer(known):
    nothing = compass(HALL, valid=np.zeros((HEIGHT, 2 * HEIGHT), bool))
    answer = known.localize(query(nothing))
    assert (answer.status, answer.places, answer.T_world_query) == ("no-features", (), None)


def test_without_texture_there_is_a_place_and_no_heading(known):
    plain = Panorama("plain", np.full((HEIGHT, 2 * HEIGHT, 3), (160, 130, 128), np.uint8))
    answer = known.localize(query(plain))
    assert answer.status == "no-pose"
    assert answer.T_world_query is None
    assert len(answer.places) == 2


def test_one_map_frame_is_enough(configure):
    localizer, pose = ImageFeatures(configure()), pose_2d(1, 2, 0.4)
    built = LocalizationMap.build(localizer, [reference_frame("hall", compass(HALL, pose), pose)])
    answer = built.localize(query(compass(HALL, pose_2d(0, 0, -0.8))))
    assert abs(wrap_angle(pose_yaw(answer.T_world_query) + 0.8)) < 0.02
    plain = Panorama("plain", np.full((HEIGHT, 2 * HEIGHT, 3), 160, np.uint8))
    # all views are equal
    built = LocalizationMap.build(localizer, [reference_frame("cell", plain, pose)])
    assert built.localize(query(compass(HALL))).status == "no-pose"


def test_the_parabola_meets_the_peak_between_two_angles():
    angles = np.arange(12) * np.pi / 6
    for peak in (0.0, 0.1, 0.26, 3.0, 6.2):
        assert abs(wrap_angle(peak_rad(np.cos(angles - peak)) - peak)) < 0.005
    assert peak_rad(np.array([0, 1, 3, 1, 0, 0])) == pytest.approx(2 * np.pi / 3)
    assert peak_rad(np.array([4, 1, 0, 0, 0, 4.0])) == pytest.approx(-np.pi / 6)  # half-way before the first


def test_a_panorama_without_colour_is_refused(known):
    with pytest.raises(InputMissing, match="the method 'image' needs rgb, which panorama dark does not have"):
        known.localize(query(Panorama("dark", range_m=np.ones((64, 128), np.float32))))


def test_another_networks_layout_is_one_line(write_network, configure):
    from onnx import helper

    rows = write_network("rows.onnx", [helper.make_node("ReduceMean", ["x"], ["y"], axes=[3], keepdims=0)])
    with pytest.raises(
        WeightsError,
        match=r"tensor 'y' of the network .*rows\.onnx has the shape \(12, 3, 32\); expected features of shape",
    ):
        ImageFeatures(configure({"model": rows})).describe(compass(HALL))
    large = write_network("large.onnx", [helper.make_node("Identity", ["x"], ["y"])], shape=("n", 3, 224, 224))
    with pytest.raises(
        WeightsError,
        match=r"large\.onnx has the inputs x float32 \(\*, 3, 224, 224\), expected float32 \(\*, 3, 32, 32\)",
    ):
        ImageFeatures(configure({"model": large}))
    with pytest.raises(WeightsError, match=r"same\.onnx is not an ONNX network with a tensor pool5"):
        ImageFeatures(configure({"output": "pool5"}))


def test_missing_and_damaged_weights_say_how_to_get_them(monkeypatch, tmp_path):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    with pytest.raises(
        WeightsError,
        match=r"efficientnet-lite0\.onnx is missing .*download it with: salframe weights fetch efficientnet-lite0",
    ):
        ImageFeatures()
    (tmp_path / "weights" / "resnet101").mkdir(parents=True)
    (tmp_path / "weights" / "resnet101" / "resnet101-v1-7.onnx").write_bytes(b"half of it")
    with pytest.raises(
        WeightsError, match=r"has the sha256 hash .*, expected 760702f6.*salframe weights fetch resnet101"
    ):
        ImageFeatures(ImageFeatures.Config(network="resnet101"))


def test_without_a_file_the_users_own_network_says_what_it_wants(tmp_path):
    with pytest.raises(WeightsError, match="the setting model is null, expected the path of the ONNX file") as caught:
        ImageFeatures(ImageFeatures.Config(network="onnx"))
    assert caught.value.remedy == "model=PATH"
    with pytest.raises(
        WeightsError, match=r"none\.onnx is not a file, expected the path of the ONNX file of an image network"
    ):
        ImageFeatures(ImageFeatures.Config(network={"kind": "onnx", "model": tmp_path / "none.onnx"}))


def test_the_description_is_known_by_the_networks_content_not_by_its_path(configure, same_network, tmp_path):
    copy = tmp_path / "copy.onnx"
    copy.write_bytes(same_network.read_bytes())

    def cache_key(**change):
        config = configure(**change)
        return identity(config), ImageFeatures(config).describe_identity()

    before = cache_key()
    assert cache_key(network={"model": copy}) == before
    copy.write_bytes(copy.read_bytes() + b"\x12\x04test")  # another field of the file: its producer's name
    after = cache_key(network={"model": copy})
    assert before[0] != after[0]
    assert before[1] != after[1]
    assert cache_key(power=2.0)[1] != before[1]


def test_fetched_networks_are_known_by_their_hash():
    for name, kind in (("image", EfficientNetLite0), ("image-resnet101", registry().get("image-network", "resnet101"))):
        network = identity(configure_preset("localizer", name, settings("localizer", name)))["settings"]["network"]
        assert network["weights"] == [kind.weights[0].files[0].sha256]


def test_it_keeps_the_promises_of_a_localizer(configure):
    assert conforms(ImageFeatures, configure())


def test_networks_of_ones_own_keep_the_promises_of_their_role(configure, write_network):
    from onnx import helper

    assert conforms(OwnNetwork, configure().network)
    pooled = write_network("pooled.onnx", [helper.make_node("ReduceMean", ["x"], ["y"], axes=[2, 3], keepdims=0)])
    assert conforms(OwnNetwork, configure({"model": pooled}).network)
    # of the whole batch instead of each image
    mixed = write_network("mixed.onnx", [helper.make_node("Softmax", ["x"], ["y"], axis=0)])
    breaks("embed of a single view: received features that differ by", OwnNetwork, configure({"model": mixed}).network)


def test_colours_are_shifted_and_scaled_as_declared(configure, same_network):
    views = np.random.default_rng(0).integers(0, 256, (2, 32, 32, 3)).astype(np.uint8)
    mean, std = (120.0, 110.0, 100.0), (50.0, 60.0, 70.0)
    network = OwnNetwork(configure({"mean": mean, "std": std}).network)
    np.testing.assert_allclose(network.embed(views), ((views - mean) / std).transpose(0, 3, 1, 2), atol=1e-5)
    np.testing.assert_array_equal(network.embed(views), as_batch(views, mean, std))


@pytest.mark.slow
def test_it_keeps_them_with_the_network_it_is_meant_for():
    runnable(EfficientNetLite0.Config())
    assert conforms(EfficientNetLite0)
    assert conforms(ImageFeatures)
