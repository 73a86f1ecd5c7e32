"""`union`: each object once, in common names, whatever the order of the detectors and wherever the panorama begins."""

import itertools
from typing import ClassVar

import numpy as np
import pytest
from command_line import run as salframe
from conformance import conforms
from salframe_detectors.duplicates import SAME
from salframe_detectors.union import UnionDetector, unite
from tiny_folder import write_tiny_folder
from tiny_network import settings, write_network

from salframe.framework.component import ComponentConfig, components_in
from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import list_settings
from salframe.framework.errors import ConfigError, WeightsError
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.turning import rotate_detections
from salframe.panoramas.panorama import Panorama

COLUMNS = ("scores", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr")


class Listed(Detector):
    """Sees what its settings list: label, score, and where a cube of 1 m stands."""

    name, version = "listed", "1"
    needs: ClassVar[frozenset[str]] = frozenset({"range"})
    column_step = 4

    class Config(ComponentConfig):
        objects: tuple[tuple[str, float, float, float, float], ...] = ()

    def detect(self, panorama):
        return cubes(*self.config.objects)


class Coloured(Listed):
    """Needs colour, and is less steady."""

    name = "coloured"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    column_step, turn_tolerance_m = 6, 0.01


class Weightless(Listed):
    """Its weights are never there."""

    name = "weightless"

    @classmethod
    def check(cls, config):
        raise WeightsError("no file; get it with: salframe weights fetch nothing")


@pytest.fixture
def members(monkeypatch, tmp_path):
    monkeypatch.setenv("SALFRAME_PLUGINS", "salframe_detectors,salframe_annotations,salframe_objects,salframe_engines")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    for component in (Listed, Coloured, Weightless):
        registry().add(component, "test")
    yield
    registry.cache_clear()


def cubes(*objects) -> Detections:
    """(label, score, x, y, z) each."""
    centroid = np.array([one[2:] for one in objects], float).reshape(-1, 3)
    scores = np.array([one[1] for one in objects], float)
    return Detections(
        tuple(one[0] for one in objects), scores, centroid, np.ones(centroid.shape), np.zeros(len(scores))
    )


def seen(*objects) -> Detections:
    """(label, score, azimuth in deg, solid angle in sr) each; no range."""
    azimuth = np.radians([one[2] for one in objects])
    unknown = np.full((len(objects), 3), np.nan)
    return Detections(
        tuple(one[0] for one in objects),
        np.array([one[1] for one in objects]),
        unknown,
        unknown,
        unknown[:, 0],
        bearing=np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], 1),
        solid_angle_sr=np.array([one[3] for one in objects], float),
    )


def rows(found: Detections) -> list[tuple]:
    return [
        (label, *map(float, (s, *c))) for label, s, c in zip(found.labels, found.scores, found.centroid_m, strict=True)
    ]


def test_an_object_found_twice_comes_out_once_with_the_better_detection():
    couch, sofa = ("couch", 0.6, 2.0, 0, 0), ("sofa", 0.9, 2.3, 0, 0)  # they share 0.7
    assert rows(unite([cubes(couch), cubes(sofa)])) == [sofa]
    far = ("sofa", 0.9, 2.6, 0, 0)  # 0.4, below SAME
    assert rows(unite([cubes(couch), cubes(far)])) == [far, ("sofa", 0.6, 2.0, 0, 0)]
    assert 0.4 < SAME < 0.7


def test_other_names_and_objects_of_one_detector_stay():
    chair, table = ("chair", 0.5, 2.0, 0, 0), ("table", 0.9, 2.0, 0, 0)
    assert rows(unite([cubes(chair), cubes(table)])) == [chair, table]
    twice = [("chair", 0.9, 2.0, 0, 0), ("chair", 0.8, 2.1, 0, 0)]
    assert rows(unite([cubes(*twice), cubes()])) == twice
    assert len(unite([cubes(), cubes()])) == 0


