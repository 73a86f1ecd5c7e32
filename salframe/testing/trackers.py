"""Conformance rules for components of the role `tracker`."""

from __future__ import annotations

import numpy as np

from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.tracker import TrackedPose, Tracker, TrackStatus
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors
from salframe.testing.expectations import attempt, expect, lock, same
from salframe.testing.rules import Rules

NUM_STEPS = 10
"""Number of steps of the walk of the rules."""
MAX_RECOVERY = 20
"""Number of correct answers after which a tracker must have recovered."""
TOLERANCE_M, TOLERANCE_DEG = 0.3, 15.0
"""Maximum errors of a tracked pose if odometry and answers are exact."""
FAILED = Localization((), None, LocalizationStatus.NO_OBJECTS)
"""The answer to a query in which nothing is recognized."""


def _walk(step: int) -> np.ndarray:
    """Return the pose at a step of a walk through the hall."""
    return pose_2d(0.6 * step, 0.05 * step**2, 0.1 * step, 1.5)


def _answer(pose: np.ndarray, place: str, probability: float = 0.9) -> Localization:
    """Return the correct answer of a localizer with probabilities."""
    others = (1 - probability) / 2
    places = (RankedPlace(f"{place}-1", place, 5.0, probability), RankedPlace("attic-1", "attic", 1.0, others))
    return Localization(places, pose, LocalizationStatus.OK, out_of_map_probability=others)


class TrackerRules(Rules[Tracker]):
    """The tracker knows the pose after correct answers, moves the pose by odometry, outvotes a wrong answer, and
    recovers after the camera was moved without odometry."""

    def a_new_tracker_is_lost(self) -> None:
        belief = _get_belief(self.make(), "belief of a new tracker")
        expect(belief.status is TrackStatus.LOST, "belief of a new tracker", belief.status, TrackStatus.LOST)

    def correct_answers_are_tracked(self) -> None:
        _expect_pose(self._tracked(), f"belief after {NUM_STEPS} correct answers", _walk(NUM_STEPS - 1), "hall")

    def answers_without_probabilities_are_tracked(self) -> None:
        tracker = self.make()
        for step in range(NUM_STEPS):
            answer = Localization((RankedPlace("hall-1", "hall", 4.0),), _walk(step), LocalizationStatus.OK)
            _step(tracker, _motion(step), answer)
        checked = f"belief after {NUM_STEPS} correct answers without probabilities"
        _expect_pose(tracker, checked, _walk(NUM_STEPS - 1), "hall")

    def the_belief_moves_by_odometry(self) -> None:
        tracker, motion = self._tracked(), pose_2d(1.0, 0.3, 0.8)
        _call("move", tracker.move, motion)
        belief = _get_belief(tracker, "belief after a motion")
        _expect_near(belief, "belief after a motion", _walk(NUM_STEPS - 1) @ motion)

    def a_belief_changes_nothing(self) -> None:
        tracker = self._tracked()
        first, second = (_get_belief(tracker, "belief") for _ in range(2))
        expect(same(first, second), "belief, twice", "two different beliefs", "the same belief")

    def a_single_wrong_answer_is_outvoted(self) -> None:
        tracker = self._tracked()
        _step(tracker, _motion(NUM_STEPS), _answer(pose_2d(30.0, -9.0, 2.0, 1.5), "cellar"))
        _expect_near(_get_belief(tracker, "belief"), "belief after a wrong answer", _walk(NUM_STEPS))

    def a_motion_without_odometry_is_recovered_from(self) -> None:
        tracker, start = self._tracked(), pose_2d(40.0, 5.0, -1.0, 1.5)
        for step in range(MAX_RECOVERY):
            motion = np.eye(4) if step == 0 else _motion(step)
            pose = start @ invert_pose(_walk(0)) @ _walk(step)
            _step(tracker, motion, _answer(pose, "kitchen"))
        _expect_pose(tracker, f"belief after {MAX_RECOVERY} correct answers at another place", pose, "kitchen")

    def a_change_of_floor_is_recovered_from(self) -> None:
        tracker = self._tracked()
        for step in range(NUM_STEPS, NUM_STEPS + MAX_RECOVERY):
            pose = _walk(step)
            pose[2, 3] += 3.0  # an elevator, of which odometry knows nothing
            _step(tracker, _motion(step), _answer(pose, "upper hall"))
        _expect_pose(tracker, f"belief after {MAX_RECOVERY} correct answers on another floor", pose, "upper hall")

    def failed_answers_end_the_tracking(self) -> None:
        tracker = self._tracked()
        for step in range(NUM_STEPS, NUM_STEPS + 3 * MAX_RECOVERY):
            _step(tracker, _motion(step), FAILED)
        belief = _get_belief(tracker, "belief")
        checked = f"belief after {3 * MAX_RECOVERY} failed answers"
        expect(belief.status is not TrackStatus.TRACKING, checked, belief.status, "lost or out-of-map")

    def an_unknown_motion_is_allowed(self) -> None:
        tracker = self._tracked()
        for step in range(NUM_STEPS, NUM_STEPS + MAX_RECOVERY):
            motion = None if step == NUM_STEPS else _motion(step)
            _step(tracker, motion, _answer(_walk(step), "hall"))
        _expect_pose(tracker, "belief after an unknown motion and correct answers", _walk(step), "hall")

    def _tracked(self) -> Tracker:
        """Return a tracker that has observed the correct answers of a walk."""
        tracker = self.make()
        for step in range(NUM_STEPS):
            _step(tracker, _motion(step), _answer(_walk(step), "hall"))
        return tracker


def _motion(step: int) -> np.ndarray:
    """Return the motion (4, 4) from the previous step of the walk to this step."""
    return np.eye(4) if step == 0 else invert_pose(_walk(step - 1)) @ _walk(step)


def _step(tracker: Tracker, motion: np.ndarray | None, answer: Localization) -> None:
    if motion is not None:
        lock(motion)
    _call("move", tracker.move, motion)
    _call("observe", tracker.observe, answer)


def _call(checked: str, function: object, argument: object) -> None:
    """Call a method, and check that it returns None."""
    returned = attempt(checked, function, argument)  # type: ignore[arg-type]
    expect(returned is None, checked, f"the result {returned!r}", "None")


def _get_belief(tracker: Tracker, checked: str) -> TrackedPose:
    belief = attempt(checked, tracker.belief)
    expect(isinstance(belief, TrackedPose), checked, type(belief).__name__, "TrackedPose")
    return belief  # type: ignore[no-any-return]


def _expect_pose(tracker: Tracker, checked: str, pose: np.ndarray, place: str) -> None:
    """Check that a tracker tracks this pose in this place."""
    belief = _get_belief(tracker, checked)
    expect(belief.status is TrackStatus.TRACKING, checked, f"the status {belief.status}", TrackStatus.TRACKING)
    _expect_near(belief, checked, pose)
    expect(belief.place == place, checked, f"the place {belief.place}", place)


def _expect_near(belief: TrackedPose, checked: str, pose: np.ndarray) -> None:
    expect(belief.T_world_pano is not None, checked, "no pose", "a pose")
    if belief.T_world_pano is not None:
        position_m, rotation_rad = pose_errors(belief.T_world_pano, pose)
        rotation_deg = np.degrees(rotation_rad)
        received = f"a pose {position_m:.2f} m and {rotation_deg:.1f} degrees from the correct one"
        is_near = position_m <= TOLERANCE_M and rotation_deg <= TOLERANCE_DEG
        expect(is_near, checked, received, f"at most {TOLERANCE_M:g} m and {TOLERANCE_DEG:g} degrees")
