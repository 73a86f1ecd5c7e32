"""Coloured boxes and patches, classified by a network of known answers: objects in closed form, also at the seam, at
views' borders and where the range jumps."""

from dataclasses import replace

import numpy as np
import pytest
from colour_network import COLOURS, write_card, write_network
from conformance import conforms
from salframe_segments.detector import SegmentsDetector

from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure
from salframe.framework.errors import ConfigError, InputMissing, WeightsError
from salframe.panoramas.exposure import DARK_LUMINANCE, correct_dark, mean_luminance
from salframe.panoramas.geometry import column_azimuth, equirectangular_rays, row_elevation, wrap_angle
from salframe.panoramas.images import write_color
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_image import QueryImage, change_image
from salframe.panoramas.shot import read_panorama
from salframe.panoramas.turning import turned

HEIGHT = 256
WALL_M = 4.0


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return write_network(tmp_path_factory.mktemp("network") / "colours.onnx")


@pytest.fixture(scope="module")
def detector(network):
    return build(network)


def build(network, **more) -> SegmentsDetector:
    return SegmentsDetector(configure("detector", "segments", {"model": str(network), **more}))


def scene(*patches, height=HEIGHT) -> tuple[Panorama, list[np.ndarray]]:
    """Patches (class, azimuth, elevation, width, height in degrees, range in m) before a wall, and the pixels (H, 2H)
    bool of each."""
    rgb = np.full((height, 2 * height, 3), COLOURS["wall"], np.uint8)
    range_m = np.full((height, 2 * height), WALL_M, np.float32)
    masks = []
    for name, azimuth, elevation, wide, high, away_m in patches:
        beside = np.abs(np.degrees(wrap_angle(column_azimuth(2 * height) - np.radians(azimuth)))) < wide / 2
        above = np.abs(np.degrees(row_elevation(height)) - elevation) < high / 2
        inside = above[:, None] & beside
        rgb[inside], range_m[inside] = COLOURS[name], away_m
        masks.append(inside)
    return Panorama("scene", rgb=rgb, range_m=range_m), masks


def as_it_lies(detector, panorama):
    """What is found where the views' borders fall as the panorama lies, without turning its near side to the front."""
    return SegmentsDetector.detect.__wrapped__(detector, panorama)


@pytest.mark.parametrize("azimuth", [0, 30, 45, 180, -179, 91.3])
@pytest.mark.parametrize("wide", [20, 130])  # one within a view, one that no view shows whole
def test_a_patch_comes_out_once_wherever_views_end(detector, azimuth, wide):
    panorama, (mask,) = scene(("armchair", azimuth, -5, wide, 24, 2.0))
    found = as_it_lies(detector, panorama)
    assert found.labels == ("armchair",)
    rays, area_sr = equirectangular_rays(HEIGHT)[mask], 2 * np.pi**2 / (2 * HEIGHT**2)
    weight = np.hypot(rays[:, 0], rays[:, 1])
    mean = weight @ rays
    assert found.bearing[0] @ mean / np.linalg.norm(mean) > np.cos(np.radians(0.5))
    assert found.solid_angle_sr[0] == pytest.approx(weight.sum() * area_sr, rel=0.1)
    np.testing.assert_allclose(found.centroid_m[0], 2 * rays.mean(0), atol=0.04)


def test_names_are_those_of_the_card_and_windows_are_objects(detector):
    panorama, _ = scene(("tv", 60, 0, 20, 20, 3.0), ("windowpane", -60, 5, 20, 20, 3.9))
    assert sorted(detector.detect(panorama).labels) == ["television", "window"]


@pytest.mark.parametrize(("further_m", "objects"), [(2.05, 1), (2.6, 2)])
def test_patches_of_one_class_side_by_side_are_parted_by_a_jump_in_range(detector, further_m, objects):
    panorama, _ = scene(("plant", 10, 0, 20, 24, 2.0), ("plant", -10, 0, 20, 24, further_m))
    found = detector.detect(panorama)
    assert found.labels == ("plant",) * objects
    assert sorted(np.linalg.norm(found.centroid_m, axis=1).round(1))[0] < 2.1


def test_a_window_is_not_cut_by_what_is_seen_through_it(detector):
    panorama, _ = scene(("windowpane", 10, 0, 20, 24, 3.9), ("windowpane", -10, 0, 20, 24, 8.0))
    assert detector.detect(panorama).labels == ("window",)


