"""The whole localizer in rooms whose edges, poses and ranges are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conformance import conforms
from plain_room import EYE_M
from salframe_lines.localizer import Lines

from salframe.framework.components.identity import identity
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_errors
from salframe.panoramas.panorama import Panorama

QUERY = pose_2d(3.1, 2.3, 2.2, EYE_M + 0.03)


@pytest.fixture(scope="module")
def references(rooms):
    return [
        room.reference_frame(f"m{i}", pose_2d(2.2 + 0.1 * i, 1.8, 0.3 + 0.4 * i, EYE_M), f"room {i}")
        for i, room in enumerate(rooms)
    ]


@pytest.fixture(scope="module")
def query(rooms):
    return rooms[1].panorama("query", QUERY)


@pytest.fixture(scope="module")
def known(references):
    return LocalizationMap.build(Lines(), references)


def ask(known, panorama):
    return known.answer(known.localizer.describe(panorama))


def test_the_room_is_found_and_the_pose_is_right_to_centimetres(known, query):
    answer = ask(known, query)
    assert answer.status == "ok"
    assert answer.places[0].place == "room 1"
    assert answer.places[0].score > 1.4 > answer.places[1].score  # 1 + the share of the lines that agree
    translation_m, rotation_rad = pose_errors(answer.T_world_query, QUERY)
    assert translation_m < 0.02
    assert rotation_rad < np.deg2rad(0.2)


def test_turning_the_panorama_turns_the_pose(known, query):
    before = ask(known, query).T_world_query
    for columns in (1, 77, 256, 400):  # of 512
        turned = Panorama("turned", np.roll(query.rgb, columns, axis=1))
        translation_m, rotation_rad = pose_errors(
            ask(known, turned).T_world_query, before @ pose_2d(0, 0, 2 * np.pi * columns / 512)
        )
        assert translation_m < 0.02
        assert rotation_rad < np.deg2rad(0.2)


def test_only_the_map_needs_range(known, query):
    np.testing.assert_array_equal(
        ask(known, replace(query, range_m=None)).T_world_query, ask(known, query).T_world_query
    )


def test_light_does_not_matter(known, query):
    dim = (query.rgb * np.array([0.5, 0.4, 0.3])).astype(np.uint8)
    answer = ask(known, replace(query, rgb=dim))
    assert answer.places[0].place == "room 1"
    assert pose_errors(answer.T_world_query, QUERY)[0] < 0.02


def test_a_panorama_without_texture_is_a_status(known):
    answer = ask(known, Panorama("wall", np.full((256, 512, 3), 130, np.uint8)))
    assert (answer.status, answer.places, answer.T_world_query) == ("no-features", (), None)


def test_the_end_of_a_partial_panorama_is_no_line(known, query):
    valid = np.zeros((256, 512), bool)
    valid[:, 100:400] = True
    partial = replace(query, rgb=np.where(valid[..., None], query.rgb, np.uint8(0)), valid=valid)
    whole, part = known.localizer.describe(query), known.localizer.describe(partial)
    upright = part["around_rad"][part["axis"] == 2], whole["around_rad"][whole["axis"] == 2]
    off_rad = np.abs(np.exp(1j * upright[0])[:, None] - np.exp(1j * upright[1]))
    assert off_rad.min(1).max() < 0.01  # every upright line of the part is one of the whole
    assert ask(known, partial).places[0].place == "room 1"
    assert pose_errors(ask(known, partial).T_world_query, QUERY)[0] < 0.03


def test_one_map_frame_is_enough(rooms, references, query):
    known = LocalizationMap.build(Lines(), references[1:2])
    assert pose_errors(ask(known, query).T_world_query, QUERY)[0] < 0.02


def test_a_map_without_range_gives_the_place_and_no_pose(references, query):
    known = LocalizationMap.build(
        Lines(), [replace(frame, load=lambda frame=frame: replace(frame.load(), range_m=None)) for frame in references]
    )
    answer = ask(known, replace(references[1].load(), rgb=np.roll(references[1].load().rgb, 100, axis=1)))
    assert (answer.status, answer.T_world_query) == ("no-pose", None)
    assert answer.places[0].place == "room 1"
    assert ask(known, query).status == "no-pose"


def test_another_room_is_no_pose(references, query):
    known = LocalizationMap.build(Lines(Lines.Config(min_agreement=0.5)), references[:1])
    answer = ask(known, query)
    assert (answer.status, answer.T_world_query, answer.places[0].place) == ("no-pose", None, "room 0")


def test_a_map_frame_in_which_nothing_is_seen(references, query):
    black = Panorama("dark", np.zeros((256, 512, 3), np.uint8))
    dark = ReferenceFrame("dark", "nowhere", np.eye(4), load=lambda: black)
    known = LocalizationMap.build(Lines(), [dark, references[1]])
    assert ask(known, query).places[0].place == "room 1"


def test_a_line_takes_17_bytes_and_the_longest_are_kept(known, query):
    every, few = known.localizer.describe(query), Lines(Lines.Config(max_lines=5)).describe(query)
    assert sum(array.nbytes for array in every.values()) == 17 * len(every["axis"]) + 8
    for axis in range(3):
        of_all, of_few = (
            np.diff(description["along_rad"][description["axis"] == axis])[:, 0] for description in (every, few)
        )
        np.testing.assert_array_equal(of_few, np.sort(of_all)[::-1][:5])


def test_a_description_depends_on_the_number_of_lines_alone():
    base = Lines()
    for change in ({"sphere_points": 42}, {"step_m": 0.5}, {"reach_m": 3}, {"shortlist": 2}, {"min_agreement": 0.2}):
        config = Lines.Config(**change)
        assert identity(config) != identity(base.config)
        assert Lines(config).describe_identity() == base.describe_identity()
    assert Lines(Lines.Config(max_lines=5)).describe_identity() != base.describe_identity()


@pytest.mark.slow
def test_the_rules_of_its_role_are_kept():
    assert conforms(Lines)
