from __future__ import annotations

import hashlib
import importlib.util
import shutil

import numpy as np
import pytest
from conformance import conforms
from salframe_keypoints.localizer import Keypoints
from salframe_keypoints.loftr_compact import FOLDER, STATE

from salframe.framework.components.identity import identity
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, RequirementMissing, UnknownName, WeightsError
from salframe.framework.files.cache import Cache
from salframe.framework.validation import validate
from salframe.localization.describing import describe_frame
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_2d, pose_errors
from salframe.panoramas.panorama import Panorama

TRAINED = [name for name in registry().names("feature-matcher") if registry().get("feature-matcher", name).weights]


def slow(kind: str):
    return pytest.param(kind, marks=pytest.mark.slow)


QUERY = pose_2d(0.6, -0.4, 2.2, z_m=0.05)


@pytest.fixture(scope="module")
def references(rooms):
    return [room.reference_frame(f"m{i}", pose_2d(0.1 * i, 0.0, 0.3 * i), f"room {i}") for i, room in enumerate(rooms)]


@pytest.fixture(scope="module")
def query(rooms):
    return rooms[1].query(QUERY)


@pytest.fixture(scope="module")
def make(configure):
    return lambda kind="sift", **settings: Keypoints(configure(kind, **settings))


@pytest.fixture(scope="module")
def sift(make, references):
    localizer = make()
    return LocalizationMap.build(localizer, references)


@pytest.mark.parametrize("kind", ["sift", "xfeat"])
def test_the_room_is_found_and_the_pose_is_right_to_centimetres(make, kind, references, query):
    localizer = make(kind)
    built = LocalizationMap.build(localizer, references)
    answer = built.localize(query)
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
    opened = LocalizationMap.open(tmp_path, make())
    np.testing.assert_array_equal(opened.localize(query).T_world_query, sift.localize(query).T_world_query)


def test_only_the_map_needs_range(sift, rooms):
    answer = sift.localize(rooms[1].query(QUERY, with_range=False))
    assert pose_errors(answer.T_world_query, QUERY)[0] < 0.02


def test_a_map_without_range_gives_the_place_and_no_pose(make, rooms, query):
    localizer = make()
    built = LocalizationMap.build(
        localizer,
        [room.reference_frame(f"m{i}", np.eye(4), f"room {i}", with_range=False) for i, room in enumerate(rooms)],
    )
    answer = built.localize(query)
    assert (answer.status, answer.T_world_query, answer.places[0].place) == ("no-pose", None, "room 1")


def test_a_place_that_is_not_in_the_map_has_no_pose(make, sift, references, query):
    localizer = make()
    built = LocalizationMap.build(localizer, [references[0], references[2]])
    answer = built.localize(query)
    assert answer.status == "no-pose"
    assert len(answer.places) == 2


def test_a_blank_panorama_has_no_features(sift):
    blank = Panorama("blank", np.full((64, 128, 3), 90, np.uint8))
    answer = sift.localize(QueryFrame("blank", lambda: blank))
    assert (answer.status, answer.places, answer.T_world_query) == ("no-features", (), None)


def test_frames_off_the_shortlist_are_ranked_but_not_matched(make, references, query):
    localizer = make(shortlist=1)
    built = LocalizationMap.build(localizer, references)
    matched = []
    match = localizer._matcher.match
    localizer._matcher.match = lambda view, reference: matched.append(1) or match(view, reference)
    answer = built.localize(query)
    assert len(matched) == 6
    assert answer.status == "ok"
    assert [place.score > 1 for place in answer.places] == [True, False, False]


def test_the_shortlist_takes_no_network_unless_it_is_set():
    assert Keypoints.Config().shortlist_network is None
    assert Keypoints.Config(shortlist_network={}).shortlist_network.kind == "efficientnet-lite0"


@pytest.mark.parametrize("kind", ["tokens", "network"])
def test_the_shortlist_may_be_made_by_something_else_than_sift(make, write_network, references, query, kind):
    """The matches and the pose are those of the matcher, whatever finds its candidates."""
    from onnx import helper

    settings = {"features": {"kind": "loftr-compact", "pooled": "tokens"}}
    if kind == "network":
        same = write_network("same.onnx", [helper.make_node("Identity", ["x"], ["y"])])
        settings = {"features": "loftr-compact", "shortlist_network": {"kind": "onnx", "model": same, "size_px": 32}}
    chosen = Keypoints.Config(view_width_px=320, view_height_px=240, shortlist=1, **settings)
    localizer = Keypoints(chosen)
    built = LocalizationMap.build(localizer, references)
    described = localizer.describe(query.load())
    assert ("global" in described) == (kind == "network")
    answer = built.localize(query)
    assert answer.status == "ok"
    assert answer.places[0].place == "room 1"
    assert pose_errors(answer.T_world_query, QUERY)[0] < 0.1