def test_parts_that_something_thin_cuts_are_joined_where_they_touch(detector):
    panorama, _ = scene(("armchair", 0, -10, 30, 24, 2.0), ("tv", 0, -10, 3, 30, 1.0))
    labels = detector.detect(panorama).labels  # 3 deg at 2 m are 0.1 m
    assert sorted(labels) == ["armchair", "television"]
    panorama, _ = scene(("armchair", 0, -10, 40, 24, 2.0), ("tv", 0, -10, 15, 30, 1.0))
    assert sorted(detector.detect(panorama).labels) == ["armchair", "armchair", "television"]


def test_specks_are_dropped(detector):
    panorama, _ = scene(("armchair", 0, 0, 1.5, 1.5, 2.0))
    assert len(detector.detect(panorama)) == 0


def test_colour_alone_gives_bearings(detector):
    panorama, (mask,) = scene(("armchair", 170, -20, 20, 24, 2.0))
    whole, found = detector.detect(panorama), detector.detect(replace(panorama, range_m=None))
    assert found.labels == ("armchair",)
    assert np.isnan(found.centroid_m).all()
    assert found.points_m is None
    towards = equirectangular_rays(HEIGHT)[mask].mean(0)
    assert found.bearing[0] @ towards / np.linalg.norm(towards) > np.cos(np.radians(0.5))
    np.testing.assert_allclose(found.bearing, whole.bearing, atol=2e-3)
    np.testing.assert_allclose(found.solid_angle_sr, whole.solid_angle_sr, rtol=0.02)


def test_an_object_of_unknown_range_keeps_its_bearing(detector):
    panorama, (mask, _) = scene(("tv", 0, 0, 20, 24, 2.0), ("plant", 90, 0, 20, 20, 2.0))
    range_m = np.where(mask, np.nan, panorama.range_m).astype(np.float32)
    found = detector.detect(replace(panorama, range_m=range_m))
    (i,) = [i for i, label in enumerate(found.labels) if label == "television"]
    assert np.isnan(found.centroid_m[i]).all()
    assert found.bearing[i] @ (1, 0, 0) > np.cos(np.radians(0.5))
    assert np.isfinite(found.centroid_m[1 - i]).all()


def test_a_partial_panorama_gives_what_it_shows_and_no_more(detector):
    panorama, (mask, _) = scene(("tv", 0, 0, 20, 24, 2.0), ("plant", 90, 0, 20, 20, 2.0))
    ahead = equirectangular_rays(HEIGHT)[..., 0] > 0.8
    rgb = np.where(ahead[..., None], panorama.rgb, 0).astype(np.uint8)
    found = detector.detect(replace(panorama, rgb=rgb, valid=ahead))
    assert found.labels == ("television",)
    half = ahead & (equirectangular_rays(HEIGHT)[..., 1] > 0)
    (cut_sr,) = detector.detect(replace(panorama, valid=half)).solid_angle_sr
    assert cut_sr == pytest.approx(found.solid_angle_sr[0] / 2, rel=0.1)
    assert len(detector.detect(replace(panorama, valid=np.zeros_like(ahead)))) == 0
    assert mask.any()


