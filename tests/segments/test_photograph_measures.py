"""What training/segments measures by: gravity, pixels, objects, calibration, on answers counted by hand."""

import numpy as np
import pytest

from salframe.graphs.boxes import detections_from_points
from salframe.graphs.score_calibration import ScoreCalibration
from salframe.panoramas.geometry import equirectangular_rays
from training.segments.calibration import apply, brier, curve, fit, interval, left_out_scores, undo
from training.segments.measures import (
    ROWS,
    accuracy,
    confusion,
    count,
    lay_objects,
    mean_iou,
    one_structure,
    regions_of,
)
from training.segments.photographs import CENTRE_PX, FOCAL_PX, normals, upright
from training.segments.thirteen import CLASSES, class_of

BED, SOFA, TABLE, WALL, FLOOR = (CLASSES.index(name) for name in ("bed", "sofa", "table", "wall", "floor"))


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0, 0), (-20, 5), (15, -10)])
def test_gravity_is_seen_in_floor_and_walls(pitch_deg, roll_deg):
    pitch, roll = np.radians([pitch_deg, roll_deg])
    looks = np.array([[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]])
    tilted = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    level = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    rotation = looks @ tilted @ level  # camera axes to upright
    y, x = np.mgrid[:480, :640]
    rays = np.stack([(x - CENTRE_PX[0]) / FOCAL_PX, (y - CENTRE_PX[1]) / FOCAL_PX, np.ones_like(x)], -1) @ rotation.T
    with np.errstate(divide="ignore"):
        planes = np.stack([-1.2 / rays[..., 2], 3 / rays[..., 0], 1.5 / rays[..., 1], -2 / rays[..., 1]])
    depth_m = np.where(planes > 0, planes, np.inf).min(0)
    found = upright(normals(depth_m.astype(np.float32), FOCAL_PX, CENTRE_PX))
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(found) == pytest.approx(1)
    assert found[2] @ rotation[2] > np.cos(np.radians(1))  # up
    assert found[0] @ [0, 0, 1] > 0.9  # the camera looks along +x
    assert found[1] @ [0, 0, 1] == pytest.approx(0, abs=1e-9)


def test_pixels_are_counted_by_labelled_class():
    truth, answer = np.array([[0, BED, BED, WALL, FLOOR]]), np.array([[BED, BED, SOFA, WALL, WALL]])
    counts = confusion(truth, answer)
    assert accuracy(counts) == 2 / 4
    assert mean_iou(counts) == pytest.approx((1 / 2 + 1 / 2 + 0) / 3)
    assert accuracy(one_structure(counts)) == 3 / 4
    assert mean_iou(one_structure(counts)) == pytest.approx((1 / 2 + 2 / 2) / 2)


def test_names_are_those_of_the_13_classes():
    named = [class_of(name) for name in ("couch", "desk", "rug", "door", "lamp", "windowpane", "bookshelf", "tv")]
    assert named == ["sofa", "table", "floor", "wall", "objects", "window", "furniture", "tv"]


def points(rows, columns):
    mask = np.zeros((ROWS, 2 * ROWS), bool)
    mask[rows, columns] = True
    return (2 * equirectangular_rays(ROWS)[mask]).astype(np.float32)


def test_objects_are_matched_with_labelled_regions():
    labels = np.zeros((ROWS, 2 * ROWS), np.uint8)
    labels[100:120, 100:200] = WALL
    labels[100:120, 110:130] = BED
    labels[100:120, 150:170] = SOFA
    labels[100:102, 180:182] = SOFA  # too small to be an object
    found = detections_from_points(
        ["bed", "couch", "table", "rug", "bed"],
        np.array([0.9, 0.6, 0.8, 0.9, 0.9]),
        [
            points(slice(100, 120), slice(112, 132)),  # 18 of 20 columns right: an overlap of 18 / 22
            points(slice(100, 120), slice(164, 174)),  # 6 of 10 columns right: named, 6 / 24 of the union
            points(slice(100, 120), slice(152, 172)),  # where a sofa is
            points(slice(100, 120), slice(172, 176)),  # counted to the structure by the labels
            points(slice(0, 20), slice(0, 20)),  # where nobody labelled
        ],
    )
    objects, regions = lay_objects(found, labels), regions_of(labels)
    assert sorted(regions[0].tolist()) == sorted([BED, SOFA])
    assert objects.label.tolist() == [BED, SOFA, TABLE]
    assert objects.named.tolist() == [True, True, False]
    low, high = count(objects, regions, 0.5), count(objects, regions, 0.7)
    assert vars(low) == {"detected": 3, "named": 2, "true_positives": 1, "regions": 2, "covered": 1}
    assert vars(high) == {"detected": 2, "named": 1, "true_positives": 1, "regions": 2, "covered": 1}
    assert vars(low + high)["regions"] == 4


def test_the_fit_finds_the_logistic_function_and_the_card_applies_the_same():
    rng = np.random.default_rng(0)
    p = rng.uniform(0.05, 0.95, 20000)
    right = rng.uniform(size=p.size) < apply(p, 0.6, -0.5)
    slope, offset = fit(p, right)
    assert (slope, offset) == pytest.approx((0.6, -0.5), abs=0.05)
    card = ScoreCalibration(slope=0.6, offset=-0.5)
    assert [card.score(value) for value in p[:5]] == pytest.approx(apply(p[:5], 0.6, -0.5).tolist())
    assert undo(apply(p, 0.6, -0.5), 0.6, -0.5) == pytest.approx(p)
    views, truth = np.split(p, 10), np.split(right, 10)
    assert brier(left_out_scores(views, truth), truth) < brier(views, truth)


def test_the_curve_and_its_intervals():
    scores = [np.array([0.1, 0.2, 0.6]), np.array([0.6, 1.0])]
    right = [np.array([False, True, True]), np.array([False, True])]
    rows = curve(scores, right)
    assert [(row["objects"], round(row["score"], 2), row["named"]) for row in rows] == [
        (2, 0.15, 0.5),
        (2, 0.6, 0.5),
        (1, 1.0, 1.0),
    ]
    assert (rows[1]["low"], rows[1]["high"]) == (0, 1)
    low, high = interval(np.full(400, 3), np.full(400, 4))
    assert low == high == 0.75
    assert interval(np.arange(10) % 2, np.ones(10)) == pytest.approx((0.2, 0.8), abs=0.1)