def test_exhaustive_matching_agrees_with_the_shortlist(make, rooms, query):
    poses = [pose_2d(0.0, 0.1, 0.3), pose_2d(0.5, 0.1, -0.7)]
    references = [
        room.reference_frame(f"m{i}{j}", poses[j], f"room {i}", height=256)
        for i, room in enumerate(rooms)
        for j in range(2)
    ]
    answers = []
    for shortlist in (2, None):
        localizer = make(shortlist=shortlist, view_width_px=240, view_height_px=176)
        built = LocalizationMap.build(localizer, references)
        answers.append(built.localize(query))
    short, exhaustive = answers
    assert (short.status, short.places[0].place) == ("ok", "room 1")
    assert short.places[0] == exhaustive.places[0]
    np.testing.assert_array_equal(short.T_world_query, exhaustive.T_world_query)
    assert [place.score > 1 for place in short.places] != [True] * 3
    assert [place.score > 1 for place in exhaustive.places] == [True] * 3


@pytest.mark.parametrize(
    "kind", ["sift", "xfeat", "xfeat-nn", *map(slow, ("aliked-nn", "aliked-lightglue", "disk-lightglue"))]
)
def test_one_map_frame_with_and_without_range_and_a_blank_query(make, kind, rooms):
    localizer = make(kind, view_width_px=240, view_height_px=176)
    query = rooms[1].query(QUERY)
    built = LocalizationMap.build(localizer, [rooms[1].reference_frame("m", pose_2d(0.1, 0.0, 0.3), "room 1")])
    answer = built.localize(query)
    assert (answer.status, [place.place for place in answer.places]) == ("ok", ["room 1"])
    translation, rotation = pose_errors(answer.T_world_query, QUERY)
    assert translation < 0.02
    assert rotation < np.deg2rad(0.2)
    for value in (0, 90):
        blank = Panorama("blank", np.full((256, 512, 3), value, np.uint8))
        answer = built.localize(QueryFrame("blank", lambda blank=blank: blank))
        assert answer.status in ("no-features", "no-pose")
        assert answer.T_world_query is None

    built = LocalizationMap.build(
        localizer, [rooms[1].reference_frame("m", pose_2d(0.1, 0.0, 0.3), "room 1", with_range=False)]
    )
    answer = built.localize(query)
    assert (answer.status, answer.T_world_query, answer.places[0].place) == ("no-pose", None, "room 1")


def test_the_median_rotation_error_is_below_a_tenth_of_a_degree(sift, rooms):
    rng = np.random.default_rng(360)
    poses = [pose_2d(*rng.uniform(-1.2, 1.2, 2), rng.uniform(-3, 3), z_m=rng.uniform(-0.1, 0.1)) for _ in range(5)]
    answers = [sift.localize(rooms[0].query(pose, height=256)).T_world_query for pose in poses]
    assert np.median([pose_errors(answer, pose)[1] for answer, pose in zip(answers, poses, strict=True)]) < np.deg2rad(
        0.1
    )


def test_points_are_where_their_range_was_measured(make, references):
    localizer = make()
    description = localizer.describe(references[0].load())
    points = np.concatenate(localizer._lift(description)) + references[0].T_world_pano[:3, 3]
    # every point of an empty box lies on a wall: 3.5, 2, 1.3 ahead and -3, -2.5, -1.5 behind
    distance = np.minimum(np.abs(points - (3.5, 2.0, 1.3)), np.abs(points - (-3.0, -2.5, -1.5))).min(1)
    assert np.quantile(distance, 0.99) < 0.02  # half a pixel of the panorama on a slanted wall


def test_nothing_is_described_outside_the_part_that_was_seen(make, references):
    whole = references[0].load()
    valid = np.zeros(whole.range_m.shape, bool)
    valid[:, 256:768] = True  # the half ahead
    half = Panorama("half", np.where(valid[..., None], whole.rgb, 0), whole.range_m, valid)
    localizer = make()
    description = localizer.describe(half)
    points = np.concatenate(localizer._lift(description))
    assert len(points) > 200
    assert (points[:, 0] > 0).all()
    assert len(localizer.describe(whole)["range_m"]) > 1.5 * len(points)


def test_descriptions_are_cached_by_what_they_depend_on(make, references, tmp_path):
    cache = Cache(tmp_path)
    description, seconds = describe_frame(make(), references[0], cache, "rooms")
    again, remembered = describe_frame(make(min_inliers=20, shortlist=2), references[0], cache, "rooms")
    assert remembered == seconds
    np.testing.assert_array_equal(again["features"], description["features"])
    assert len(list(tmp_path.rglob("*.npz"))) == 1
    describe_frame(make(features={"max_keypoints": 100}), references[0], cache, "rooms")
    assert len(list(tmp_path.rglob("*.npz"))) == 2


