"""The tracker `votes`: votes, agreement, fading, and odometry that is dropped, late or biased."""

from __future__ import annotations

import numpy as np
import pytest
from conformance import conforms
from salframe_trackers.votes import VoteTracker

from salframe.framework.errors import DataError
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.tracker import TrackStatus
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw

STEP = pose_2d(1.0, 0.0, 0.0)


def at(x, y=0.0, yaw=0.0, z=1.5) -> np.ndarray:
    return pose_2d(x, y, yaw, z)


def answer(pose, probability=0.6, place="hall", covariance=None) -> Localization:
    """The answer of a localizer with probabilities."""
    places = (RankedPlace("frame", place, 3.0, probability),)
    return Localization(
        places, pose, LocalizationStatus.OK, covariance=covariance, out_of_map_probability=1 - probability
    )


def scored(pose, score=1.0, place="hall") -> Localization:
    """The answer of a localizer without probabilities."""
    return Localization((RankedPlace("frame", place, score),), pose, LocalizationStatus.OK)


def rejected(out_of_map=0.9) -> Localization:
    places = (RankedPlace("frame", "hall", 1.0, 1 - out_of_map),)
    return Localization(places, None, LocalizationStatus.OUT_OF_MAP, out_of_map_probability=out_of_map)


def votes(**settings) -> VoteTracker:
    return VoteTracker(VoteTracker.Config(**settings))


def test_it_conforms():
    assert conforms(VoteTracker)


def test_a_belief_moves_by_odometry():
    tracker = votes()
    assert tracker.belief().T_world_pano is None
    before, after = at(2.0, 1.0, 0.5), at(3.5, -1.0, 2.0)
    tracker.observe(answer(before))
    tracker.move(invert_pose(before) @ after)
    np.testing.assert_allclose(tracker.belief().T_world_pano, after, atol=1e-12)


def test_the_support_is_the_sum_of_the_faded_probabilities():
    tracker = votes(fade=0.5)
    for step, probability in enumerate((0.8, 0.4, 0.6)):
        tracker.observe(answer(at(step), probability))
        tracker.move(STEP)
    assert tracker.belief().support == pytest.approx(0.8 / 4 + 0.4 / 2 + 0.6)


def test_a_single_wrong_answer_is_outvoted_and_a_better_one_corrects():
    tracker = votes()
    for step in range(4):
        tracker.observe(answer(at(step)))
        tracker.move(STEP)
    tracker.observe(answer(at(9.0, 9.0), 0.9))
    np.testing.assert_allclose(tracker.belief().T_world_pano[:2, 3], [4.0, 0.0])
    doubtful = votes()
    doubtful.observe(answer(at(9.0, 9.0), 0.2))
    doubtful.move(STEP)
    doubtful.observe(answer(at(1.0)))
    np.testing.assert_allclose(doubtful.belief().T_world_pano[:2, 3], [1.0, 0.0])


def test_the_pose_is_the_mean_of_the_answers_that_agree_weighted_by_votes():
    tracker = votes(fade=1.0)
    tracker.observe(answer(at(0.0, yaw=0.1), 0.2))
    tracker.move(STEP)
    tracker.observe(answer(at(1.3, yaw=-0.1), 0.6))
    pose = tracker.belief().T_world_pano
    old = at(0.0, yaw=0.1) @ STEP  # the first answer, moved by odometry
    np.testing.assert_allclose(pose[:2, 3], 0.25 * old[:2, 3] + 0.75 * np.array([1.3, 0.0]), atol=1e-12)
    assert pose_yaw(pose) == pytest.approx(0.25 * 0.1 - 0.75 * 0.1)


def test_headings_are_averaged_over_the_turn_from_pi_to_minus_pi():
    tracker = votes(fade=1.0)
    tracker.observe(answer(at(0.0, yaw=np.pi - 0.1)))
    tracker.move(invert_pose(at(0.0, yaw=np.pi - 0.1)) @ at(-1.0, yaw=np.pi - 0.1))
    tracker.observe(answer(at(-1.0, yaw=-np.pi + 0.1)))
    assert abs(pose_yaw(tracker.belief().T_world_pano)) == pytest.approx(np.pi)