def test_the_black_patch_below_a_camera_is_no_object(tmp_path, monkeypatch):
    """A network for which black is a television finds none in the patch, because the file reader masks it."""
    monkeypatch.setitem(COLOURS, "tv", (0, 0, 0))
    detector = build(write_network(tmp_path / "black.onnx"), tilted_views=4)
    rgb = np.full((HEIGHT, 2 * HEIGHT, 3), COLOURS["wall"], np.uint8)
    rgb[-HEIGHT // 4 :] = 0
    write_color(tmp_path / "a.jpg", rgb)
    panorama = read_panorama(tmp_path / "a.jpg")
    assert len(detector.detect(panorama)) == 0
    assert set(detector.detect(replace(panorama, valid=None)).labels) == {"television"}


def test_a_lamp_overhead_needs_views_that_look_up(network):
    panorama, _ = scene(("tv", 0, 78, 360, 20, 2.0))
    assert len(build(network).detect(panorama)) == 0
    found = build(network, tilted_views=4).detect(panorama)
    assert found.labels == ("television",)
    np.testing.assert_allclose(found.bearing[0], (0, 0, 1), atol=0.02)


def test_the_mirrored_pass_finds_the_same_where_the_network_knows_no_side(network, detector):
    panorama, _ = scene(("armchair", 100, -5, 30, 24, 2.0), ("tv", -20, 10, 20, 10, 3.0))
    one, two = detector.detect(panorama), build(network, mirrored=True).detect(panorama)
    assert one.labels == two.labels
    np.testing.assert_allclose(one.centroid_m, two.centroid_m, atol=0.02)
    np.testing.assert_allclose(one.scores, two.scores, atol=0.02)


@pytest.mark.parametrize("columns", [1, 77, 256, 511])
def test_turning_turns_the_objects_and_nothing_else(detector, columns):
    panorama, _ = scene(("armchair", 100, -5, 30, 24, 2.0), ("tv", -20, 10, 20, 10, 3.0), ("plant", 179, 0, 9, 9, 1.0))
    one, two = detector.detect(panorama), detector.detect(turned(panorama, columns))
    assert one.labels == two.labels
    np.testing.assert_array_equal(one.scores, two.scores)
    azimuth = [np.arctan2(found.bearing[:, 1], found.bearing[:, 0]) for found in (one, two)]
    np.testing.assert_allclose(wrap_angle(azimuth[0] - azimuth[1] - np.pi * columns / HEIGHT), 0, atol=1e-9)


def test_a_score_is_the_mean_probability_brought_to_what_it_is_worth(network, tmp_path):
    own = write_network(tmp_path / "own.onnx")
    panorama, _ = scene(("armchair", 0, 0, 30, 30, 2.0))
    (raw,) = build(own).detect(panorama).scores
    write_card(own, calibration={"slope": 0.5, "offset": -1.0})
    (score,) = build(own).detect(panorama).scores
    assert np.log(score / (1 - score)) == pytest.approx(0.5 * np.log(raw / (1 - raw)) - 1)
    assert len(build(own, min_score=score + 0.001).detect(panorama)) == 0


def test_conformance(network):
    assert conforms(SegmentsDetector, configure("detector", "segments", {"model": str(network), "min_score": 0.1}))


def test_colour_is_needed(detector):
    with pytest.raises(InputMissing, match="scene has no colour image, which the detector 'segments' needs"):
        detector.detect(Panorama("scene", range_m=np.ones((8, 16), np.float32)))


def test_the_card_beside_a_file_is_part_of_its_identity(tmp_path):
    own = write_network(tmp_path / "own.onnx")
    before = identity(configure("detector", "segments", {"model": str(own)}))
    write_card(own, licence="MIT")
    assert identity(configure("detector", "segments", {"model": str(own)})) != before


def test_a_network_without_a_card_says_what_to_write(tmp_path):
    own = write_network(tmp_path / "own.onnx")
    own.with_suffix(".yaml").rename(tmp_path / "elsewhere.yaml")
    with pytest.raises(WeightsError, match=r"own\.onnx .* has no model card .*, expected .*own\.yaml: write"):
        build(own)
    assert build(own, card=str(tmp_path / "elsewhere.yaml")).detect(scene()[0]).labels == ()


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"labels": ["wall", "tv"]}, WeightsError, "returned .* 5 .channels last., expected 4 axes and 2 channels"),
        (
            {"labels": ["wall", "sofa"]},
            ConfigError,
            "the label 'sofa' is in no section, expected each label in exactly one of the sections structure, fixed "
            "and",
        ),
        (
            {"structure": ["wall", "tv"]},
            ConfigError,
            "the label 'tv' is in structure and objects, expected each label in exactly one of the sections structure",
        ),
        (
            {"output": {"name": "gone", "layout": "nchw", "values": "logits"}},
            WeightsError,
            "not an ONNX network with a",
        ),
        (
            {"output": {"layout": "nchw", "values": "logits"}},
            WeightsError,
            "has the type int64, expected class scores as floats",
        ),
        (
            {"input": {"layout": "nhwc", "size_px": [96, 96]}},
            WeightsError,
            r"has the inputs views float32 \(1, 3, 96, 96\)",
        ),
        ({"colour": 1}, ConfigError, "unknown key .*colour"),
    ],
)
def test_what_does_not_fit_the_card_is_one_line(tmp_path, changes, error, message):
    own = write_network(tmp_path / "own.onnx")
    write_card(own, **changes)
    with pytest.raises(error, match=message) as caught:
        build(own)
    assert "\n" not in str(caught.value)


def test_dark_panoramas_are_corrected_and_others_are_not(network, detector):
    uncorrected = build(network, exposure="none")
    panorama, _ = scene(("armchair", 0, 0, 60, 40, 2.0))
    np.testing.assert_array_equal(detector.classify(panorama).probability, uncorrected.classify(panorama).probability)
    dark = replace(panorama, rgb=change_image(panorama.rgb, QueryImage(exposure_ev=-3)))
    assert mean_luminance(dark.rgb) < DARK_LUMINANCE
    np.testing.assert_array_equal(
        detector.classify(dark).probability, uncorrected.classify(replace(dark, rgb=correct_dark(dark.rgb))).probability
    )
    assert (detector.classify(dark).probability != uncorrected.classify(dark).probability).any()