def test_without_range_bearings_and_solid_angles_decide():
    radius = np.radians(10.0)
    cap_sr = 2 * np.pi * (1 - np.cos(radius))
    near = unite([seen(("tv", 0.4, 30, cap_sr)), seen(("television", 0.8, 33, cap_sr))])
    assert (near.labels, near.scores.tolist()) == (("television",), [0.8])
    np.testing.assert_allclose(np.degrees(np.arctan2(*near.bearing[0, 1::-1])), 33)
    # Two equal discs share half of each where their centres are 0.81 radii apart.
    assert len(unite([seen(("tv", 0.4, 30, cap_sr)), seen(("tv", 0.8, 38.0, cap_sr))])) == 1
    assert len(unite([seen(("tv", 0.4, 30, cap_sr)), seen(("tv", 0.8, 38.2, cap_sr))])) == 2
    point = seen(("tv", 0.8, 38, np.nan))
    assert len(unite([seen(("tv", 0.4, 30, cap_sr)), point])) == 1
    assert len(unite([seen(("tv", 0.4, 30, np.nan)), point])) == 2


def test_a_detection_whose_position_is_known_stays_with_the_best_score():
    placed, unplaced = cubes(("tv", 0.4, 2.0, 0, 0)), seen(("tv", 0.8, 0.0, 0.2))
    assert rows(unite([placed, unplaced])) == rows(unite([unplaced, placed])) == [("television", 0.8, 2.0, 0, 0)]


def test_boxes_without_points_have_those_of_their_corners_beside_points():
    box = Detections(("bed",), np.ones(1), np.array([[2.0, 1, 0]]), np.array([[2.0, 1, 0.5]]), np.array([np.pi / 6]))
    cloud = cubes(("chair", 0.5, -2.0, 0, 0))
    cloud = Detections(*(getattr(cloud, name) for name in ("labels", *COLUMNS[:4])), (np.zeros((4, 3), np.float32),))
    united = unite([box, cloud])
    corners = united.points_m[0]
    local = (corners[:, :2] - (2, 1)) @ np.array([[np.cos(np.pi / 6), -0.5], [0.5, np.cos(np.pi / 6)]])
    np.testing.assert_allclose(np.abs(local), np.tile([1.0, 0.5], (8, 1)), atol=1e-6)
    np.testing.assert_allclose(np.abs(corners[:, 2]), 0.25, atol=1e-6)
    assert len(np.unique(np.round(corners, 4), axis=0)) == 8
    assert unite([box, box]).points_m is None


def crowd(seed: int) -> list[Detections]:
    """Three detectors in a room full of chairs and tables, some found by all, some not."""
    rng = np.random.default_rng(seed)
    true = [
        (str(label), *place)
        for label, place in zip(rng.choice(["chair", "table"], 12), rng.uniform(-4, 4, (12, 3)), strict=True)
    ]
    return [
        cubes(
            *(
                (label, rng.uniform(), *(np.array(at) + rng.normal(0, 0.2, 3)))
                for label, *at in true
                if rng.uniform() < 0.7
            )
        )
        for _ in range(3)
    ]


@pytest.mark.parametrize("seed", range(5))
def test_neither_the_order_of_detectors_nor_a_turn_changes_anything_else(seed):
    found = crowd(seed)
    united = unite(found)
    assert max(map(len, found)) <= len(united) < sum(map(len, found))
    for order in itertools.permutations(found):
        again = unite(order)
        assert again.labels == united.labels
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(again, name), getattr(united, name))
    for angle_rad in (0.1, 2.0, np.pi):
        turned, expected = (
            unite([rotate_detections(one, angle_rad) for one in found]),
            rotate_detections(united, angle_rad),
        )
        assert turned.labels == expected.labels
        np.testing.assert_allclose(turned.centroid_m, expected.centroid_m, atol=1e-9)


def union(*of) -> UnionDetector:
    return registry().build("detector", configure("detector", "union", {"of": list(of)}))


