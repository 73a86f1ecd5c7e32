"""The shipped network in rooms that training never saw, and what is not fit for it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from salframe_house.building import Building, generate_building
from salframe_house.render import HouseRenderer
from salframe_panoseg.detector import PANOSEG, PanoSegDetector
from scipy.special import logit

from salframe.evaluation.tasks.detection.judging import count_right
from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, InputMissing, WeightsError
from salframe.graphs.detections import Detections
from salframe.panoramas.exposure import correct_dark
from salframe.panoramas.geometry import pose_2d, transform_points, wrap_angle
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.query_image import QueryImage, change_image
from salframe.panoramas.turning import turned

HEIGHT = 512
SEED = 7
YAW_RAD = 0.4


@pytest.fixture(scope="module")
def detector() -> PanoSegDetector:
    return PanoSegDetector()


@pytest.fixture(scope="module")
def building() -> Building:
    return generate_building("home", 6, SEED)


@pytest.fixture(scope="module")
def panoramas(building) -> list[Panorama]:
    return shots(building, YAW_RAD)


def shots(building: Building, yaw_rad: float) -> list[Panorama]:
    """In the middle of each room, by day."""
    renderer = HouseRenderer(building.scene(), "day", HEIGHT)
    shots = []
    for room, points in building.free_space(0.3).items():
        x, y = points[np.argmin(np.linalg.norm(points - points.mean(0), axis=1))]
        shot = renderer.render(pose_2d(x, y, yaw_rad, 1.5))
        shots.append(Panorama(room, shot.rgb, shot.range_m, annotations=Annotations(shot.instance_id, building.labels)))
    return shots


def truth(panorama: Panorama) -> Detections:
    return registry().build("detector", configure("detector", "annotations", {"noise": "none"})).detect(panorama)


def sure(found: Detections) -> Detections:
    """Those that the network is rather sure of."""
    return found.take(np.flatnonzero(found.scores >= 0.5))


def test_it_finds_most_of_what_is_annotated(detector, panoramas):
    right = found = annotated = 0
    for panorama in panoramas:
        seen, there = sure(detector.detect(panorama)), truth(panorama)
        right += count_right(seen, there).total()
        found, annotated = found + len(seen.labels), annotated + len(there.labels)
    assert right / found > 0.6
    assert right / annotated > 0.5


def test_labels_of_another_room_would_not_fit(detector, panoramas):
    """Found objects held against the next room's annotations: what chance gives."""
    right = found = 0
    for panorama, other in zip(panoramas, panoramas[1:] + panoramas[:1], strict=True):
        seen = detector.detect(panorama)
        right, found = right + count_right(seen, truth(other)).total(), found + len(seen.labels)
    assert right / found < 0.1


def directions(found: Detections) -> np.ndarray:
    return np.arctan2(found.centroid_m[:, 1], found.centroid_m[:, 0])


@pytest.mark.parametrize("columns", [1, 100, 331])
def test_turned_by_any_columns_the_same_objects_turn(detector, panoramas, columns):
    for panorama in panoramas:
        before, after = detector.detect(panorama), detector.detect(turned(panorama, columns))
        assert after.labels == before.labels
        expected_m = transform_points(pose_2d(0, 0, -np.pi * columns / HEIGHT), before.centroid_m)
        np.testing.assert_allclose(after.centroid_m, expected_m, atol=1e-4)


def test_turned_between_columns_most_sure_objects_turn(detector, building, panoramas):
    """Seen anew from the same spots: what is on a pixel changes, and with it which objects are the weakest."""
    same = total = 0
    again = shots(building, yaw_rad=YAW_RAD + np.pi * 100.5 / HEIGHT)
    for panorama, other in zip(panoramas, again, strict=True):
        before, after = sure(detector.detect(panorama)), detector.detect(other)
        expected_rad = directions(before) - np.pi * 100.5 / HEIGHT
        for label, azimuth_rad in zip(before.labels, expected_rad, strict=True):
            off_rad = [
                abs(wrap_angle(d - azimuth_rad))
                for d, name in zip(directions(after), after.labels, strict=True)
                if name == label
            ]
            same += bool(off_rad) and min(off_rad) < np.radians(2)
        total += len(before.labels)
    assert same / total >= 0.9


def test_an_object_on_the_seam_comes_out_once(detector, panoramas):
    for panorama in panoramas:
        found = detector.detect(panorama)
        largest = int(np.argmax(np.prod(found.size_m, axis=1)))
        columns = round((np.pi + directions(found)[largest]) / np.pi * HEIGHT)
        again = detector.detect(turned(panorama, columns))
        assert abs(abs(directions(again)[largest]) - np.pi) < np.pi / HEIGHT
        assert again.labels == found.labels


