"""Answers as JSON."""

from __future__ import annotations

import json

import numpy as np
import pytest

from salframe.localization.answer_json import answer_json, covariance_json
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.panoramas.geometry import pose_2d

PLANAR = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, 0.003], [0.002, 0.003, 0.01]])


def test_a_planar_covariance_is_placed_at_x_y_and_the_rotation_about_z():
    content = covariance_json(PLANAR)
    matrix = np.array(content["matrix"])
    rows = [content["axes"].index(axis) for axis in ("x", "y", "rotation_z")]
    assert (matrix[np.ix_(rows, rows)] == PLANAR).all()
    assert np.count_nonzero(matrix) == 9
    assert content["estimated"] == ["x", "y", "rotation_z"]
    assert content["frame"] == "world"


def test_a_spatial_covariance_is_unchanged():
    spatial = np.diag([1.0, 2, 3, 4, 5, 6])
    content = covariance_json(spatial)
    assert content["matrix"] == spatial.tolist()
    assert content["estimated"] == content["axes"]


@pytest.mark.parametrize("covariance", [None, np.full((3, 3), np.inf), np.full((6, 6), np.nan)])
def test_an_unknown_covariance_is_null(covariance):
    assert covariance_json(covariance) is None


def test_an_answer_is_json():
    places = (RankedPlace("f", "kitchen", 3.0, 0.7), RankedPlace("g", "hall", 1.0, 0.2))
    answer = Localization(places, pose_2d(1, 2, np.pi / 2, 1.5), LocalizationStatus.OK, PLANAR, None, 0.1, ("note",))
    content = json.loads(json.dumps(answer_json(answer), allow_nan=False))
    assert content["pose"] == {"x_m": 1, "y_m": 2, "z_m": 1.5, "yaw_deg": pytest.approx(90)}
    assert (content["status"], content["accepted"], content["heading_deg"]) == ("ok", True, pytest.approx(90))
    assert content["places"][0] == {"place": "kitchen", "frame": "f", "score": 3.0, "probability": 0.7}
    failed = answer_json(Localization((), None, LocalizationStatus.NO_OBJECTS))
    assert [failed[key] for key in ("pose", "T_world_query", "covariance", "heading_deg")] == [None] * 4
