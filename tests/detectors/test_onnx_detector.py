"""Coloured patches found by a network of known answers: positions in closed form, also at the seam, the poles and
views' borders."""

from dataclasses import replace

import numpy as np
import pytest
from conformance import conforms
from salframe_detectors.detector import OnnxDetector
from salframe_detectors.zoo import COCO_80, ZOO
from tiny_network import COLOURS, settings, write_network

from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, InputMissing, UnknownName, WeightsError
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import (
    column_azimuth,
    equirectangular_rays,
    pose_2d,
    row_elevation,
    transform_points,
    wrap_angle,
)
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.turning import turned

HEIGHT = 256
WALL_M = 4.0


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return write_network(tmp_path_factory.mktemp("network") / "colours.onnx")


@pytest.fixture(scope="module")
def detector(network):
    return build(network)


def build(network, **more) -> OnnxDetector:
    return OnnxDetector(configure("detector", "onnx", settings(network, **more)))


def scene(*patches, height=HEIGHT) -> tuple[Panorama, list[np.ndarray]]:
    """Patches (colour, azimuth, elevation, width, height in degrees, range in m) before a grey wall, and the points (n,
    3) of each."""
    rgb = np.full((height, 2 * height, 3), 90, np.uint8)
    range_m = np.full((height, 2 * height), WALL_M, np.float32)
    points = []
    for colour, azimuth, elevation, wide, high, away_m in patches:
        beside = np.abs(np.degrees(wrap_angle(column_azimuth(2 * height) - np.radians(azimuth)))) < wide / 2
        above = np.abs(np.degrees(row_elevation(height)) - elevation) < high / 2
        inside = above[:, None] & beside
        rgb[inside], range_m[inside] = COLOURS[colour], away_m
        points.append(equirectangular_rays(height)[inside] * np.float32(away_m))
    return Panorama("scene", rgb=rgb, range_m=range_m), points


def as_it_lies(detector, panorama):
    """What is found where the views' borders fall as the panorama lies, without turning its near side to the front."""
    return OnnxDetector.detect.__wrapped__(detector, panorama)


@pytest.mark.parametrize(
    ("where", "patch"),
    [
        ("in the middle of a view", ("red", 0, 0, 20, 16, 2.0)),
        ("at the border of two views", ("red", 45, 0, 30, 20, 2.0)),
        ("on the seam", ("red", 180, -10, 24, 16, 2.5)),
        ("between the rings", ("red", 100, 38, 20, 20, 2.0)),
        ("on the seam between the rings", ("red", -179, -40, 20, 20, 1.5)),
        ("above", ("red", 0, 90, 360, 30, 1.5)),
        ("below", ("red", 0, -90, 360, 40, 1.2)),
        ("wider than any view", ("red", 20, -5, 150, 30, 2.0)),
        ("all around", ("red", 0, 0, 360, 20, 2.0)),
        ("higher than any view", ("red", 70, 0, 20, 130, 2.0)),
    ],
)
def test_an_object_comes_out_once_wherever_it_is(detector, where, patch):
    panorama, (points,) = scene(patch)
    found = as_it_lies(detector, panorama)
    assert found.labels == ("red",)
    assert found.scores == pytest.approx([1])
    # Ranges apart, an outline is off by the views' pixels, of 0.7 deg at most here, at its sides.
    assert found.centroid_m[0] == pytest.approx(points.mean(0), abs=0.05)
    assert np.linalg.norm(found.points_m[0], axis=1) == pytest.approx(patch[-1])
    assert len(found.points_m[0]) > 0.85 * len(points)


@pytest.mark.parametrize(("wide", "high"), [(14, 14), (25, 25), (20, 40), (40, 20)])
def test_slivers_at_the_borders_of_views_are_no_objects(detector, wide, high):
    for elevation in range(-63, 64, 14):
        for azimuth in range(0, 46, 5):  # the views repeat every 90 degrees and are mirrored about 45
            panorama, _ = scene(("red", azimuth, elevation, wide, high, 2.0))
            assert as_it_lies(detector, panorama).labels == ("red",), (azimuth, elevation)


