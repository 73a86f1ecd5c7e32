from __future__ import annotations

import numpy as np
import pytest
from compass import HEIGHT, compass
from conformance import conforms
from salframe_image.appearance import AppearanceEvidence

from salframe.framework.files.columns import read_columns, write_columns
from salframe.localization.evidence_model import PlaceFrames, PlaceHypotheses
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama

HALL = np.array([[1, 0], [0, 1], [-1, 0]])
CELLAR = np.array([[0, 1], [1, 0], [0, -1]])  # the same colours in reverse
PLACES = PlaceFrames(["hall", "cellar", "shaft"], np.arange(3), np.array([0, 1, 2, 3]), np.array([0, 2, 3, 4]))
"""The hall has two frames, and the frame of the shaft has no colour."""
STEP_RAD = np.pi / 6
FOCAL = 16 / np.tan(np.deg2rad(60))
"""Focal length of the views in pixels: 32 pixels for 120 degrees."""


@pytest.fixture
def make(same_network):
    """Returns the evidence with a network whose features are the colour (grey - 127) / 128, averaged over a view.
    Negative means are 0."""

    def evidence(**settings) -> AppearanceEvidence:
        network = {"kind": "onnx", "model": same_network, "size_px": 32}
        return AppearanceEvidence(AppearanceEvidence.Config(network=network, power=1.0, **settings))

    return evidence


def hypotheses(place=(0, 1, 2)) -> PlaceHypotheses:
    place = np.array(place)
    return PlaceHypotheses(place, np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(len(place)))


def map_panoramas():
    """The four frames of PLACES. The second frame of the hall is dark."""
    dark = np.zeros((HEIGHT, 2 * HEIGHT, 3), np.uint8)
    return [
        compass(HALL, pose_2d(0, 0, 0.3)),
        Panorama("dark", dark),
        compass(CELLAR),
        Panorama("without colour", annotations=None, range_m=np.ones((HEIGHT, 2 * HEIGHT), np.float32)),
    ]


def indexed(evidence):
    poses = np.tile(np.eye(4)[:3], (4, 1, 1))
    packed = [evidence.pack(evidence.describe(panorama, {})) for panorama in map_panoramas()]
    evidence.index([evidence.unpack(row) for row in packed], PLACES, poses)
    return evidence


def mean_colours(colours, yaw_rad, seen_rad=np.pi):
    """Return the (12, 3) mean of max(colour, 0) of each view of a `compass`, from explicit rays.

    Pixels farther than `seen_rad` from azimuth 0 are grey, which is 0. The second result is their share (12,).
    """
    x = (np.arange(32) + 0.5 - 16) / FOCAL
    azimuth = STEP_RAD * np.arange(12)[:, None] - np.arctan(x)
    world = azimuth + yaw_rad
    value = (100 * np.stack([np.cos(world), np.sin(world)], -1) @ colours.T) / 128
    seen = np.abs((azimuth + np.pi) % (2 * np.pi) - np.pi) <= seen_rad
    return (np.maximum(value, 0) * seen[..., None]).mean(1), seen.mean(1)


def mean_cosine(query, weight, reference):
    """Return the weighted mean cosine at the best of the 12 turns, by loops."""

    def unit(rows):
        return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)

    query, reference = unit(query), unit(reference)
    pairs = list(zip(weight, query, range(12), strict=True))
    turns = [sum(w * row @ reference[(view + turn) % 12] for w, row, view in pairs) for turn in range(12)]
    return max(turns) / weight.sum()


@pytest.mark.parametrize("seen_deg", [180, 47, 22.3])
def test_the_column_is_the_mean_cosine_of_the_visible_views(make, seen_deg):
    evidence, seen_rad = indexed(make()), np.deg2rad(seen_deg)
    valid = np.abs(np.linspace(180, -180, 2 * HEIGHT, endpoint=False) - 180 / 256) <= seen_deg
    query = compass(HALL, pose_2d(0, 0, 1.1), None if seen_deg == 180 else np.tile(valid, (HEIGHT, 1)))
    described = evidence.describe(query, {})
    colours, share = mean_colours(HALL, 1.1, seen_rad)
    share[share < 0.02] = 0
    np.testing.assert_allclose(described["appearance_seen"], share, atol=0.065)  # two columns of pixels
    expected = [mean_cosine(colours, share, mean_colours(*place)[0]) for place in ((HALL, 0.3), (CELLAR, 0.0))]
    received = evidence.score(described, hypotheses())["appearance"]
    np.testing.assert_allclose(received[:2], expected, atol=0.02)
    assert received[0] > received[1] + 0.02
    assert received[2] == pytest.approx(received[:2].mean())  # no colour: the mean of the others


