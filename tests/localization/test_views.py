"""Several views as one query: motions are checked, answers are fused where the localizer has no join."""

from __future__ import annotations

import numpy as np
import pytest
from fake_plugin import Reader

from salframe.framework.errors import DataError
from salframe.localization.answers import Localization, LocalizationStatus, ranked_places
from salframe.localization.fusing import choose_surest, fuse_answers
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.opening import find_dataset, reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.view import OdometryNoise, View, motion_variance_m2, motions

PANORAMA = Panorama("view")


def answer(probabilities: dict[str, float], pose: np.ndarray | None = None) -> Localization:
    """An answer with these places in this order; the rest of the probability is out-of-map."""
    names = list(probabilities)
    places = ranked_places([f"frame of {name}" for name in names], names, [0.0] * len(names), probabilities.values())
    status = LocalizationStatus.NO_POSE if pose is None else LocalizationStatus.OK
    return Localization(places, pose, status, out_of_map_probability=1 - sum(probabilities.values()))


@pytest.mark.parametrize("motion", [np.eye(3), 2 * np.eye(4), np.full((4, 4), np.nan), "forward"])
def test_a_motion_that_is_not_rigid_is_refused(motion):
    with pytest.raises(DataError, match=r"View.T_last_view of view is .* expected a rigid motion"):
        View(PANORAMA, motion)


def test_the_motion_of_the_last_view_is_the_identity():
    views = [View(PANORAMA, pose_2d(1, 0, 0)), View(PANORAMA, pose_2d(0, 0, 0.5))]
    with pytest.raises(DataError, match=r"the last view has .* expected the identity"):
        motions(views)
    np.testing.assert_array_equal(motions([views[0], View(PANORAMA)]), [pose_2d(1, 0, 0), np.eye(4)])
    assert motions([View(PANORAMA), View(PANORAMA)]) is None
    with pytest.raises(DataError, match="no views"):
        motions([])
    with pytest.raises(DataError, match=r"view number 0 \(from 0\) has the type Panorama"):
        motions([PANORAMA])


def test_motions_between_bases_become_motions_between_panoramas():
    """A camera 0.5 m ahead of a base that turns by 90 degrees on the spot: it stands 0.5 m left and 0.5 m behind."""
    ahead = np.array([0.5, 0, 1.0])
    first = View(PANORAMA, pose_2d(0, 0, -np.pi / 2), ahead)
    expected = pose_2d(-0.5, -0.5, -np.pi / 2)
    np.testing.assert_allclose(motions([first, View(PANORAMA, None, ahead)])[0], expected, atol=1e-12)
    other_side = View(PANORAMA, None, -ahead)
    np.testing.assert_allclose(motions([first, other_side])[0], pose_2d(0.5, -0.5, -np.pi / 2, 2), atol=1e-12)
    with pytest.raises(DataError, match=r"View\.position_m has shape \(2,\), expected \(3\)"):
        View(PANORAMA, None, np.zeros(2))
    with pytest.raises(DataError, match=r"View\.position_m is \[nan, 0.0, 0.0\], expected finite metres"):
        View(PANORAMA, None, [np.nan, 0, 0])


def test_the_variance_of_a_moved_position_grows_with_path_and_turns():
    T = np.array([pose_2d(-3, 4, 0), pose_2d(-3, 0, 1), np.eye(4)])  # 4 m, then 3 m
    noise = OdometryNoise(drift_share=0.1, heading_drift_deg=2)
    expected = (0.1 * 7) ** 2 + 2 * (np.radians(2) * np.array([0.0, 5.0])) ** 2
    np.testing.assert_allclose(motion_variance_m2(T, noise, np.array([0.0, 5.0]), 0), expected)
    np.testing.assert_array_equal(motion_variance_m2(T, noise, np.array([5.0]), 2), [0])


def test_fused_probabilities_are_the_normalised_product():
    fused = fuse_answers([answer({"a": 0.5, "b": 0.4}), answer({"b": 0.6, "a": 0.3})], None)
    total = 0.5 * 0.3 + 0.4 * 0.6 + 0.1 * 0.1
    assert [place.place for place in fused.places] == ["b", "a"]
    np.testing.assert_allclose([place.probability for place in fused.places], [0.24 / total, 0.15 / total])
    assert fused.out_of_map_probability == pytest.approx(0.01 / total)
    assert fused.places[0].frame == "frame of b"