def test_it_needs_what_any_of_them_needs_and_is_as_steady_as_all(members):
    made = union("listed", {"kind": "coloured", "objects": [["couch", 0.9, 1, 0, 0]]})
    assert made.needs == {"rgb", "range"}
    assert (made.column_step, made.turn_tolerance_m) == (12, 0.01)
    panorama = Panorama("nothing", rgb=np.zeros((4, 8, 3), np.uint8))
    assert rows(made.detect(panorama)) == [("sofa", 0.9, 1, 0, 0)]


def test_every_detector_in_it_is_checked_listed_and_part_of_the_identity(members):
    config = configure("detector", "union", {"of": ["listed", {"kind": "onnx", "min_score": 0.5}]})
    assert [name for name, _ in components_in(config)] == ["of[0]", "of[1]"]
    assert type(config).model_validate_json(config.model_dump_json()) == config
    shown = {setting.key: setting for setting in list_settings(config)}
    assert (shown["of"].value, shown["of"].default, shown["of"].type) == (
        ["listed", "onnx"],
        ["segments", "onnx"],
        "detector, ...",
    )
    assert shown["of[1].min_score"].value == 0.5
    other = configure("detector", "union", {"of": ["listed", {"kind": "onnx", "min_score": 0.6}]})
    assert identity(config) != identity(other)
    assert identity(config)["settings"]["of"][1] == identity(config.of[1])
    with pytest.raises(WeightsError, match="salframe weights fetch nothing"):
        union("listed", "weightless")


@pytest.mark.parametrize(
    ("of", "message"),
    [
        ("segments", r"union\.of: received 'segments', expected a list with at least one detector"),
        ([], r"union\.of: received \[\], expected a list with at least one detector"),
        (
            [{"min_score": 0.5}],
            r"union\.of: the list entry \{'min_score': 0.5\} has no key `kind`, expected `kind` with the name of a d",
        ),
        (["yolo"], r"unknown detector 'yolo'"),
        ([7], r"union\.of: received 7, expected the name of a detector"),
        ([{"kind": "onnx", "score": 1}], r"unknown setting union\.of\.0\.score"),
    ],
)
def test_what_is_no_list_of_detectors_is_refused_in_one_line(members, of, message):
    with pytest.raises(Exception, match=message) as caught:
        configure("detector", "union", {"of": of})
    assert "\n" not in str(caught.value)


def test_auto_may_be_one_of_them(members):
    from salframe.framework.components.auto import Choice

    choice = Choice("mine", lambda: frozenset({"annotations"}))
    assert [one.kind for one in configure("detector", "union", {"of": ["auto", "listed"]}, (), choice).of] == [
        "annotations",
        "listed",
    ]
    with pytest.raises(ConfigError, match="'auto' selects a detector only when the dataset is known"):
        union("auto", "listed")


def test_it_is_set_from_the_command_line_and_misses_in_its_own_name(members, tmp_path):
    data = write_tiny_folder(tmp_path / "data")
    asked = (
        "compare",
        "--methods",
        "objects",
        "--data",
        data,
        "--engine",
        "inline",
        "--json",
        "--set",
        "detector.kind=union",
        "--set",
    )
    (row,) = salframe(*asked, "detector.of=[annotations, {kind: annotations, noise: none}]").json["rows"]
    assert (row["input"], row["accuracy"]) == (["annotations"], 1.0)
    (row,) = salframe(*asked, "detector.of=[annotations, weightless]").json["rows"]
    assert "salframe weights fetch nothing" in row["reason"]


def test_it_conforms(tmp_path):
    network = settings(write_network(tmp_path / "colours.onnx"))
    for of in (
        ["annotations", {"kind": "annotations", "noise": "uniform-heavy", "seed": 3}],
        ["annotations", "panoseg"],
        [{"kind": "onnx", **network}, {"kind": "annotations", "noise": "uniform-heavy"}],
    ):
        assert conforms(UnionDetector, configure("detector", "union", {"of": of}))