def test_hidden_pixels_do_not_count(make):
    evidence = make()
    valid = np.zeros((HEIGHT, 2 * HEIGHT), bool)
    valid[:, HEIGHT // 2 : HEIGHT] = True
    seen = compass(HALL, valid=valid)
    other = Panorama("other", np.where(valid[..., None], seen.rgb, 255 - seen.rgb), valid=valid)
    first, second = (evidence.describe(panorama, {}) for panorama in (seen, other))
    assert 0 < np.count_nonzero(first["appearance_seen"]) < 12
    np.testing.assert_allclose(first["appearance"], second["appearance"], atol=0.02)  # bilinear at the border
    nothing = Panorama("nothing", seen.rgb, valid=np.zeros_like(valid))
    assert evidence.describe(nothing, {}) == {}
    assert evidence.describe(map_panoramas()[3], {}) == {}


def test_a_query_without_colour_has_no_evidence(make):
    evidence = indexed(make())
    assert not evidence.score({}, hypotheses())["appearance"].any()
    evidence.index([{}] * 4, PLACES, np.tile(np.eye(4)[:3], (4, 1, 1)))
    described = evidence.describe(compass(HALL), {})
    assert not evidence.score(described, hypotheses())["appearance"].any()


def test_only_the_named_places_are_compared(make):
    evidence = indexed(make())
    described = evidence.describe(compass(HALL), {})
    whole = evidence.score(described, hypotheses())["appearance"]
    np.testing.assert_allclose(evidence.score(described, hypotheses([1, 1]))["appearance"], whole[[1, 1]], rtol=1e-6)
    np.testing.assert_allclose(evidence.score(described, hypotheses([2, 0, 1]))["appearance"][1:], whole[:2], rtol=1e-6)


def test_joined_views_are_rotated_to_the_last_one(make):
    """A camera turned by two views on the spot: both views show the same, so that their mean is either of them."""
    evidence = indexed(make())
    turned = pose_2d(0, 0, 2 * STEP_RAD)
    first, last = (evidence.describe(compass(HALL, pose), {}) for pose in (None, turned))
    T_last_view = np.stack([np.linalg.inv(turned), np.eye(4)])
    joined = evidence.join([first, last], T_last_view)
    np.testing.assert_allclose(joined["appearance"], 2 * last["appearance"].astype(float), atol=0.02)
    np.testing.assert_array_equal(joined["appearance_seen"], np.full(12, 2.0))
    received, expected = (evidence.score(one, hypotheses())["appearance"] for one in (joined, last))
    np.testing.assert_allclose(received, expected, atol=2e-3)
    unturned = evidence.join([first, last], np.stack([np.eye(4), np.eye(4)]))
    assert evidence.score(unturned, hypotheses())["appearance"][0] < expected[0] - 0.02


def test_joined_views_complete_each_other(make):
    """Two halves of a panorama are nearer to the whole one than one half alone; far and colourless views are left
    out."""
    evidence = indexed(make())
    left = np.zeros((HEIGHT, 2 * HEIGHT), bool)
    left[:, :HEIGHT] = True
    halves = [evidence.describe(compass(HALL, valid=valid), {}) for valid in (left, ~left)]
    whole = evidence.describe(compass(HALL), {})
    joined = evidence.join([{}, *halves], np.tile(np.eye(4), (3, 1, 1)))
    np.testing.assert_allclose(joined["appearance_seen"], np.ones(12), atol=0.06)
    off = [
        np.linalg.norm(one["appearance"] - whole["appearance"].astype(float), axis=1).mean()
        for one in (joined, halves[1])
    ]
    assert off[0] < 0.5 * off[1]
    alone = evidence.join(halves, np.stack([pose_2d(3, 0, 0), np.eye(4)]))
    np.testing.assert_array_equal(alone["appearance"], halves[1]["appearance"])
    assert evidence.join([{}, {}], np.tile(np.eye(4), (2, 1, 1))) == {}


def test_a_saved_map_has_the_same_scores_and_a_byte_a_channel(make, tmp_path):
    evidence = indexed(make())
    packed = [evidence.pack(evidence.describe(panorama, {})) for panorama in map_panoramas()]
    assert [row["appearance_int8"].nbytes for row in packed[:3]] == [12 * 3] * 3
    assert packed[3] == {}
    write_columns(tmp_path / "rows", packed)
    opened = make()
    opened.open_index(read_columns(tmp_path / "rows"), PLACES, np.tile(np.eye(4)[:3], (4, 1, 1)))
    described = evidence.describe(compass(CELLAR, pose_2d(0, 0, 2.0)), {})
    received, expected = (one.score(described, hypotheses())["appearance"] for one in (opened, evidence))
    np.testing.assert_array_equal(received, expected)
    again = make()
    write_columns(tmp_path / "empty", [{}] * 4)
    again.open_index(read_columns(tmp_path / "empty"), PLACES, np.tile(np.eye(4)[:3], (4, 1, 1)))
    assert not again.score(described, hypotheses())["appearance"].any()


def test_it_keeps_the_rules_of_its_role(make):
    assert conforms(AppearanceEvidence, make().config)
