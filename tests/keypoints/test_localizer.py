from __future__ import annotations

import hashlib
import importlib.util

import numpy as np
import pytest
from salframe_keypoints.localizer import PAIRS, Keypoints

from salframe.framework.cache import Cache
from salframe.framework.config import validate
from salframe.framework.errors import ConfigError, RequirementMissing, WeightsMissing
from salframe.panoramas.frames import Frame
from salframe.panoramas.geometry import pose_2d, pose_errors
from salframe.panoramas.panorama import Panorama


def slow(pair: str):
    return pytest.param(pair, marks=pytest.mark.slow)


QUERY = pose_2d(0.6, -0.4, 2.2, z_m=0.05)


@pytest.fixture(scope="module")
def mapping(rooms):
    return [room.frame(f"m{i}", pose_2d(0.1 * i, 0.0, 0.3 * i), f"room {i}") for i, room in enumerate(rooms)]


@pytest.fixture(scope="module")
def query(rooms):
    return rooms[1].frame("query", QUERY)


@pytest.fixture(scope="module")
def make(configure):
    return lambda pair="sift", **settings: Keypoints(configure(pair, **settings))


@pytest.fixture(scope="module")
def sift(make, mapping):
    localizer = make()
    localizer.build(mapping)
    return localizer


@pytest.mark.parametrize("pair", ["sift", "xfeat"])
def test_the_room_is_found_and_the_pose_is_right_to_centimetres(make, pair, mapping, query):
    localizer = make(pair)
    localizer.build(mapping)
    answer = localizer.localize(query)
    assert answer.status == "ok"
    assert answer.places[0].place == "room 1"
    assert answer.places[0].score > 20 * answer.places[1].score
    translation, rotation = pose_errors(answer.T_world_query, QUERY)
    assert translation < 0.02
    assert rotation < np.deg2rad(0.1)


def test_the_same_query_has_the_same_answer(sift, query):
    first, second = sift.localize(query), sift.localize(query)
    assert first.places == second.places
    np.testing.assert_array_equal(first.T_world_query, second.T_world_query)


def test_a_saved_map_answers_alike(make, sift, query, tmp_path):
    sift.save(tmp_path)
    loaded = make()
    loaded.load(tmp_path)
    np.testing.assert_array_equal(loaded.localize(query).T_world_query, sift.localize(query).T_world_query)


def test_only_the_map_needs_range(sift, rooms):
    answer = sift.localize(rooms[1].frame("query", QUERY, with_range=False))
    assert pose_errors(answer.T_world_query, QUERY)[0] < 0.02


def test_a_map_without_range_gives_the_place_and_no_pose(make, rooms, query):
    localizer = make()
    localizer.build([room.frame(f"m{i}", np.eye(4), f"room {i}", with_range=False) for i, room in enumerate(rooms)])
    answer = localizer.localize(query)
    assert (answer.status, answer.T_world_query, answer.places[0].place) == ("no-pose", None, "room 1")


def test_a_place_that_is_not_in_the_map_has_no_pose(make, sift, mapping, query):
    localizer = make()
    localizer.build([mapping[0], mapping[2]])
    answer = localizer.localize(query)
    assert answer.status == "no-pose"
    assert len(answer.places) == 2


def test_a_blank_panorama_has_no_features(sift):
    blank = Panorama("blank", np.full((64, 128, 3), 90, np.uint8))
    answer = sift.localize(Frame("blank", lambda: blank))
    assert (answer.status, answer.places, answer.T_world_query) == ("no-features", (), None)


def test_frames_off_the_shortlist_are_ranked_but_not_matched(make, mapping, query):
    localizer = make(shortlist=1)
    localizer.build(mapping)
    matched = []
    match = localizer._pair.match
    localizer._pair.match = lambda seen, reference: matched.append(1) or match(seen, reference)
    answer = localizer.localize(query)
    assert len(matched) == 6
    assert answer.status == "ok"
    assert [place.score > 1 for place in answer.places] == [True, False, False]


def test_exhaustive_matching_agrees_with_the_shortlist(make, rooms, query):
    poses = [pose_2d(0.0, 0.1, 0.3), pose_2d(0.5, 0.1, -0.7)]
    mapping = [
        room.frame(f"m{i}{j}", poses[j], f"room {i}", height=256) for i, room in enumerate(rooms) for j in range(2)
    ]
    answers = []
    for shortlist in (2, None):
        localizer = make(shortlist=shortlist, view_width_px=240, view_height_px=176)
        localizer.build(mapping)
        answers.append(localizer.localize(query))
    short, exhaustive = answers
    assert (short.status, short.places[0].place) == ("ok", "room 1")
    assert short.places[0] == exhaustive.places[0]
    np.testing.assert_array_equal(short.T_world_query, exhaustive.T_world_query)
    assert [place.score > 1 for place in short.places] != [True] * 3
    assert [place.score > 1 for place in exhaustive.places] == [True] * 3


