"""A sensor whose rates are known: 600 made panoramas of 12 objects each, 30 degrees apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from salframe.evaluation.tasks.sensor.fitting import (
    SensorSample,
    fit_detection,
    fit_sensor,
    match_objects,
    observe,
    robust_deviation,
)
from salframe.graphs.boxes import detections_where_known
from salframe.graphs.detections import Detections
from salframe.graphs.visibility import ObjectVisibility

LABELS = ("chair", "table", "sofa", "plant", "lamp", "mirror")
INTERCEPT, SLOPES, OFFSETS = 0.5, np.array([0.8, -1.5, -2.0]), {"chair": -1.0, "sofa": 1.0}
BEARING_RAD, RANGE_SHARE, SIZE_LOG, FALSE = 0.01, 0.02, 0.15, 1.5
PANORAMAS, OBJECTS = 600, 12
SIDE_M = 1.2


def boxes(labels, azimuth, elevation, range_m, size_m):
    direction = np.stack(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)], 1
    )
    return Detections(
        tuple(labels), np.ones(len(labels)), direction * np.asarray(range_m)[:, None], size_m, np.zeros(len(labels))
    )


def look(rng):
    """A panorama: objects found as a logistic function says, chairs called stools one time in five, and false vases far
    away."""
    labels = rng.choice(LABELS, OBJECTS)
    azimuth, elevation = np.arange(OBJECTS) * 2 * np.pi / OBJECTS, rng.uniform(-0.3, 0.3, OBJECTS)
    range_m, angle_sr = rng.uniform(1.5, 4, OBJECTS), np.exp(rng.normal(-3, 1, OBJECTS))
    hidden = rng.uniform(0, 0.8, OBJECTS)
    size_m = np.full((OBJECTS, 3), SIDE_M)
    terms = np.column_stack([np.log(angle_sr / 0.05), np.log(range_m / 2.75), hidden - 0.4])
    logit = INTERCEPT + terms @ SLOPES + [OFFSETS.get(label, 0) for label in labels]
    seen = rng.random(OBJECTS) < 1 / (1 + np.exp(-logit))
    said = np.where((labels == "chair") & (rng.random(OBJECTS) < 0.2), "stool", labels)
    shift = BEARING_RAD * rng.standard_normal((2, OBJECTS))
    found = (
        said,
        azimuth + shift[0] / np.cos(elevation),
        elevation + shift[1],
        range_m * np.exp(RANGE_SHARE * rng.standard_normal(OBJECTS)),
        size_m * np.exp(SIZE_LOG * rng.standard_normal((OBJECTS, 1))),
    )
    extra = rng.poisson(FALSE)
    made_up = (
        np.full(extra, "vase"), rng.uniform(-3, 3, extra), np.full(extra, 0.2), rng.uniform(10, 20, extra),
        np.full((extra, 3), 0.5),
    )  # fmt: skip
    columns = (np.concatenate([a[seen], b]) for a, b in zip(found, made_up, strict=True))
    truth = boxes(labels, azimuth, elevation, range_m, size_m)
    return SensorSample(truth, ObjectVisibility(tuple(labels), angle_sr, range_m, hidden), boxes(*columns))


@pytest.fixture(scope="module")
def looks():
    rng = np.random.default_rng(1)
    return [look(rng) for _ in range(PANORAMAS)]


@pytest.fixture(scope="module")
def sensor(looks):
    return fit_sensor(observe(looks), {"salframe": "0", "detector": {}, "data": {}})


def test_chances_are_recovered(sensor, looks):
    """The slopes within four standard errors, which a regression on 7,200 objects has: 0.03, 0.1 and 0.12; the chance
    of every object within 0.08, on average within 0.015."""
    found = sensor.detection
    slopes = (found.per_log_solid_angle, found.per_log_range, found.per_hidden_share)
    assert (np.abs(slopes - SLOPES) < [0.12, 0.4, 0.5]).all()
    assert found.offsets["sofa"] - found.offsets["plant"] == pytest.approx(1, abs=0.4)
    assert found.offsets["chair"] - found.offsets["plant"] == pytest.approx(-1, abs=0.4)
    errors = []
    for one in looks[:50]:
        visibility = one.visibility
        terms = np.column_stack(
            [np.log(visibility.solid_angle_sr / 0.05), np.log(visibility.range_m / 2.75), visibility.hidden_share - 0.4]
        )
        logit = INTERCEPT + terms @ SLOPES + [OFFSETS.get(label, 0) for label in visibility.labels]
        said = found.probability(
            visibility.labels, visibility.solid_angle_sr, visibility.range_m, visibility.hidden_share
        )
        errors.extend(np.abs(said - 1 / (1 + np.exp(-logit))))
    assert max(errors) < 0.08
    assert np.mean(errors) < 0.015


def test_confusion_is_recovered(sensor):
    """Some 450 chairs were found: a fifth of them is known to 0.08 at four standard errors."""
    chairs = sensor.confusion["chair"]
    assert set(chairs) == {"chair", "stool"}
    assert sum(chairs.values()) > 400
    assert sensor.label_probabilities("chair")["stool"] == pytest.approx(0.2, abs=0.08)
    assert sensor.confusion["sofa"].keys() == {"sofa"}


def test_errors_are_recovered(sensor):
    """The median distance from the median of 4,000 draws is known to 2 %, of the height to what bearing and range make
    of it."""
    errors = sensor.errors
    assert errors.bearing_rad == pytest.approx(BEARING_RAD, rel=0.08)
    assert errors.range_share == pytest.approx(RANGE_SHARE, rel=0.08)
    assert errors.size_log == pytest.approx(SIZE_LOG, rel=0.08)
    assert BEARING_RAD * 1.5 < errors.height_m < BEARING_RAD * 4 + RANGE_SHARE * 4 * 0.3


def test_false_objects_are_counted(sensor):
    """600 Poisson numbers of mean 1.5: four standard errors are 0.2."""
    false = sensor.false_objects
    assert false.per_panorama == pytest.approx(FALSE, abs=0.2)
    assert set(false.labels) == {"vase"}
    assert sum(false.labels.values()) == round(false.per_panorama * PANORAMAS)
    assert (false.range_m[0], false.range_m[-1]) == pytest.approx((10, 20), abs=0.1)
    assert false.range_m[5] == pytest.approx(15, abs=0.8)
    np.testing.assert_allclose(false.elevation_rad, 0.2, atol=1e-3)
    np.testing.assert_allclose(false.size_m, 0.5, atol=1e-3)


def test_provenance_counts(sensor):
    told = sensor.provenance
    assert (told.panoramas, told.objects) == (PANORAMAS, PANORAMAS * OBJECTS)
    assert told.detected == sum(sum(row.values()) for row in sensor.confusion.values())


def three(*labels, x=(1.0, 2.0, 3.0), side=0.2):
    return Detections(
        labels, np.ones(3), np.column_stack([x, [0, 0, 0], [0, 0, 0]]), np.full((3, 3), side), np.zeros(3)
    )


def test_objects_are_matched_one_to_one_by_label_before_nearness():
    truth = three("chair", "stool", "table")
    assert match_objects(truth, truth).tolist() == [0, 1, 2]
    # The stool found at the chair is the stool's no more than 0.3 m from it; the couch nobody calls a table is one.
    found = three("stool", "stool", "couch", x=(1.05, 2.2, 3.1))
    assert match_objects(found, truth).tolist() == [0, 1, 2]
    far = three("chair", "stool", "table", x=(1.31, 2.0, 3.29))
    assert match_objects(far, truth).tolist() == [-1, 1, 2]
    large = replace(truth, size_m=np.full((3, 3), 0.8))
    assert match_objects(far, large).tolist() == [0, 1, 2]  # half of 0.8 m
    assert match_objects(three("sofa", "stool", "table", x=(1.31, 2.0, 3.0)), large).tolist() == [-1, 1, 2]


def test_as_many_as_can_be_are_matched():
    truth = three("chair", "chair", "table", x=(1.0, 1.4, 9.0))
    found = three("chair", "chair", "lamp", x=(1.2, 1.5, 20.0))
    assert match_objects(found, truth).tolist() == [0, 1, -1]
    found = three("chair", "chair", "lamp", x=(1.25, 1.02, 20.0))  # both near the first, one of them near the second
    assert match_objects(found, truth).tolist() == [1, 0, -1]


def test_without_range_what_is_found_is_matched_by_its_bearing():
    truth = three("chair", "stool", "table")
    turned = np.array([[np.cos(a), np.sin(a), 0] for a in (0.05, 0.2, 0.05)])
    found = detections_where_known(("chair", "lamp", "table"), np.ones(3), None, turned, np.full(3, np.nan))
    assert match_objects(found, truth).tolist() == [0, -1, 2]
    seen = observe([SensorSample(truth, ObjectVisibility(truth.labels, *np.full((3, 3), np.nan)), found)])
    np.testing.assert_allclose(np.sort(seen.bearing_rad[:, 0]), [0.05, 0.05])
    assert np.isnan(seen.range_log).all()


@pytest.mark.parametrize("found", [True, False])
def test_finding_all_or_none_gives_a_model_that_is_finite(found):
    visibility = ObjectVisibility(("chair",) * 30, *np.full((3, 30), 0.5))
    fitted = fit_detection(visibility, np.full(30, found))
    (chance,) = fitted.probability(("chair",), np.array([0.5]))
    assert chance > 0.95 if found else chance < 0.05


def test_nothing_seen_gives_a_model():
    empty = Detections.empty()
    sensor = fit_sensor(
        observe([SensorSample(empty, ObjectVisibility((), *np.zeros((3, 0))), empty)]),
        {"salframe": "0", "detector": {}, "data": {}},
    )
    assert (sensor.provenance.objects, sensor.false_objects.per_panorama, sensor.errors.bearing_rad) == (0, 0, 0)


def test_robust_deviation_leaves_outliers_alone():
    values = np.random.default_rng(0).normal(3, 2, 4000)
    values[:200] = 1e6
    assert robust_deviation(values) == pytest.approx(2, rel=0.15)
    assert robust_deviation(np.array([np.nan])) == 0