def test_the_pose_of_the_surest_view_is_moved_to_the_last_view():
    pose = pose_2d(2, 1, np.pi / 2)
    T_last_view = np.array([pose_2d(-1, 0, 0), np.eye(4)])  # the last view is 1 m ahead of the first
    answers = [answer({"a": 0.9}, pose), answer({"a": 0.4, "b": 0.3})]
    fused = fuse_answers(answers, T_last_view)
    np.testing.assert_allclose(fused.T_world_query, pose_2d(2, 2, np.pi / 2), atol=1e-12)
    without_motion = fuse_answers(answers, None)
    assert (without_motion.status, without_motion.places[0].place) == (LocalizationStatus.NO_POSE, "a")


def test_answers_without_probabilities_are_fused_to_the_surest():
    low = Localization(ranked_places(["f"], ["a"], [1.0]), np.eye(4), LocalizationStatus.OK)
    high = Localization(ranked_places(["g"], ["b"], [3.0]), pose_2d(1, 0, 0), LocalizationStatus.OK)
    failed = Localization((), None, LocalizationStatus.NO_OBJECTS)
    assert fuse_answers([high, low, failed], None).places == high.places
    assert fuse_answers([failed, failed], None).status is LocalizationStatus.NO_OBJECTS


def test_a_localizer_without_join_says_so(fakes):
    rooms = find_dataset("rooms")
    frames = reference_frames(rooms)
    built = LocalizationMap.build(Reader(Reader.Config(kind="reader")), frames)
    panorama = frames[0].load()
    alone = built.localize(panorama)
    fused = built.localize(views=[View(panorama, pose_2d(0, 0, 0)), View(panorama)])
    assert fused.notes[0] == (
        "2 views were localized one by one, and the answers were fused, because the method 'reader' cannot localize "
        "several views together"
    )
    np.testing.assert_allclose(fused.T_world_query, alone.T_world_query)
    unknown = built.localize(views=[View(panorama), View(panorama)])
    assert "because the motion between the views is unknown" in unknown.notes[0]
    assert built.localize(views=[View(panorama)]).places == alone.places
    moved = built.localize(views=[View(panorama, position_m=[0.5, 0, 1])])
    expected = alone.T_world_query @ np.vstack([np.eye(4)[:3] - [[0, 0, 0, 0.5], [0] * 4, [0, 0, 0, 1]], [0, 0, 0, 1]])
    np.testing.assert_allclose(moved.T_world_query, expected)
    with pytest.raises(DataError, match="both `views` and a query"):
        built.localize(panorama, views=[View(panorama)])


def test_the_surest_answer_is_moved_to_the_last_view():
    first = answer({"a": 0.9}, pose_2d(1, 2, 0.5))
    last = answer({"b": 0.6}, pose_2d(0, 0, 0))
    T_last_view = np.array([pose_2d(-2, 0, np.pi / 2), np.eye(4)])
    surest = choose_surest([first, last], T_last_view)
    assert surest.places[0].place == "a"
    np.testing.assert_allclose(surest.T_world_query @ T_last_view[0], first.T_world_query, atol=1e-12)
    assert choose_surest([first, last], None).status == LocalizationStatus.NO_POSE
    np.testing.assert_array_equal(choose_surest([last, first], None).T_world_query, first.T_world_query)
    nothing = Localization((), None, LocalizationStatus.NO_OBJECTS)
    assert choose_surest([nothing, nothing], None).status == LocalizationStatus.NO_OBJECTS


def test_a_query_with_earlier_views_is_localized_as_its_views(fakes):
    rooms = find_dataset("rooms")
    frames = reference_frames(rooms)
    built = LocalizationMap.build(Reader(Reader.Config(kind="reader")), frames)
    T_last_view = np.array([pose_2d(-1, 0, 0.5), np.eye(4)])
    query = QueryFrame("last", frames[0].load, earlier=(QueryFrame("first", frames[1].load),), T_last_view=T_last_view)
    expected = built.localize(views=[View(frames[1].load(), T_last_view[0]), View(frames[0].load())])
    answer = built.localize(query)
    assert answer.places == expected.places
    assert answer.notes == expected.notes
    np.testing.assert_array_equal(answer.T_world_query, expected.T_world_query)


@pytest.mark.parametrize("motions", [np.array([np.eye(4)]), np.array([2 * np.eye(4), np.eye(4)])])
def test_wrong_motions_of_a_query_are_refused(motions):
    with pytest.raises(DataError, match=r"T_last_view has shape|expected a rigid motion"):
        QueryFrame("last", lambda: PANORAMA, earlier=(QueryFrame("first", lambda: PANORAMA),), T_last_view=motions)
