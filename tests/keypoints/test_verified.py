"""The localizer `verified-places` over a ranking by names, in three textured rooms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conformance import conforms
from salframe_keypoints.verified import VerifiedPlaces

from salframe.framework.components.registry import registry
from salframe.framework.config import read_yaml
from salframe.framework.validation import validate
from salframe.localization.describing import describe_frame
from salframe.localization.map import LocalizationMap
from salframe.panoramas.geometry import pose_2d, pose_errors

METHODS = Path(__file__).parents[2] / "configs" / "methods"
QUERY = pose_2d(0.6, -0.4, 2.2, z_m=0.05)


@pytest.fixture(autouse=True)
def plugins(monkeypatch):
    """The components of ranking_plugin, and those that the default settings name."""
    monkeypatch.setenv(
        "SALFRAME_PLUGINS", "salframe_keypoints,salframe_image,salframe_graphs,salframe_annotations,ranking_plugin"
    )
    registry.cache_clear()
    yield
    registry.cache_clear()


def make(**settings) -> VerifiedPlaces:
    return VerifiedPlaces(validate(VerifiedPlaces.Config, {"ranking": "alphabet", **settings}, "verified-places"))


@pytest.fixture
def references(rooms):
    """Two frames in each room; the second one stands nearer to the query."""
    poses = pose_2d(-1.5, 0.5, 1.0), pose_2d(0.3, 0.0, 0.3)
    return [
        room.reference_frame(f"m{number}{turn}", pose, f"room {number}")
        for number, room in enumerate(rooms)
        for turn, pose in enumerate(poses)
    ]


def test_keypoints_correct_the_ranking_and_give_the_pose(rooms, references):
    built = LocalizationMap.build(make(), references)
    answer = built.localize(rooms[2].query(QUERY))
    assert (answer.status, answer.places[0].place) == ("ok", "room 2")
    assert [place.place for place in answer.places[1:]] == ["room 0", "room 1"]
    translation_m, rotation_rad = pose_errors(answer.T_world_query, QUERY)
    assert translation_m < 0.02
    assert rotation_rad < np.deg2rad(0.1)


def test_the_gain_is_the_weighted_logarithm_of_the_inliers(rooms, references):
    """The inliers are those that `keypoints` counts: its score is their number plus a similarity below 1."""
    query = rooms[1].query(QUERY)
    keypoints = registry().build("localizer", registry().get("localizer", "keypoints").Config(features="sift"))
    counted = LocalizationMap.build(keypoints, references).localize(query)
    inliers = {place.place: int(place.score) for place in counted.places}
    assert inliers["room 1"] > 100
    answer = LocalizationMap.build(make(weight=2.0, min_inliers=40), references).localize(query)
    scores = {place.place: place.score for place in answer.places}
    assert scores["room 1"] == pytest.approx(-1 + 2 * np.log(1 + inliers["room 1"] / 40))
    assert answer.places[0].place == "room 1"


@pytest.mark.parametrize("changes", [{"places": 1}, {"weight": 0.0}])
def test_without_verification_the_ranking_stays(rooms, references, changes):
    answer = LocalizationMap.build(make(**changes), references).localize(rooms[2].query(QUERY))
    assert [place.place for place in answer.places] == ["room 0", "room 1", "room 2"]
    assert (answer.status, answer.T_world_query) == ("no-pose", None)


def test_too_few_inliers_give_no_pose(rooms, references):
    answer = LocalizationMap.build(make(min_inliers=100_000, weight=1e4), references).localize(rooms[2].query(QUERY))
    assert (answer.status, answer.places[0].place) == ("no-pose", "room 2")


def test_joined_views_have_the_keypoints_of_the_last(rooms, references):
    built = LocalizationMap.build(make(), references)
    descriptions = [
        describe_frame(built.localizer, query)[0] for query in (rooms[0].query(QUERY), rooms[2].query(QUERY))
    ]
    motions = np.tile(np.eye(4), (2, 1, 1))
    joined = built.localizer.join(descriptions, motions, built.localizer.odometry)
    np.testing.assert_array_equal(joined["keypoints_points_px"], descriptions[1]["keypoints_points_px"])
    np.testing.assert_allclose(
        joined["ranking_mean"], np.mean([description["ranking_mean"] for description in descriptions], 0)
    )
    assert built.localizer.match(joined).places[0].place == "room 2"


def test_a_saved_map_answers_alike(rooms, references, tmp_path):
    built, query = LocalizationMap.build(make(), references), rooms[1].query(QUERY)
    built.save(tmp_path / "map")
    opened = LocalizationMap.open(tmp_path / "map")
    first, second = built.localize(query), opened.localize(query)
    assert first.places == second.places
    np.testing.assert_array_equal(first.T_world_query, second.T_world_query)


def test_the_preset_ranks_like_proposed_appearance():
    verified, preset = (read_yaml(METHODS / f"{name}.yaml") for name in ("verified", "proposed-appearance"))
    for part in ("evidence", "weights"):
        assert verified["ranking"][part] == preset[part]


@pytest.mark.slow
def test_it_keeps_the_rules_of_a_localizer():
    assert conforms(VerifiedPlaces, make().config)