def test_where_the_range_has_holes_the_rest_is_found(detector, panoramas):
    panorama = panoramas[0]
    holed = panorama.range_m.copy()
    holed[:, : HEIGHT // 2] = np.nan
    found = detector.detect(replace(panorama, range_m=holed))
    assert len(found.labels) > 0
    assert np.isfinite(found.centroid_m).all()
    everywhere = np.full_like(holed, np.nan)
    assert detector.detect(replace(panorama, range_m=everywhere)).labels == ()


def test_what_it_lacks_is_named(detector, panoramas):
    with pytest.raises(
        InputMissing, match="has no range image, which the detector 'panoseg' needs: choose the detector 'onnx'"
    ):
        detector.detect(replace(panoramas[0], range_m=None))
    with pytest.raises(
        InputMissing, match="has no colour image, which the detector 'panoseg' needs: choose another detector"
    ):
        detector.detect(replace(panoramas[0], rgb=None))


def own(folder, network: bytes | None = None, card: object = None) -> PanoSegDetector.Config:
    """A training folder: the shipped files, or others in their place."""
    for path in PANOSEG.paths():
        shutil.copy(path, folder)
    if network is not None:
        (folder / "panoseg.onnx").write_bytes(network)
    if card is not None:
        (folder / "panoseg.json").write_text(json.dumps(card))
    return PanoSegDetector.Config(model=folder)


def test_a_training_of_ones_own_takes_its_place(detector, panoramas, tmp_path):
    config = own(tmp_path)
    assert PanoSegDetector(config).detect(panoramas[0]).labels == detector.detect(panoramas[0]).labels
    before = identity(config)
    assert "weights" not in before
    assert identity(own(tmp_path, card={"labels": []})) != before


def test_a_score_is_the_logistic_function_of_the_mean_probability(detector, panoramas, tmp_path):
    card = json.loads(PANOSEG.paths()[1].read_text())
    plain = PanoSegDetector(own(tmp_path, card=card | {"calibration": {"slope": 1, "offset": 0}}))
    slope, offset = card["calibration"]["slope"], card["calibration"]["offset"]
    probability, score = plain.detect(panoramas[0]).scores, detector.detect(panoramas[0]).scores
    probability, score = (
        np.sort(probability)[::-1][:5],
        np.sort(score)[::-1][:5],
    )  # objects with low scores are left out
    np.testing.assert_allclose(logit(score), slope * logit(probability) + offset, atol=1e-6)
    with pytest.raises(ConfigError, match=r"panoseg\.json: key calibration\.slope: received -1"):
        PanoSegDetector(own(tmp_path, card=card | {"calibration": {"slope": -1}}))


def test_caches_know_the_shipped_network_by_its_hash():
    known = identity(configure("localizer", "objects", {"detector": "panoseg"}))["settings"]["detector"]
    assert known["weights"] == [file.sha256 for file in PANOSEG.files]


def test_networks_that_do_not_fit_are_one_line(tmp_path):
    whole = PANOSEG.paths()[0].read_bytes()
    with pytest.raises(WeightsError, match=r"panoseg.onnx is not an ONNX network"):
        PanoSegDetector(own(tmp_path, network=whole[: len(whole) // 2]))
    with pytest.raises(WeightsError, match=r"panoseg.json has no list `labels`, expected the model card"):
        PanoSegDetector(own(tmp_path, card={"classes": 3}))
    with pytest.raises(WeightsError, match=r"nowhere does not exist; correct the path"):
        PanoSegDetector(PanoSegDetector.Config(model=tmp_path / "nowhere"))


def test_dark_panoramas_are_corrected_and_others_are_not(detector, panoramas):
    """The panoramas are not turned to their near side, so that both detectors receive the same columns."""
    uncorrected = PanoSegDetector(PanoSegDetector.Config(exposure="none"))

    def scores(of_detector: PanoSegDetector, panorama: Panorama) -> list[float]:
        return PanoSegDetector.detect.__wrapped__(of_detector, panorama).scores.tolist()

    day = panoramas[0]
    assert scores(detector, day) == scores(uncorrected, day)
    dark = replace(day, rgb=change_image(day.rgb, QueryImage(exposure_ev=-2)))
    assert scores(detector, dark) != scores(uncorrected, dark)
    assert scores(detector, dark) == scores(uncorrected, replace(dark, rgb=correct_dark(dark.rgb)))
