"""Errors drawn from a sensor model whose rates are known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from salframe_annotations.detector import MEASURED, AnnotationDetector, simulate_errors
from salframe_annotations.sensed import SENSORS, SensedNoise

from salframe.framework.components.identity import identity
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files.hashes import file_sha256
from salframe.framework.validation import validate
from salframe.graphs.annotated import visible_objects
from salframe.graphs.sensor import DetectionModel, Errors, FalseObjects, Provenance, SensorModel, read_sensor
from salframe.graphs.visibility import object_visibility
from salframe.panoramas.geometry import sample_nearest
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama

HEIGHT, OBJECTS, FRAMES = 64, 8, 400
SHIPPED = {
    "panoseg": "2efe9ebb73c427ba9446c90c8225b45b7d503f22a7fbbc7d2509c039cf50e8a3",
    "segments": "0f68e6043ef82e753261ca7c50fc7092a19767aca9feeed0b2ec074eef60dd34",
}
"""The sha256 of the sensor models that come with version 4 of the detector: others belong to another version."""

SENSOR = SensorModel(
    provenance=Provenance(salframe="0", detector={}, data={}, panoramas=1, objects=1, detected=1),
    detection=DetectionModel(
        intercept=0.0,
        per_log_solid_angle=1.0,
        per_log_range=-1.0,
        per_hidden_share=0.0,
        reference_solid_angle_sr=0.05,
        reference_range_m=2.0,
        reference_hidden_share=0.0,
        offsets={"chair": 1.0},
        offset_deviation=1.0,
    ),
    confusion={"chair": {"chair": 300, "stool": 100}, "table": {"table": 400}},
    false_objects=FalseObjects(
        per_panorama=2.0,
        labels={"vase": 3, "sign": 1},
        range_m=tuple(np.linspace(2, 4, 11)),
        elevation_rad=(0.3,) * 11,
        size_m=(0.5,) * 11,
    ),
    errors=Errors(bearing_rad=0.02, range_share=0.03, size_log=0.1, height_m=0.05),
)
EXACT = SENSOR.model_copy(
    update={"false_objects": FalseObjects(per_panorama=0, labels={}, range_m=(), elevation_rad=(), size_m=())}
)
MANY = SENSOR.model_copy(update={"false_objects": SENSOR.false_objects.model_copy(update={"per_panorama": 50.0})})


def panorama(name="frame", shift=0):
    """Patches around the camera, of 12 to 5 columns and 12 rows about the horizon, chairs and tables in turn, at 1.5 m
    and more."""
    range_m = np.full((HEIGHT, 2 * HEIGHT), 6.0, np.float32)
    ids = np.zeros((HEIGHT, 2 * HEIGHT), np.int32)
    for k in range(OBJECTS):
        columns = slice(16 * k, 16 * k + 12 - k)
        range_m[26:38, columns], ids[26:38, columns] = 1.5 + 0.3 * k, k + 1
    labels = {k + 1: ("chair", "table")[k % 2] for k in range(OBJECTS)}
    return Panorama(name, range_m=np.roll(range_m, shift, 1), annotations=Annotations(np.roll(ids, shift, 1), labels))


def write(folder, sensor):
    path = folder / "sensor.json"
    path.write_text(json.dumps(sensor.model_dump(mode="json")))
    return str(path)


@pytest.fixture
def file(tmp_path):
    return write(tmp_path, SENSOR)


def detect(pano, **settings):
    return AnnotationDetector(AnnotationDetector.Config(**settings)).detect(pano)


@pytest.fixture(scope="module")
def drawn():
    """The objects of 400 frames beside what was made of them, by their keys."""
    noise, pairs = SensedNoise(SENSOR), []
    for frame in range(FRAMES):
        pano = panorama(f"frame-{frame}")
        objects = visible_objects(pano)
        pairs.append((objects, noise.simulate_detections(pano, objects, 0)))
    return pairs


def test_each_object_is_found_as_often_as_the_model_says(drawn):
    pano = panorama()
    shown = object_visibility(pano, visible_objects(pano))
    chance = SENSOR.detection.probability(shown.labels, shown.solid_angle_sr, shown.range_m, shown.hidden_share)
    assert np.ptp(chance) > 0.2
    keys = [one.key for _, simulated in drawn for one in simulated if one.key > 0]
    share = np.bincount(keys, minlength=OBJECTS + 1)[1:] / FRAMES
    assert (np.abs(share - chance) < 4 * np.sqrt(chance * (1 - chance) / FRAMES)).all()


def test_labels_are_confused_as_counted(drawn):
    said = [one.label for objects, simulated in drawn for one in simulated if one.key > 0 and one.key % 2 == 1]
    assert set(said) <= {"chair", "stool"}
    assert said.count("stool") / len(said) == pytest.approx(0.25, abs=4 * np.sqrt(0.19 / len(said)))
    tables = {one.label for _, simulated in drawn for one in simulated if one.key > 0 and one.key % 2 == 0}
    assert "table" in tables


def test_errors_have_the_stated_deviations(drawn):
    """1,500 draws and more: a standard deviation is known to 2 %."""
    whole = {one.key: one.points_m.astype(float) for one in drawn[0][0]}
    angles, ranges, sizes = [], [], []
    for _, simulated in drawn:
        for one in simulated:
            if one.key < 0:
                continue
            a, b = whole[one.key].mean(0), one.points_m.astype(float).mean(0)
            angles.append([np.arctan2(*b[1::-1]) - np.arctan2(*a[1::-1]), np.arcsin(b[2] / np.linalg.norm(b))])
            angles[-1][1] -= np.arcsin(a[2] / np.linalg.norm(a))
            ranges.append(np.log(np.linalg.norm(b) / np.linalg.norm(a)))
            spread = [
                np.linalg.norm(points - points.mean(0), axis=1).mean() for points in (whole[one.key], one.points_m)
            ]
            sizes.append(np.log(spread[1] / spread[0]) - ranges[-1])
    assert len(ranges) > 1500
    wrapped = (np.array(angles) + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(wrapped.std(0), 0.02, rtol=0.1)
    assert np.std(ranges) == pytest.approx(0.03, rel=0.1)
    assert np.std(sizes) == pytest.approx(0.1, rel=0.1)
    for values in (wrapped[:, 0] / 0.02, wrapped[:, 1] / 0.02, np.array(ranges) / 0.03, np.array(sizes) / 0.1):
        assert np.mean(values) == pytest.approx(0, abs=4 / np.sqrt(len(values)))


def test_false_objects_are_as_many_and_where_the_model_says(drawn):
    made = [one for _, simulated in drawn for one in simulated if one.key < 0]
    assert len(made) / FRAMES == pytest.approx(2, abs=4 * np.sqrt(2 / FRAMES))
    assert sum(one.label == "vase" for one in made) / len(made) == pytest.approx(
        0.75, abs=4 * np.sqrt(0.19 / len(made))
    )
    centre = np.array([one.points_m.mean(0) for one in made])
    range_m = np.linalg.norm(centre, axis=1)
    assert range_m.min() > 1.99
    assert range_m.max() < 4.01
    assert range_m.mean() == pytest.approx(3, abs=4 * 0.58 / np.sqrt(len(made)))
    np.testing.assert_allclose(np.arcsin(centre[:, 2] / range_m), 0.3, atol=1e-4)
    azimuth = np.arctan2(centre[:, 1], centre[:, 0])
    assert abs(np.exp(1j * azimuth).mean()) < 4 / np.sqrt(len(made))
    corners = np.array([one.points_m for one in made]) - centre[:, None]
    np.testing.assert_allclose(np.linalg.norm(corners, axis=2), 0.25 * np.sqrt(3), atol=1e-4)


@pytest.mark.parametrize(
    ("azimuth_deg", "top_deg", "bottom_deg"), [((-45, 45), 90, -90), ((30, 210), 60, 0), ((-20, 20), 25, -25)]
)
def test_partial_views_have_false_positives_in_proportion_to_their_solid_angle(azimuth_deg, top_deg, bottom_deg):
    """The solid angle between two azimuths and two elevations is their difference times that of the sines."""
    azimuth = np.degrees(np.pi - (np.arange(360) + 0.5) * np.pi / 180)
    elevation = 90 - (np.arange(180) + 0.5)
    columns = (azimuth - azimuth_deg[0]) % 360 < azimuth_deg[1] - azimuth_deg[0]
    view = ((elevation < top_deg) & (elevation > bottom_deg))[:, None] & columns
    share = (azimuth_deg[1] - azimuth_deg[0]) / 360 * (np.sin(np.radians([top_deg, bottom_deg])) @ (0.5, -0.5))
    empty = Panorama("x", valid=view, annotations=Annotations(np.zeros(view.shape, np.int32)))
    noise, seeds = SensedNoise(MANY), 400
    drawn = [one for seed in range(seeds) for one in noise.simulate_detections(empty, [], (seed, 0))]
    expected = 50 * share
    assert len(drawn) / seeds == pytest.approx(expected, abs=4 * np.sqrt(expected / seeds))
    assert sample_nearest(view, np.array([one.points_m.mean(0) for one in drawn])).all()


def test_a_view_outside_the_measured_elevations_has_its_share_too():
    view = np.zeros((180, 360), bool)
    view[:60] = True  # above 30 degrees; all measured false positives are lower
    empty = Panorama("x", valid=view, annotations=Annotations(np.zeros(view.shape, np.int32)))
    counts = [len(SensedNoise(SENSOR).simulate_detections(empty, [], (seed, 0))) for seed in range(60)]
    assert np.mean(counts) == pytest.approx(2 / 4, abs=4 * np.sqrt(0.5 / 60))


def test_a_full_view_has_the_same_false_positives_as_a_panorama_without_a_mask(file):
    whole, masked = (detect(replace(panorama(), valid=v), noise=file) for v in (None, np.ones((64, 128), bool)))
    assert whole.labels == masked.labels
    np.testing.assert_array_equal(whole.centroid_m, masked.centroid_m)


def test_draws_are_keyed_by_seed_frame_and_object(file):
    base, again = detect(panorama(), noise=file), detect(panorama(), noise=file)
    assert base.labels == again.labels
    np.testing.assert_array_equal(base.centroid_m, again.centroid_m)
    others = [detect(panorama("other"), noise=file), detect(panorama(), noise=file, seed=1)]
    assert all(len(one) != len(base) or np.abs(one.centroid_m - base.centroid_m).max() > 1e-3 for one in others)


def test_other_objects_change_no_objects_draws():
    noise, whole = SensedNoise(EXACT), panorama()
    objects = visible_objects(whole)
    simulated = {one.key: one for one in noise.simulate_detections(whole, objects, (0, 0))}
    fewer = {one.key: one for one in noise.simulate_detections(whole, objects[::2], (0, 0))}
    assert fewer
    assert set(fewer) == {key for key in simulated if key % 2 == 1}
    for key, one in fewer.items():
        np.testing.assert_array_equal(one.points_m, simulated[key].points_m)


@pytest.mark.parametrize("columns", [1, 37, 2 * HEIGHT - 3])
def test_turning_the_panorama_turns_what_is_found_and_what_is_made_up(file, columns):
    base, turned = detect(panorama(), noise=file), detect(panorama(shift=columns), noise=file)
    assert turned.labels == base.labels
    angle = -2 * np.pi * columns / (2 * HEIGHT)
    c, s = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose(
        turned.centroid_m, base.centroid_m @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), atol=1e-5
    )
    np.testing.assert_allclose(turned.size_m, base.size_m, atol=1e-5)


def test_without_range_bearings_and_labels_are_drawn(tmp_path):
    """Objects without range are not hidden and have the reference range: the model predicts how many are detected."""
    noise, pano = SensedNoise(SENSOR), replace(panorama(), range_m=None)
    objects = visible_objects(pano)
    shown = object_visibility(pano, objects)
    chance = SENSOR.detection.probability(shown.labels, shown.solid_angle_sr)
    views = [replace(pano, id=f"frame-{frame}") for frame in range(FRAMES)]
    simulated = [one for view in views for one in noise.simulate_detections(view, objects, 0) if one.key > 0]
    assert len(simulated) / FRAMES == pytest.approx(
        chance.sum(), abs=4 * np.sqrt((chance * (1 - chance)).sum() / FRAMES)
    )
    detections = detect(pano, noise=write(tmp_path, SENSOR))
    assert np.isnan(detections.centroid_m).all()
    np.testing.assert_allclose(np.linalg.norm(detections.bearing, axis=1), 1)


def test_object_lists_take_it():
    boxes = ObjectBoxes(
        ("chair",) * 50,
        tuple(f"k{i}" for i in range(50)),
        np.column_stack([np.full(50, 2.0), np.linspace(-20, 20, 50), np.zeros(50)]),
        np.full((50, 3), 0.6),
        np.zeros(50),
    )
    listed = Panorama("list", annotations=Annotations(objects=boxes))
    objects = visible_objects(listed)
    chance = SENSOR.detection.probability(
        ("chair",) * 50, object_visibility(listed, objects).solid_angle_sr, object_visibility(listed, objects).range_m
    )
    counts = [len(SensedNoise(EXACT).simulate_detections(listed, objects, (0, frame))) for frame in range(100)]
    assert np.mean(counts) == pytest.approx(chance.sum(), abs=4 * np.sqrt((chance * (1 - chance)).sum() / 100))


def test_an_empty_panorama_may_show_false_objects(file):
    empty = Panorama("x", range_m=np.ones((8, 16), np.float32), annotations=Annotations(np.zeros((8, 16), np.int32)))
    simulated = [len(detect(replace(empty, id=f"x{i}"), noise=file)) for i in range(60)]
    assert np.mean(simulated) == pytest.approx(2, abs=4 * np.sqrt(2 / 60))


@pytest.mark.parametrize(
    ("level", "missed", "mislabelled", "share"), [("uniform", 0.1, 0.05, 0.05), ("uniform-heavy", 0.2, 0.1, 0.1)]
)
def test_uniform_levels_draw_as_they_did_under_their_old_names(level, missed, mislabelled, share):
    """The draws of `realistic` and `heavy`, spelt out."""
    import zlib

    for frame in range(30):
        pano = panorama(f"frame-{frame}")
        simulated = iter(detect(pano, noise=level, seed=3).centroid_m)
        labels = iter(detect(pano, noise=level, seed=3).labels)
        for one in visible_objects(pano):
            rng = np.random.default_rng((3, zlib.crc32(pano.id.encode()), one.key))
            first = rng.random(4)
            factor = 1 + share * rng.standard_normal()
            if first[0] < missed:
                continue
            other = {"chair": "table", "table": "chair"}[one.label]
            assert next(labels) == (other if first[1] < mislabelled else one.label)
            np.testing.assert_allclose(
                next(simulated), one.points_m.mean(0, dtype=float) * factor, rtol=1e-5, atol=1e-6
            )
        assert next(labels, None) is None


def test_shares_of_ones_own_are_still_taken():
    assert len(detect(panorama(), noise={"missed": 1.0})) == 0
    assert simulate_errors([], [], AnnotationDetector.Config(noise={"missed": 1.0}).noise, (0, 0)) == []


def test_an_unknown_level_and_a_missing_or_foreign_file_are_told(tmp_path):
    with pytest.raises(
        ConfigError,
        match=r"^setting d.noise: received 'realistic', expected 'auto', 'none', 'uniform', 'uniform-heavy', ",
    ):
        validate(AnnotationDetector.Config, {"noise": "realistic"}, "d")
    other = tmp_path / "other.json"
    other.write_text("{}")
    with pytest.raises(DataError, match=r"other\.json has the format None"):
        detect(panorama(), noise=str(other))


def test_the_identity_of_a_file_is_its_content(tmp_path, file):
    (tmp_path / "b").mkdir()
    moved = write(tmp_path / "b", SENSOR)
    changed = write(tmp_path, EXACT)
    assert changed == file
    known = [identity(AnnotationDetector.Config(noise=path)) for path in (moved, changed)]
    assert known[0] != known[1]
    write(tmp_path / "b", EXACT)
    assert identity(AnnotationDetector.Config(noise=moved)) == known[1]


@pytest.mark.parametrize("name", MEASURED)
def test_shipped_sensor_models_are_those_of_this_version(name):
    path = SENSORS / f"{name}.json"
    assert (AnnotationDetector.version, file_sha256(path)) == ("4", SHIPPED[name])
    sensor = read_sensor(path)
    assert sensor.provenance.detector["name"] == name
    assert len(detect(panorama(), noise=name)) > 0