def test_a_position_is_the_objects_and_not_the_walls(detector):
    panorama, (points,) = scene(("green", 33, -20, 26, 30, 1.8))
    found = detector.detect(panorama)
    assert found.centroid_m[0] == pytest.approx(points.mean(0), abs=0.02)
    assert found.size_m[0, 2] == pytest.approx(np.ptp(points[:, 2]), abs=0.05)


def test_equal_objects_stay_apart_and_other_classes_too(detector):
    panorama, _ = scene(
        ("red", 0, 0, 14, 14, 2.0),
        ("red", 120, 0, 14, 14, 3.0),
        ("red", -130, -10, 14, 14, 2.0),
        ("blue", 12, 5, 10, 10, 2.0),
    )
    found = detector.detect(panorama)
    azimuth_deg = np.degrees(np.arctan2(found.centroid_m[:, 1], found.centroid_m[:, 0]))
    order = np.lexsort((azimuth_deg, found.labels))
    assert [found.labels[i] for i in order] == ["blue", "red", "red", "red"]
    assert azimuth_deg[order] == pytest.approx([12, -130, 0, 120], abs=0.7)


@pytest.mark.parametrize("columns", [1, 37, HEIGHT // 2, HEIGHT, 311])
def test_a_turned_panorama_has_the_same_objects_turned(detector, columns):
    panorama, _ = scene(("red", 40, -10, 25, 20, 2.0), ("green", 178, 5, 16, 30, 2.0), ("blue", -70, 45, 20, 20, 2.0))
    before = detector.detect(panorama)
    assert before.labels == ("red", "green", "blue")
    for given in (panorama, replace(panorama, range_m=None)):
        assert detector.detect(turned(given, columns)).labels == before.labels
    after = detector.detect(turned(panorama, columns))
    turned_m = transform_points(pose_2d(0, 0, -np.pi * columns / HEIGHT), before.centroid_m)
    np.testing.assert_allclose(after.centroid_m, turned_m, atol=1e-5)


def test_fine_panoramas_are_thinned(detector):
    fine, (points,) = scene(("red", 61, -12, 26, 30, 1.8), height=768)
    assert detector.detect(fine).centroid_m[0] == pytest.approx(points.mean(0), abs=0.03)


@pytest.mark.parametrize("batch", [1, 4])
def test_networks_that_take_one_view_at_a_time_answer_the_same(network, detector, tmp_path, batch):
    panorama, _ = scene(("red", 45, 0, 30, 20, 2.0), ("blue", 170, 0, 30, 20, 2.0))
    other = build(write_network(tmp_path / "one.onnx", batch=batch)) if batch == 1 else build(network)
    assert other.detect(panorama).centroid_m.tolist() == detector.detect(panorama).centroid_m.tolist()


def test_colours_are_ordered_and_scaled_as_declared(network, tmp_path):
    panorama, _ = scene(("red", 0, 0, 20, 20, 2.0))
    assert build(network, channels="bgr").detect(panorama).labels == ("blue",)
    # (255 * scale - mean) / std gives the network 0 to 255 again.
    shifted = build(network, scale=1 / 255, mean=[0.5, 0.5, 0.5], std=[1 / 255, 1 / 255, 1 / 255])
    assert shifted.detect(panorama).labels == ()
    assert build(network, scale=1 / 255, std=[1 / 255, 1 / 255, 1 / 255]).detect(panorama).labels == ("red",)


def test_what_was_not_seen_is_filled(detector):
    panorama, _ = scene(("red", 0, 0, 20, 20, 2.0), ("green", 150, 0, 20, 20, 2.0))
    seen = np.broadcast_to(np.abs(column_azimuth(2 * HEIGHT)) < 1.0, (HEIGHT, 2 * HEIGHT))
    assert detector.detect(replace(panorama, valid=seen)).labels == ("red",)


def test_an_object_in_a_hole_of_the_range_has_a_label_and_no_position(detector):
    panorama, _ = scene(("red", 0, 0, 20, 20, np.nan), ("green", 150, 0, 20, 20, 2.0))
    # What is left of the wall in the corners of the red box is no red object.
    hole = np.where(panorama.rgb[..., 0] == 255, np.nan, panorama.range_m)
    hole[100:156, 220:292] = np.nan
    found = detector.detect(replace(panorama, range_m=hole.astype(np.float32)))
    assert found.labels == ("red", "green")
    assert np.isnan(found.centroid_m[0]).all()
    assert np.isfinite(found.centroid_m[1]).all()
    share = registry().get("saliency", "volumetric")().score(found)
    assert share.tolist() == [0, 1]


def localizer(name: str, network) -> Localizer:
    config = configure("localizer", name, {"kind": name, "detector": {"kind": "onnx", **settings(network)}})
    return registry().build("localizer", config)


def test_without_range_labels_and_bearings_are_known(network, detector):
    """`objects` works from colour alone; a graph of bearings can be asked of a map, whose own frames say what they
    lack."""
    kitchen, lounge = (
        replace(scene(*patches)[0], range_m=None)
        for patches in (
            [("red", 0, 0, 20, 20, 2.0), ("green", 90, 0, 20, 20, 2.0)],
            [("blue", 0, 0, 20, 20, 2.0), ("green", 90, 0, 20, 20, 2.0)],
        )
    )
    found = detector.detect(kitchen)
    assert found.labels == ("red", "green")
    assert np.isnan(found.centroid_m).all()
    assert found.points_m is None
    np.testing.assert_allclose(found.bearing, [(1, 0, 0), (0, 1, 0)], atol=0.02)
    side = 2 * np.sin(np.radians(10)) * np.radians(20)  # of 20 by 20 degrees about the horizon
    np.testing.assert_allclose(found.solid_angle_sr, side, rtol=0.25)  # the grid's pixels are 0.7 degrees
    share = registry().get("saliency", "volumetric")().score(found)
    np.testing.assert_allclose(share, found.solid_angle_sr / found.solid_angle_sr.sum())
    objects = localizer("objects", network)
    built = LocalizationMap.build(
        objects,
        [
            ReferenceFrame(name, name, np.eye(4), load=lambda seen=seen: seen)
            for name, seen in (("kitchen", kitchen), ("lounge", lounge))
        ],
    )
    assert built.localize(QueryFrame("query", lambda: turned(lounge, 100))).places[0].place == "lounge"
    frames = [ReferenceFrame("kitchen", "kitchen", np.eye(4), load=lambda: kitchen)]
    with pytest.raises(
        InputMissing, match=r"kitchen cannot be a reference frame: the panorama has no range image, .* 'objects'"
    ):
        LocalizationMap.build(localizer("saliency-graph", network), frames)


def test_without_range_a_graph_is_localized_in_a_map_with_range(network):
    patches = ("red", -60, 0, 20, 20, 2.0), ("green", 90, 0, 20, 20, 2.5), ("blue", 170, 0, 20, 20, 1.5)
    graphs = localizer("saliency-graph", network)
    built = LocalizationMap.build(
        graphs, [ReferenceFrame("kitchen", "kitchen", np.eye(4), load=lambda: scene(*patches)[0])]
    )
    seen = replace(turned(scene(*patches)[0], 100), range_m=None)
    answer = built.localize(QueryFrame("query", lambda: seen))
    assert answer.places[0].place == "kitchen"
    assert answer.heading_rad == pytest.approx(np.pi * 100 / HEIGHT, abs=np.radians(5))


def test_without_colour_it_says_so(detector):
    with pytest.raises(InputMissing, match="scene has no colour image"):
        detector.detect(replace(scene()[0], rgb=None))


def test_it_conforms(tmp_path):
    """On the suite's rooms, whose patches of grey and colour it takes for a class each: whatever it finds turns with
    the panorama."""
    network = write_network(tmp_path / "lenient.onnx", side_px=64, near=125.0)
    assert conforms(OnnxDetector, configure("detector", "onnx", settings(network)))


def test_a_network_of_any_size_is_given_the_declared_one(tmp_path):
    anything = write_network(tmp_path / "any.onnx", side_px=None)
    panorama, (points,) = scene(("red", 20, 0, 20, 20, 2.0))
    assert build(anything, size_px=(128, 128)).detect(panorama).centroid_m[0] == pytest.approx(points.mean(0), abs=0.02)
    with pytest.raises(ConfigError, match=r"any.onnx has no fixed input size: set size_px .* \[640, 640\]"):
        build(anything)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            {"model": "nowhere.onnx"},
            WeightsError,
            "nowhere.onnx, which does not exist; expected the path of an ONNX file, or one of yolox-nano,",
        ),
        ({"decoder": "yolov4"}, UnknownName, "unknown detection-decoder 'yolov4', did you mean 'yolov[58]'"),
        (
            {"decoder": "yolov8"},
            WeightsError,
            r"colours.onnx: the output arrays of .* have the shapes \(3, 8\) for each image, expected \(7, \*\) for "
            r"the decoder 'yolov8'",
        ),
        (
            {"labels": ["red"]},
            WeightsError,
            r"the output arrays of the network have the shapes \(3, 8\) for each image, expected \(\*, 6\) for the "
            r"decoder 'yolov5'",
        ),
        (
            {"size_px": [640, 640]},
            WeightsError,
            r"has the inputs images float32 \(\*, 3, 128, 128\), expected float32 \(\*, 3, 640, 640\)",
        ),
        ({"min_score": 0}, ConfigError, "onnx.min_score: received 0, expected a number greater than 0"),
    ],
)
def test_what_does_not_fit_is_one_line(network, change, error, message):
    with pytest.raises(error, match=message) as caught:
        build(network, **change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["half", "text"])