def test_answers_at_one_pose_count_once_and_a_turned_view_counts_again():
    tracker = votes(fade=1.0)
    for _ in range(5):  # the same wrong answer repeatedly, without moving
        tracker.observe(answer(at(9.0, 9.0)))
        tracker.move(np.eye(4))
    assert tracker.belief().support == pytest.approx(0.6)
    tracker.move(pose_2d(0.0, 0.0, np.pi / 2))
    tracker.observe(answer(at(9.0, 9.0, np.pi / 2)))
    assert tracker.belief().support == pytest.approx(1.2)


def test_answers_that_look_another_way_or_are_on_another_floor_do_not_agree():
    for other in (at(1.0, yaw=2.0), at(1.0, z=4.5)):
        tracker = votes(fade=1.0)
        tracker.observe(answer(at(0.0), 0.5))
        tracker.move(STEP)
        tracker.observe(answer(other, 0.4))
        assert tracker.belief().support == pytest.approx(0.5)
        np.testing.assert_allclose(tracker.belief().T_world_pano, at(1.0), atol=1e-12)


def test_the_covariance_is_that_of_the_answers_their_spread_and_odometry():
    tracker = votes(fade=1.0, odometry={"drift_share": 0.1, "heading_drift_deg": 0.0})
    tracker.observe(answer(at(0.0), 0.5, covariance=np.diag([0.04, 0.01, 0.0])))
    tracker.move(STEP)
    tracker.observe(answer(at(1.2), 0.5, covariance=np.diag([0.02, 0.01, 0.0])))
    grown = np.diag([0.04, 0.01, 0.0]) + np.diag([0.1**2, 0.1**2, 0.0])  # 10 % of 1 m
    spread = np.diag([0.1**2, 0.0, 0.0])  # 1.0 and 1.2 m, around their mean
    expected = (grown + np.diag([0.02, 0.01, 0.0])) / 2 + spread
    np.testing.assert_allclose(tracker.belief().covariance, expected, atol=1e-12)


def test_an_error_of_the_heading_grows_to_one_of_the_position():
    """To first order, sigma of the position across the motion is the length times sigma of the heading."""
    tracker = votes(odometry={"drift_share": 0.0, "heading_drift_deg": 0.0})
    tracker.observe(answer(at(0.0), covariance=np.diag([0.0, 0.0, 0.01])))
    tracker.move(pose_2d(3.0, 0.0, 0.0))
    np.testing.assert_allclose(tracker.belief().covariance, [[0, 0, 0], [0, 0.09, 0.03], [0, 0.03, 0.01]], atol=1e-12)


def test_a_covariance_of_three_axes_is_reduced_to_the_plane():
    tracker = votes()
    tracker.observe(answer(at(0.0), covariance=np.diag([1.0, 2, 3, 4, 5, 6])))
    np.testing.assert_allclose(tracker.belief().covariance, np.diag([1.0, 2, 6]))


def test_after_rejected_answers_it_is_out_of_the_map_and_after_failed_ones_lost():
    tracker = votes(min_support=0.3)
    tracker.observe(answer(at(0.0), 0.6))
    assert tracker.belief().status is TrackStatus.TRACKING
    for _ in range(4):
        tracker.move(STEP)
        tracker.observe(rejected())
    belief = tracker.belief()
    assert belief.status is TrackStatus.OUT_OF_MAP
    np.testing.assert_allclose(belief.T_world_pano, at(4.0), atol=1e-12)  # the best guess
    failing = votes(min_support=0.3)
    failing.observe(answer(at(0.0), 0.6))
    for _ in range(4):
        failing.move(STEP)
        failing.observe(Localization((), None, LocalizationStatus.NO_OBJECTS))
    assert failing.belief().status is TrackStatus.LOST


