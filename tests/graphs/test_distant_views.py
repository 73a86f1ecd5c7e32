"""Views that were taken far apart: their groups, the rule that names the place of the last view, and two rooms."""

from itertools import pairwise

import numpy as np
import pytest
from salframe_graphs.places.distant_views import (
    ViewGroup,
    combine_groups,
    group_views,
    groups_from_arrays,
    groups_to_arrays,
)

from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.localization.map import LocalizationMap
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors
from salframe.panoramas.view import OdometryNoise, View
from salframe.testing.rooms import map_frames, query_frames, query_truths


def at(*positions_m):
    """Motions of views at positions (x, y) in the frame of the last view."""
    return np.stack([pose_2d(x, y, 0.3 * number) for number, (x, y) in enumerate(positions_m)])


def test_a_group_reaches_back_from_its_last_view():
    motions = at((-6, 0), (-5, 0), (-3.5, 0), (-2, 0), (-1, 0), (0, 0))
    assert [list(group) for group in group_views(motions, 2.0)] == [[0], [1, 2], [3, 4, 5]]
    assert [list(group) for group in group_views(motions, 10.0)] == [[0, 1, 2, 3, 4, 5]]
    assert [list(group) for group in group_views(at((0, 0), (0, 0)), 0.0)] == [[0, 1]]


def test_groups_survive_a_description():
    groups = [
        ViewGroup({"labels": np.array(["bed"]), "shown/x": np.ones(2)}, pose_2d(3, 4, 1)),
        ViewGroup({}, np.eye(4)),
    ]
    arrays = {"labels": np.array(["sofa"]), **groups_to_arrays(groups)}
    first, last = groups_from_arrays(arrays)
    assert set(first.description) == {"labels", "shown/x"}
    assert first.description["labels"].tolist() == ["bed"]
    assert first.distance_m == pytest.approx(5)
    assert not last.description
    assert groups_from_arrays({"labels": np.array(["sofa"])}) == []


def test_the_pose_of_a_group_follows_from_that_of_the_last_view():
    T_world_last, T_last_group = pose_2d(2, 1, 0.7), pose_2d(-3, 1, -0.2)
    poses = ViewGroup({}, T_last_group).poses(T_world_last[:2, 3], 0.7, 2)
    expected = T_world_last @ T_last_group
    np.testing.assert_allclose(poses.shift_m, [expected[:2, 3]] * 2)
    np.testing.assert_allclose(poses.yaw_rad, np.arctan2(expected[1, 0], expected[0, 0]))


def test_the_rule_adds_the_evidence_of_other_groups_as_far_as_they_are_in_the_same_place():
    last, other = np.array([1.0, 0.5, 0.0]), np.log([0.1, 0.8, 0.1]) + 5  # scores have any offset
    rho = np.exp(-3 / 2)
    expected = last + np.log(rho * np.array([0.1, 0.8, 0.1]) + (1 - rho) / 3)
    np.testing.assert_allclose(combine_groups([other, last], [3.0, 0.0], 2.0), expected)
    np.testing.assert_allclose(combine_groups([None, last], [3.0, 0.0], 2.0), last)
    np.testing.assert_allclose(combine_groups([other, None], [0.0, 0.0], 2.0), np.log([0.1, 0.8, 0.1]))
    far = combine_groups([other, last], [1e3, 0.0], 2.0)
    np.testing.assert_allclose(far - last, np.log(1 / 3))


def map_of_rooms(**changes):
    settings_of_views = {"detector": "annotations", "distant_views": changes}
    config = configure("localizer", "proposed", settings("localizer", "proposed"), [settings_of_views])
    return LocalizationMap.build(registry().build("localizer", config), map_frames())


@pytest.fixture(scope="module")
def rooms():
    return map_of_rooms()


def two_views():
    """Views in different rooms."""
    truths, queries = query_truths(), [*query_frames()]
    before, last = next(p for p in pairwise(queries) if truths[p[0].id].place != truths[p[1].id].place)
    T_last_before = invert_pose(truths[last.id].T_world_pano) @ truths[before.id].T_world_pano
    return [View(before.load(), T_last_before), View(last.load(), np.eye(4))]


def test_views_in_two_rooms_give_the_place_and_the_pose_of_the_last_one(rooms):
    truths = query_truths()
    queries = [*query_frames()]
    changes = 0
    for before, last in pairwise(queries):
        T_world_last = truths[last.id].T_world_pano
        T_last_before = invert_pose(T_world_last) @ truths[before.id].T_world_pano
        changes += truths[before.id].place != truths[last.id].place
        answer = rooms.localize(views=[View(before.load(), T_last_before), View(last.load(), np.eye(4))])
        assert answer.places[0].place == truths[last.id].place
        error_m, _ = pose_errors(answer.T_world_query, T_world_last)
        assert error_m < 0.25
    assert changes


def test_only_views_far_apart_without_floor_masks_have_groups(rooms):
    first, last = (rooms.localizer.describe(frame.load()) for frame in [*query_frames()][:2])
    near, far = at((-1, 0), (0, 0)), at((-4, 0), (0, 0))
    near[1] = far[1] = np.eye(4)

    def groups(motions):
        return groups_from_arrays(rooms.localizer.join([first, last], motions, OdometryNoise()))

    assert groups(near) == []
    assert [group.distance_m for group in groups(far)] == pytest.approx([4, 0])


@pytest.mark.parametrize("setting", [{"near_m": 100}, {"window_m": 1.0}, {"same_place_m": 100}])
def test_each_setting_changes_an_answer(rooms, setting):
    before, after = rooms.localize(views=two_views()), map_of_rooms(**setting).localize(views=two_views())
    numbers = [[place.score for place in answer.places] for answer in (before, after)]
    poses = [answer.T_world_query for answer in (before, after)]
    same_pose = poses[1] is not None and np.array_equal(*poses)
    assert numbers[0] != numbers[1] or not same_pose