def test_a_broken_file_is_one_line(network, tmp_path, content):
    path = tmp_path / "broken.onnx"
    whole = network.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content == "half" else b"not found")
    with pytest.raises(WeightsError, match=r"broken.onnx is not an ONNX network") as caught:
        build(path)
    assert "\n" not in str(caught.value)


def test_caches_know_the_network_by_its_content(network, tmp_path):
    path = tmp_path / "mine.onnx"
    path.write_bytes(network.read_bytes())

    def cache_key():
        """The detector's identity, and that of descriptions made with it."""
        config = configure("localizer", "objects", {"detector": {"kind": "onnx", **settings(path)}})
        return identity(config.detector), registry().build("localizer", config).describe_identity()

    before = cache_key()
    assert before[0] == identity(configure("detector", "onnx", settings(network)))
    write_network(path, near=50.0)
    after = cache_key()
    assert before[0] != after[0]
    assert before[1] != after[1]
    assert "weights" not in before[0]


def test_caches_know_a_network_to_fetch_by_the_hash_of_its_release():
    for name, weights in ZOO.items():
        known = identity(configure("detector", "onnx", {"model": name}))
        assert known["weights"] == [weights.files[0].sha256]


def test_networks_to_fetch_are_told_where_they_are_not_at_hand(monkeypatch, tmp_path):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    assert len(COCO_80) == len(set(COCO_80)) == 80
    for name in ZOO:
        with pytest.raises(WeightsError, match=f"download it with: salframe weights fetch {name}"):
            OnnxDetector.check(configure("detector", "onnx", {"model": name}))


@pytest.mark.parametrize("names", ["[red, green, blue]", "{0: red, 1: green, 2: blue}"])
def test_class_labels_from_a_file(network, tmp_path, names):
    path = tmp_path / "data.yaml"
    path.write_text(f"train: images\nnames: {names}\n")
    panorama, _ = scene(("red", 0, 0, 20, 16, 2.0))
    assert build(network, labels=str(path)).detect(panorama).labels == ("red",)


@pytest.mark.parametrize("names", ["", "red", "[]", "[1, 2]", "{1: red, 2: green}"])
def test_a_file_without_class_labels_is_one_line(network, tmp_path, names):
    path = tmp_path / "data.yaml"
    path.write_text(f"names: {names}\n")
    with pytest.raises(
        ConfigError, match=r"data.yaml: the key `names` contains .*, expected a list of labels in the order"
    ) as caught:
        build(network, labels=str(path))
    assert "\n" not in str(caught.value)