@pytest.mark.parametrize(
    "pair", ["sift", "xfeat", "xfeat-nn", *map(slow, ("aliked-nn", "aliked-lightglue", "disk-lightglue"))]
)
def test_one_map_frame_with_and_without_range_and_a_blank_query(make, pair, rooms):
    localizer = make(pair, view_width_px=240, view_height_px=176)
    query = rooms[1].frame("query", QUERY)
    localizer.build([rooms[1].frame("m", pose_2d(0.1, 0.0, 0.3), "room 1")])
    answer = localizer.localize(query)
    assert (answer.status, [place.place for place in answer.places]) == ("ok", ["room 1"])
    translation, rotation = pose_errors(answer.T_world_query, QUERY)
    assert translation < 0.02
    assert rotation < np.deg2rad(0.2)
    for value in (0, 90):
        blank = Panorama("blank", np.full((256, 512, 3), value, np.uint8))
        answer = localizer.localize(Frame("blank", lambda blank=blank: blank))
        assert answer.status in ("no-features", "no-pose")
        assert answer.T_world_query is None

    localizer.build([rooms[1].frame("m", pose_2d(0.1, 0.0, 0.3), "room 1", with_range=False)])
    answer = localizer.localize(query)
    assert (answer.status, answer.T_world_query, answer.places[0].place) == ("no-pose", None, "room 1")


def test_the_median_rotation_error_is_below_a_tenth_of_a_degree(sift, rooms):
    rng = np.random.default_rng(360)
    poses = [pose_2d(*rng.uniform(-1.2, 1.2, 2), rng.uniform(-3, 3), z_m=rng.uniform(-0.1, 0.1)) for _ in range(5)]
    answers = [sift.localize(rooms[0].frame("query", pose, height=256)).T_world_query for pose in poses]
    assert np.median([pose_errors(answer, pose)[1] for answer, pose in zip(answers, poses, strict=True)]) < np.deg2rad(
        0.1
    )


def test_points_are_where_their_range_was_measured(make, mapping):
    localizer = make()
    description = localizer.describe(mapping[0].load())
    points = np.concatenate(localizer._lift(description)) + mapping[0].T_world_pano[:3, 3]
    # every point of an empty box lies on a wall: 3.5, 2, 1.3 ahead and -3, -2.5, -1.5 behind
    distance = np.minimum(np.abs(points - (3.5, 2.0, 1.3)), np.abs(points - (-3.0, -2.5, -1.5))).min(1)
    assert np.quantile(distance, 0.99) < 0.02  # half a pixel of the panorama on a slanted wall


def test_nothing_is_described_outside_the_part_that_was_seen(make, mapping):
    whole = mapping[0].load()
    valid = np.zeros(whole.range_m.shape, bool)
    valid[:, 256:768] = True  # the half ahead
    half = Panorama("half", np.where(valid[..., None], whole.rgb, 0), whole.range_m, valid)
    localizer = make()
    description = localizer.describe(half)
    points = np.concatenate(localizer._lift(description))
    assert len(points) > 200
    assert (points[:, 0] > 0).all()
    assert len(localizer.describe(whole)["range_m"]) > 1.5 * len(points)


def test_descriptions_are_cached_by_what_they_depend_on(make, mapping, tmp_path):
    cache = Cache(tmp_path)
    description, seconds = make().describe_frame(mapping[0], cache, "rooms")
    again, remembered = make(min_inliers=20, shortlist=2).describe_frame(mapping[0], cache, "rooms")
    assert remembered == seconds
    np.testing.assert_array_equal(again["features"], description["features"])
    assert len(list(tmp_path.rglob("*.npz"))) == 1
    make(max_keypoints=100).describe_frame(mapping[0], cache, "rooms")
    assert len(list(tmp_path.rglob("*.npz"))) == 2


def test_sift_needs_no_torch_and_xfeat_says_that_it_does(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    Keypoints.check(Keypoints.Config(pair="sift"))
    with pytest.raises(
        RequirementMissing, match=r"xfeat needs torch, kornia, not installed: pip install 'salframe\[keypoints\]'"
    ):
        Keypoints.check(Keypoints.Config(pair="xfeat"))


@pytest.mark.parametrize("pair", [name for name in PAIRS if PAIRS[name].weights])
def test_weights_of_another_hash_are_told_with_both(pair, monkeypatch, tmp_path):
    pytest.importorskip("kornia")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    (weights,) = PAIRS[pair].weights
    weights.directory.mkdir(parents=True)
    (weights.directory / weights.files[0].name).write_bytes(b"other")
    received = hashlib.sha256(b"other").hexdigest()
    with pytest.raises(
        WeightsMissing, match=f"has sha256 {received}, expected {weights.files[0].sha256}; .*weights fetch {pair}$"
    ):
        Keypoints.check(Keypoints.Config(pair=pair))


def test_missing_weights_name_the_path_the_hash_and_the_command(monkeypatch, tmp_path):
    pytest.importorskip("kornia")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    with pytest.raises(WeightsMissing) as caught:
        Keypoints(Keypoints.Config(pair="loftr"))
    expected = f"{tmp_path}/weights/loftr/loftr_indoor_ds_new.ckpt (sha256 be9ff88b"
    assert expected in str(caught.value)
    assert str(caught.value).endswith("salframe weights fetch loftr")


def test_an_unknown_pair_is_named_with_the_known_ones():
    with pytest.raises(
        ConfigError, match=r"method.pair: received 'xfeet', expected 'xfeat', .*'loftr' or 'loftr-compact'"
    ):
        validate(Keypoints.Config, {"pair": "xfeet"}, "method")