def test_sift_needs_no_torch_and_xfeat_says_that_it_does(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    Keypoints.check(Keypoints.Config(features="sift"))
    with pytest.raises(
        RequirementMissing,
        match=r"xfeat needs the Python packages torch and kornia, which are not installed: "
        r"pip install 'salframe\[keypoints\]'",
    ):
        Keypoints.check(Keypoints.Config(features="xfeat"))


@pytest.mark.parametrize("kind", TRAINED)
def test_weights_of_another_hash_are_told_with_both(kind, monkeypatch, tmp_path):
    pytest.importorskip("kornia")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    (weights,) = registry().get("feature-matcher", kind).weights
    weights.directory.mkdir(parents=True)
    for file in weights.files:
        (weights.directory / file.name).write_bytes(b"other")
    received = hashlib.sha256(b"other").hexdigest()
    with pytest.raises(
        WeightsError,
        match=f"has the sha256 hash {received}, expected {weights.files[0].sha256}; .*weights fetch {kind}$",
    ):
        Keypoints(Keypoints.Config(features=kind))


def test_missing_weights_name_the_path_the_hash_and_the_command(monkeypatch, tmp_path):
    pytest.importorskip("kornia")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    with pytest.raises(WeightsError) as caught:
        Keypoints(Keypoints.Config(features="loftr"))
    expected = f"{tmp_path}/weights/loftr/loftr_indoor_ds_new.ckpt is missing (sha256 be9ff88b"
    assert expected in str(caught.value)
    assert str(caught.value).endswith("salframe weights fetch loftr")


def test_an_unknown_matcher_is_named_with_the_known_ones():
    with pytest.raises(UnknownName, match=r"unknown feature-matcher 'xfeet', did you mean 'xfeat'\? Known: aliked"):
        validate(Keypoints.Config, {"features": "xfeet"}, "method")


def test_views_that_a_matcher_cannot_take_are_refused_at_construction():
    with pytest.raises(
        ConfigError, match="view_width_px and view_height_px are 640 and 480, expected multiples of 8 up to 512"
    ):
        Keypoints(Keypoints.Config(features="loftr-compact", view_width_px=640, view_height_px=480))


def test_what_matters_to_matching_only_is_no_part_of_a_description(configure):
    base = Keypoints(configure("sift"))
    for change in ({"words": 32}, {"shortlist": None}, {"inlier_deg": 2}, {"hypotheses": 9}, {"min_inliers": 4}):
        config = configure("sift", **change)
        assert identity(config) != identity(base.config)
        assert Keypoints(config).describe_identity() == base.describe_identity()
    for change in ({"views": 4}, {"hfov_deg": 80}, {"features": {"max_keypoints": 99}}):
        assert Keypoints(configure("sift", **change)).describe_identity() != base.describe_identity()


def test_descriptions_are_known_by_the_content_of_a_checkpoint(configure, tmp_path):
    """A modified folder is another checkpoint; a copy is the same."""
    shutil.copytree(FOLDER, tmp_path / "mine")
    shutil.copytree(FOLDER, tmp_path / "copy")
    size = {"view_width_px": 320, "view_height_px": 240}

    def cache_key(folder):
        config = configure("loftr-compact", {"checkpoint": folder}, **size)
        return identity(config), Keypoints(config).describe_identity()

    before = cache_key(tmp_path / "mine")
    assert cache_key(tmp_path / "copy") == before
    (tmp_path / "mine" / STATE).write_bytes(b"another training")
    after = cache_key(tmp_path / "mine")
    assert before[0] != after[0]
    assert before[1] != after[1]


def test_fetched_weights_are_part_of_the_identity():
    """The hashes of the weights replace that of a checkpoint."""
    (weights,) = registry().get("feature-matcher", "loftr-compact").weights
    features = identity(Keypoints.Config(features="loftr-compact"))["settings"]["features"]
    assert features["weights"] == [file.sha256 for file in weights.files]


def test_a_third_partys_matcher_is_found_and_used(monkeypatch, rooms):
    """The plugin loads first, and no code of salframe names it."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "matcher_plugin,salframe_keypoints")
    registry.cache_clear()
    try:
        assert registry().failures == []
        localizer = Keypoints(Keypoints.Config(features={"kind": "corners", "count": 200}, min_inliers=15))
        assert conforms(registry().get("feature-matcher", "corners"))
        built = LocalizationMap.build(
            localizer, [room.reference_frame(f"m{i}", np.eye(4), f"room {i}") for i, room in enumerate(rooms)]
        )
        answer = built.localize(rooms[1].query(pose_2d(0.05, 0.02, 0.1)))
    finally:
        registry.cache_clear()
    assert (answer.status, answer.places[0].place) == ("ok", "room 1")
    assert pose_errors(answer.T_world_query, pose_2d(0.05, 0.02, 0.1))[0] < 0.05
