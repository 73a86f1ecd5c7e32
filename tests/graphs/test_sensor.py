"""Sensor models made by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.graphs.sensor import (
    DetectionModel,
    Errors,
    FalseObjects,
    Provenance,
    SensorModel,
    quantiles,
    read_sensor,
    value_at,
)

FOUND = DetectionModel(
    intercept=1.0,
    per_log_solid_angle=0.5,
    per_log_range=-2.0,
    per_hidden_share=-3.0,
    reference_solid_angle_sr=0.1,
    reference_range_m=2.0,
    reference_hidden_share=0.1,
    offsets={"sofa": 0.7},
    offset_deviation=0.5,
)


def model(**changes):
    fields = {
        "provenance": Provenance(salframe="0", detector={}, data={}, panoramas=1, objects=3, detected=2),
        "detection": FOUND,
        "confusion": {},
        "false_objects": FalseObjects(per_panorama=0, labels={}, range_m=(), elevation_rad=(), size_m=()),
        "errors": Errors(bearing_rad=0, range_share=0, size_log=0, height_m=0),
    }
    return SensorModel(**{**fields, **changes})


def test_probability_is_the_logistic_function_of_its_terms():
    found = FOUND.probability(("table", "couch"), np.array([0.2, 0.1]), np.array([4.0, 2.0]), np.array([0.6, 0.1]))
    logit = np.array([1 + 0.5 * np.log(2) - 2 * np.log(2) - 3 * 0.5, 1 + 0.7])  # a couch is a sofa
    np.testing.assert_allclose(found, 1 / (1 + np.exp(-logit)))


def test_what_is_unknown_is_taken_for_its_reference():
    known = FOUND.probability(("table",), np.array([0.3]), np.array([2.0]), np.array([0.1]))
    np.testing.assert_allclose(FOUND.probability(("table",), np.array([0.3]), np.array([np.nan])), known)


def test_label_probabilities_are_smoothed_counts():
    """Of 8 found chairs 6 are called chair; 10 of 13 labels are right, the wrong ones are two stools and a bench."""
    sensor = model(confusion={"chair": {"chair": 6, "stool": 2}, "desk": {"desk": 4, "bench": 1}})
    said = sensor.label_probabilities("chair")
    assert sensor.right_share == pytest.approx(10 / 13)
    assert said == pytest.approx(
        {"chair": (6 + 10 / 13) / 9, "stool": (2 + 3 / 13 * 2 / 3) / 9, "bench": (3 / 13 / 3) / 9}
    )
    assert sum(said.values()) == pytest.approx(1)


def test_a_label_that_was_not_found_is_called_as_its_group_or_by_its_common_name():
    sensor = model(confusion={"tv stand": {"cabinet": 3, "desk": 1}, "desk": {"desk": 6}})
    of_group = sensor.label_probabilities("kitchen cabinet")
    assert of_group["cabinet"] == pytest.approx((3 + 0.9) / 5)
    assert sensor.label_probabilities("couch") == pytest.approx({"sofa": 0.9, "desk": 0.1})
    assert model().label_probabilities("couch") == {"sofa": 1.0}


def test_quantiles_give_a_distribution_back():
    values = np.random.default_rng(0).gamma(2, size=4000)
    kept = quantiles(values)
    assert len(kept) == 11
    assert (kept[0], kept[-1]) == pytest.approx((values.min(), values.max()), abs=1e-4)
    drawn = value_at(kept, (np.arange(4000) + 0.5) / 4000)
    assert np.median(drawn) == pytest.approx(np.median(values), rel=1e-3)
    assert np.quantile(drawn, 0.85) == pytest.approx(np.quantile(values, 0.85), rel=0.03)
    assert quantiles(values[:0]) == ()


def test_a_file_gives_the_model_back(tmp_path):
    sensor = model(confusion={"chair": {"chair": 6}})
    path = tmp_path / "sensor.json"
    path.write_text(json.dumps(sensor.model_dump(mode="json")))
    assert read_sensor(path) == sensor


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1]", r"has the format None, expected 'salframe sensor 2': write a sensor file with"),
        ('{"format": "salframe sensor 9"}', r"has the format 'salframe sensor 9', expected 'salframe sensor 2'"),
        ("{", "is not JSON"),
        ('{"format": "salframe sensor 2"}', r"the required key provenance is missing; .*detection is missing"),
    ],
)
def test_what_is_no_sensor_file_is_told_in_one_line(tmp_path, text, message):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(DataError, match=message) as error:
        read_sensor(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("part", "key", "value", "message"),
    [
        ("false_objects", "labels", {"lamp": -3}, "greater than or equal to 0"),
        ("false_objects", "range_m", [-1.0] * 11, "greater than or equal to 0"),
        (
            "false_objects",
            "range_m",
            [1.0, 2.0],
            "received a list of 2 quantiles, expected 11 quantiles or an empty list",
        ),
        ("false_objects", "elevation_rad", [*range(10), 0], "expected values in ascending order"),
        ("false_objects", "per_panorama", 1e9, "less than or equal to 10000"),
        ("confusion", "bed", {"bed": -1}, "greater than or equal to 0"),
        ("errors", "range_share", -0.1, "greater than or equal to 0"),
        ("detection", "intercept", 1e9, "less than or equal to 1000"),
        ("detection", "offsets", {"bed": -1e9}, "greater than or equal to -1000"),
    ],
)
def test_impossible_numbers_of_a_sensor_file_are_refused(tmp_path, part, key, value, message):
    path = tmp_path / "sensor.json"
    content = model(confusion={"chair": {"chair": 6}}).model_dump(mode="json")
    content[part][key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=rf"sensor\.json: key {part}.*{message}"):
        read_sensor(path)
