"""What a localizer may answer, and how its places are ranked."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.errors import DataError, InvalidAnswer
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches, PointMatches, RankedPlace
from salframe.localization.positioner import PoseEstimate, PoseStatus
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw, translation


def test_a_status_may_be_written_as_text():
    assert Localization((), None, "no-match").status is LocalizationStatus.NO_MATCH
    assert PoseEstimate(None, "too-few", None, np.zeros(0, bool)).status is PoseStatus.TOO_FEW
    assert ReferenceFrame("a", "room", np.eye(4), "transition").kind is FrameKind.TRANSITION


def test_an_unknown_status_is_told_with_the_known_ones():
    with pytest.raises(InvalidAnswer, match="the status 'lost', expected one of ok, no-pose, no-objects, no-features"):
        Localization((), None, "lost")
    with pytest.raises(InvalidAnswer, match="the status 'lost', expected one of ok, too-few, degenerate"):
        PoseEstimate(None, "lost", None, np.zeros(0, bool))
    with pytest.raises(DataError, match="the frame a has the kind 'door', expected one of scene, transition"):
        ReferenceFrame("a", "room", np.eye(4), "door")


def test_only_a_place_or_a_pose_is_an_answer():
    assert {status for status in LocalizationStatus if status.names_a_place} == {"ok", "no-pose"}


def test_a_status_denies_the_map_where_the_query_was_compared_with_it():
    assert {status for status in LocalizationStatus if status.is_rejection} == {"out-of-map", "no-match", "low-score"}


def probable(*probabilities):
    return tuple(RankedPlace(f"f{i}", f"p{i}", -float(i), p) for i, p in enumerate(probabilities))


def test_probabilities_of_places_and_none_of_them_are_one_together():
    answer = Localization(probable(0.5, 0.25), None, "out-of-map", out_of_map_probability=0.25)
    assert [place.place for place in answer.places] == ["p0", "p1"]
    assert not answer.status.names_a_place


@pytest.mark.parametrize(
    ("probabilities", "out_of_map_probability", "message"),
    [
        ((0.5, 0.25), 0.2, "probabilities that sum to 0.95, expected 1"),
        ((0.5, 0.5), 2e-6, "probabilities that sum to 1.000002, expected 1"),
        ((1.5, -0.5), 0.0, r"the probability 1.5, expected a value in \[0, 1\]"),
        ((float("nan"), 0.5), 0.5, r"the probability nan, expected a value in \[0, 1\]"),
        (
            (0.5, None),
            0.5,
            "2 of 3 probabilities, expected all or none: `out_of_map_probability`, and one probability for each",
        ),
        ((0.5, 0.5), None, "2 of 3 probabilities, expected all or none"),
        ((None, None), 1.0, "1 of 3 probabilities, expected all or none"),
    ],
)
def test_other_probabilities_are_refused(probabilities, out_of_map_probability, message):
    with pytest.raises(InvalidAnswer, match=message):
        Localization(probable(*probabilities), None, "no-pose", out_of_map_probability=out_of_map_probability)


def test_what_is_not_here_has_no_pose():
    with pytest.raises(InvalidAnswer, match="the status out-of-map and a pose, expected no pose"):
        Localization(probable(None), np.eye(4), "out-of-map")


def mirrored() -> np.ndarray:
    return np.diag([1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    "pose", [2 * np.eye(4), mirrored(), np.full((4, 4), np.nan), np.eye(3), np.zeros((4, 4)), [[1, 0], [0, 1]]]
)
def test_a_pose_that_is_no_rigid_motion_is_no_answer(pose):
    with pytest.raises(InvalidAnswer, match="expected a rigid motion") as caught:
        Localization((), pose, "ok")
    assert "\n" not in str(caught.value)


def test_a_rigid_motion_is_an_answer():
    pose = pose_2d(1.0, -2.0, 2.5, 0.3)
    here = (RankedPlace("a", "room", 1.0),)
    np.testing.assert_array_equal(Localization(here, pose, "ok").T_world_query, pose)


def test_a_heading_is_that_of_the_pose_or_stands_alone():
    here = (RankedPlace("a", "room", 1.0),)
    assert Localization(here, pose_2d(1.0, -2.0, 2.5), "ok").heading_rad == pytest.approx(2.5)
    assert Localization(here, None, "no-pose", heading_rad=-0.3).heading_rad == -0.3
    assert Localization(here, None, "no-pose").heading_rad is None
    with pytest.raises(InvalidAnswer, match="the heading nan, expected finite radians"):
        Localization(here, None, "no-pose", heading_rad=float("nan"))


def test_matches_must_fit_together():
    points = np.eye(3)
    assert PointMatches(points, points).query.shape == (3, 3)
    with pytest.raises(InvalidAnswer, match=r"PointMatches.reference has shape \(2, 3\), expected \(3, 3\)"):
        PointMatches(points, points[:2])
    assert len(NodeMatches(points, points, np.array([[0, 2], [1, 0]])).pairs) == 2
    for pairs in ([[0, 3]], [[-1, 0]], [[0, 1], [0, 2]]):
        with pytest.raises(InvalidAnswer, match="expected each of 3 query and 3 reference objects at most once"):
            NodeMatches(points, points, np.array(pairs))


FRAMES = [
    ReferenceFrame("a-1", "a", pose_2d(0, 0, 0)),
    ReferenceFrame("door", "a/b", pose_2d(2, 0, 0), FrameKind.TRANSITION),
    ReferenceFrame("b-1", "b", pose_2d(4, 0, 0)),
    ReferenceFrame("a-2", "a", pose_2d(0, 3, 0)),
]


def ranked(scores, pose=None) -> list[tuple[str, str, float]]:
    return [(one.frame, one.place, one.score) for one in rank_places(FRAMES, np.array(scores), pose)]


def test_each_place_is_ranked_by_its_best_frame():
    assert ranked([0.1, 0.5, 0.3, 0.4]) == [("door", "a/b", 0.5), ("a-2", "a", 0.4), ("b-1", "b", 0.3)]
    assert ranked([0.2, 0.2, 0.2, 0.2]) == [("a-1", "a", 0.2), ("door", "a/b", 0.2), ("b-1", "b", 0.2)]
    assert ranked([-np.inf, -np.inf, 0.3, -np.inf]) == [("b-1", "b", 0.3)]
    assert ranked([-np.inf] * 4) == []


def test_in_a_doorway_the_pose_tells_the_place():
    scores = [0.1, 0.5, 0.3, 0.4]
    assert ranked(scores, pose_2d(2.4, 0, 0))[:2] == [("b-1", "b", 0.5), ("door", "a/b", 0.5)]
    assert ranked(scores, pose_2d(1.6, 0, 0))[0] == ("a-1", "a", 0.5)
    assert ranked([0.9, 0.5, 0.3, 0.4], pose_2d(2.4, 0, 0))[0] == ("a-1", "a", 0.9)


@pytest.mark.parametrize(
    ("status", "out_of_map", "accepted"),
    [
        ("ok", 0.06, True),
        ("ok", 0.5, True),
        ("ok", 0.53, False),
        ("ok", 0.94, False),
        ("no-pose", 0.06, True),
        ("no-pose", 0.53, False),
        ("out-of-map", 0.3, False),
        ("ok", None, None),
        ("no-pose", None, None),
        ("low-score", None, False),
    ],
)
def test_an_answer_is_accepted_where_it_names_a_place_that_is_more_probable_than_none(status, out_of_map, accepted):
    places = (RankedPlace("f", "kitchen", 1.0, None if out_of_map is None else 1 - out_of_map),)
    answer = Localization(places, np.eye(4) if status == "ok" else None, status, out_of_map_probability=out_of_map)
    assert answer.accepted is accepted
    if status in ("ok", "no-pose") and accepted is False:
        assert answer.summary.startswith("not accepted, because the query is probably out-of-map (probability ")
        assert f"{out_of_map:.1%}, accepted up to 50%" in answer.summary
    else:
        assert answer.summary == status


def test_a_moved_answer_has_the_pose_of_the_other_frame():
    """A camera 1 m ahead of a base and 0.5 m left of it, at (2, 3), heading along +y: the base is at (2.5, 2)."""
    places = (RankedPlace("f", "p", 1.0),)
    answer = Localization(places, pose_2d(2, 3, np.pi / 2, 1.4), LocalizationStatus.OK, notes=("note",))
    moved = answer.moved(np.array([1, 0.5, 1.4]))
    np.testing.assert_allclose(moved.T_world_query, pose_2d(2.5, 2, np.pi / 2), atol=1e-12)
    assert (moved.places, moved.heading_rad, moved.notes) == (places, pytest.approx(np.pi / 2), ("note",))
    without_pose = Localization(places, None, LocalizationStatus.NO_POSE, heading_rad=1.0)
    assert without_pose.moved(np.ones(3)) is without_pose


@pytest.mark.parametrize("size", [3, 6])
def test_the_covariance_of_a_moved_answer_is_that_of_samples(size):
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(0)
    spread = 0.01 * rng.standard_normal((size, size))
    position_m, pose = np.array([0.4, -0.2, 0.9]), pose_2d(2, 3, 0.7, 1.4)
    answer = Localization((RankedPlace("f", "p", 1.0),), pose, LocalizationStatus.OK, spread @ spread.T)
    samples = []
    for errors in rng.standard_normal((20_000, size)) @ spread.T:
        shift, turn = (errors[:3], errors[3:]) if size == 6 else ([*errors[:2], 0], [0, 0, errors[2]])
        moved = pose.copy()
        moved[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ pose[:3, :3]
        moved[:3, 3] += shift
        base = moved @ invert_pose(translation(position_m))
        samples.append([*base[:3, 3], *turn] if size == 6 else [*base[:2, 3], pose_yaw(base)])
    expected = np.cov(np.transpose(samples))
    np.testing.assert_allclose(answer.moved(position_m).covariance, expected, atol=0.05 * np.abs(expected).max())