def test_answers_without_probabilities_vote_with_their_positive_score():
    tracker = votes(fade=1.0)
    tracker.observe(scored(at(0.0), 2.0))
    tracker.move(STEP)
    tracker.observe(scored(at(9.0), 1.5))
    tracker.move(STEP)
    tracker.observe(scored(at(20.0), -4.0))
    belief = tracker.belief()
    assert (belief.status, belief.support) == (TrackStatus.TRACKING, 2.0)
    np.testing.assert_allclose(belief.T_world_pano, at(2.0), atol=1e-12)


def test_the_place_is_that_of_the_latest_agreeing_answer_or_found_at_the_pose():
    tracker = votes()
    tracker.observe(answer(at(0.0), place="hall"))
    tracker.move(STEP)
    tracker.observe(answer(at(1.0), 0.4, place="kitchen"))
    assert tracker.belief().place == "kitchen"
    tracker.find_place = lambda position_m: f"x={position_m[0]:g}"
    assert tracker.belief().place == "x=1"


@pytest.mark.parametrize("wrong", [np.eye(3), np.diag([2.0, 2, 2, 1]), "east", np.full((4, 4), np.nan)])
def test_a_motion_that_is_not_rigid_is_refused(wrong):
    with pytest.raises(DataError, match="expected a rigid motion"):
        votes().move(wrong)


def walk(bias=lambda motion: motion, *, late=False, dropped=()) -> list:
    """The beliefs and the true poses of a walk around a square of 4 m, with correct answers, without noise, but where
    odometry is changed."""
    poses = [at(4 - abs(4 - 0.5 * k), 0, 0) if k < 8 else at(4.0, 0.5 * (k - 8), np.pi / 2) for k in range(17)]
    tracker, beliefs, before = votes(), [], np.eye(4)
    for number, pose in enumerate(poses):
        motion = np.eye(4) if number == 0 else bias(invert_pose(poses[number - 1]) @ pose)
        tracker.move(None if number in dropped else before if late else motion)
        before = motion
        tracker.observe(answer(pose))
        beliefs.append(tracker.belief())
    return [*zip(beliefs, poses, strict=True)]


def worst_m(steps) -> float:
    assert all(belief.status is TrackStatus.TRACKING for belief, _ in steps)
    return max(np.linalg.norm(belief.T_world_pano[:3, 3] - pose[:3, 3]) for belief, pose in steps)


def test_exact_odometry_gives_the_exact_pose():
    assert worst_m(walk()) == pytest.approx(0.0, abs=1e-9)


def test_odometry_with_a_bias_of_10_percent_and_5_degrees_is_corrected_by_the_answers():
    def bias(motion):
        return pose_2d(*(1.1 * motion[:2, 3]), pose_yaw(motion) + np.radians(5.0))

    alone = np.eye(4)
    for _ in range(8):
        alone = alone @ bias(pose_2d(0.5, 0.0, 0.0))
    assert np.linalg.norm(alone[:2, 3] - (4.0, 0.0)) > 1.0  # the error of odometry alone after 4 m
    assert worst_m(walk(bias)) < 0.15


def test_odometry_that_arrives_one_step_late_misleads_only_at_a_turn():
    steps = walk(late=True)
    assert worst_m(steps[:8]) == pytest.approx(0.0, abs=1e-9)  # straight ahead, each motion is that of the step before
    assert worst_m(steps) < 0.75
    assert worst_m(steps[-4:]) == pytest.approx(0.0, abs=1e-9)


def test_dropped_odometry_ends_the_tracking_until_the_next_answer():
    tracker = votes()
    tracker.observe(answer(at(0.0), covariance=np.diag([0.01, 0.01, 0.0])))
    tracker.move(None)
    belief = tracker.belief()
    assert belief.status is not TrackStatus.TRACKING
    np.testing.assert_allclose(np.diag(belief.covariance), [0.26, 0.26, np.radians(30.0) ** 2])
    tracker.observe(answer(at(0.5)))
    assert tracker.belief().status is TrackStatus.TRACKING
    assert worst_m(walk(dropped=(5, 9, 13))) < 0.5
