"""The likelihood ratio against a case worked out by hand with scipy's densities."""

from dataclasses import replace

import numpy as np
import pytest
from salframe_graphs.places.hypotheses import best_poses
from salframe_graphs.places.likelihood import PlaceLikelihood
from salframe_graphs.places.merging import Place
from salframe_graphs.places.place_index import index_places
from salframe_graphs.places.poses import Poses
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.rates import Likelihood, shipped_rates
from salframe_graphs.places.search import refine_final_pose
from scipy.stats import norm

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.geometry import invert_pose, pose_2d, transform_points

RATES, LIKELIHOOD = shipped_rates(), Likelihood()
LABELS = ("bed", "sofa", "chair", "table", "lamp", "plant", "tv", "desk")


def place(labels, centroid_m, log_saliency=0.0, sightings=1.0, name="a"):
    n = len(labels)
    return Place(
        name,
        (0,),
        tuple(labels),
        np.array(centroid_m, float),
        np.full(n, 0.04),
        np.zeros((n, 3)),
        np.broadcast_to(log_saliency, n).astype(float),
        np.full(n, sightings),
    )


def query(labels, centroid_m, scores=1.0):
    n = len(labels)
    return SaliencyGraph(
        tuple(labels),
        np.full(n, scores),
        np.full(n, 1 / n),
        np.array(centroid_m, float),
        np.ones((n, 3)),
        np.zeros(n),
        np.zeros((0, 2), np.int64),
    )


def scored(places, graph, rates=RATES):
    index = index_places(places, [np.zeros((1, 3))] * len(places), rates, LIKELIHOOD)
    return PlaceLikelihood(QueryObjects.of(graph, index.vocabulary), index, rates, LIKELIHOOD)


def at(x_m, y_m, yaw_rad, k=0):
    return Poses(np.array([k]), np.array([[x_m, y_m]], float), np.array([yaw_rad], float))


def found_by_hand(distance_m, log_saliency=0.0, sightings=1.0):
    logit = RATES.detection_logit + RATES.detection_per_saliency * log_saliency
    logit += LIKELIHOOD.detection_per_sighting * np.log(sightings) + RATES.detection_per_distance * np.log(
        distance_m / 2
    )
    return 1 / (1 + np.exp(-logit))


def test_one_object_of_one_is_what_the_densities_say():
    """A bed 3 m ahead of the camera that lies 0.3 m further and 0.1 m aside, 0.05 m higher and 1.2 times as long."""
    asked = replace(query(["bed"], [[3, 0, 0]]), size_m=np.array([[1.2, 1.0, 1.0]]))
    scorer = scored([place(["bed"], [[3.3, 0.1, 0.05]], log_saliency=0.7, sightings=2.0)], asked)
    score, share = scorer.score(at(0, 0, 0))
    along = np.sqrt(RATES.position_error_m**2 + (RATES.range_error_share * 3) ** 2 + 0.04)
    across = np.sqrt(RATES.position_error_m**2 + 0.04)
    frequency = 1.5 / 2  # of one bed and of what the map lacks, half an object added to each
    ratio = RATES.label_agreement / frequency * LIKELIHOOD.area_m2 * norm.pdf(0.3, 0, along) * norm.pdf(0.1, 0, across)
    ratio *= LIKELIHOOD.height_span_m * norm.pdf(0.05, 0, np.sqrt(2) * RATES.height_error_m)
    ratio *= LIKELIHOOD.size_span_log * norm.pdf(np.log(1.2), 0, np.sqrt(2) * RATES.length_error_log)
    ratio *= LIKELIHOOD.size_span_log * norm.pdf(0, 0, np.sqrt(2) * RATES.box_height_error_log)
    found = found_by_hand(np.hypot(3.3, 0.1), 0.7, 2.0)
    odds = found / (1 - found) * ratio / RATES.clutter
    assert score[0] == pytest.approx(np.log(1 + odds) + np.log(1 - found), abs=1e-4)
    assert share[0, 0] == pytest.approx(odds / (1 + odds), abs=1e-5)


def test_an_object_that_is_missed_costs_its_probability():
    """Two places that differ in one object, which the query has not: the score differs by log(1 - P)."""
    asked = query(["bed"], [[3, 0, 0]])
    places = [place(["bed"], [[3, 0, 0]]), place(["bed", "bed"], [[3, 0, 0], [-4, -30, 0]], name="b")]
    scorer = scored(places, asked)
    one, two = (scorer.score(at(0, 0, 0, k))[0][0] for k in (0, 1))
    assert two - one == pytest.approx(np.log(1 - found_by_hand(np.hypot(4, 30))), abs=1e-4)


def test_two_that_claim_one_object_share_its_odds():
    places = [place(["bed"], [[3, 0, 0]])]
    one, two = (scored(places, query(["bed"] * n, [[3, 0, 0]] * n)).score(at(0, 0, 0))[0][0] for n in (1, 2))
    missed = np.log(1 - found_by_hand(3.0))
    odds = np.expm1(one - missed)
    claimed = 2 * odds / (1 + odds)
    assert two == pytest.approx(2 * np.log1p(odds / claimed) + missed, abs=1e-4)


def test_a_detector_that_is_not_sure_counts_less():
    places = [place(["bed"], [[3, 0, 0]])]
    sure, unsure = (
        scored(places, query(["bed"], [[3, 0, 0]], scores)).score(at(0, 0, 0))[0][0] for scores in (1.0, 0.5)
    )
    missed = np.log(1 - found_by_hand(3.0))
    assert np.expm1(unsure - missed) == pytest.approx(0.5 * np.expm1(sure - missed), rel=1e-3)


def test_the_true_pose_is_found_among_places_alike():
    """Rooms of the same objects at other places, one of them the query's: its pose to the precision of the sight."""
    rng = np.random.default_rng(4)
    rooms = [np.column_stack([rng.uniform(-2.5, 2.5, (8, 2)), rng.uniform(-1, 1, 8)]) for _ in range(6)]
    T = pose_2d(0.6, -0.3, 2.2)
    asked = query(LABELS, transform_points(invert_pose(T), rooms[3]))
    scorer = scored([place(LABELS, room, name=str(k)) for k, room in enumerate(rooms)], asked)
    started = best_poses(scorer, 3)
    assert (np.diff(started.place) >= 0).all()
    assert np.bincount(started.place).max() <= 3
    refined = scorer.refine(started)
    poses, best = refined.poses, int(refined.score.argmax())
    _, share = scorer.score(poses.take(np.array([best])))
    np.testing.assert_allclose(refined.share_of(best), share, atol=1e-6)
    assert poses.place[best] == 3
    np.testing.assert_allclose([*poses.shift_m[best], poses.yaw_rad[best] % (2 * np.pi)], [0.6, -0.3, 2.2], atol=0.01)
    assert (np.diag(share) > 0.9).all()


def test_refinement_never_scores_less():
    rng = np.random.default_rng(1)
    room = np.column_stack([rng.uniform(-2.5, 2.5, (8, 2)), rng.uniform(-1, 1, 8)])
    seen = transform_points(invert_pose(pose_2d(0.4, 0.1, 1.0)), room) + rng.normal(0, 0.1, (8, 3))
    scorer = scored([place(LABELS, room)], query(LABELS, seen))
    starts = Poses(np.zeros(30, int), rng.uniform(-1, 1, (30, 2)), rng.uniform(0, 6, 30))
    before, after = scorer.score(starts)[0], scorer.refine(starts).score
    assert (after >= before).all()
    assert after.max() > before.max()


def test_the_pose_lies_within_its_covariance():
    """Errors drawn as the rates say, which are no Cauchy's, move the pose by no more than its covariance says, nor by
    less than half of that."""
    rng = np.random.default_rng(0)
    room = np.column_stack([rng.uniform(-3, 3, (8, 2)), rng.uniform(-1, 1, 8)])
    rates = RATES.model_copy(update={"range_error_share": 0.0, "position_error_m": 0.1})
    places = [replace(place(LABELS, room), variance_m2=np.full(8, 1e-6))]
    found, expected = [], []
    for _ in range(300):
        seen = room + np.column_stack([rng.normal(0, 0.1, (8, 2)), np.zeros(8)])
        scorer = scored(places, query(LABELS, seen), rates)
        refined = scorer.refine(at(0, 0, 0)).poses
        pose, covariance = refine_final_pose(scorer, refined, scorer.score(refined)[1], 0.0)
        found.append([*pose.shift_m[0], pose.yaw_rad[0]])
        expected.append(np.diag(covariance))
    ratio = np.std(found, 0) / np.sqrt(np.mean(expected, 0))
    assert (ratio > 0.5).all()
    assert (ratio < 1.05).all()


def test_one_object_out_of_place_does_not_move_the_pose():
    """Of eight objects the map has one 0.4 m off: the pose is off by less than a third of what the mean would be."""
    rng = np.random.default_rng(3)
    room = np.column_stack([rng.uniform(-2.5, 2.5, (8, 2)), rng.uniform(-1, 1, 8)])
    moved = room.copy()
    moved[0, 0] += 0.4
    places = [replace(place(LABELS, moved), variance_m2=np.full(8, 1e-3))]
    scorer = scored(places, query(LABELS, room))
    refined = scorer.refine(at(0, 0, 0)).poses
    pose, _ = refine_final_pose(scorer, refined, np.eye(8), 0.0)
    assert np.hypot(*pose.shift_m[0]) < 0.4 / 8 / 3


def test_places_are_scored_as_if_alone():
    """Of several places, one of them without objects, the score of a pose is that in a map of the same vocabulary."""
    rng = np.random.default_rng(5)
    rooms = [np.column_stack([rng.uniform(-2.5, 2.5, (n, 2)), rng.uniform(-1, 1, n)]) for n in (8, 0, 5)]
    places = [place(LABELS[: len(room)], room, name=str(k)) for k, room in enumerate(rooms)]
    scorer = scored(places, query(LABELS, rooms[0]))
    poses = Poses(np.array([0, 1, 2, 2]), rng.uniform(-0.1, 0.1, (4, 2)), rng.uniform(-0.1, 0.1, 4))
    together, share = scorer.score(poses)
    assert share.shape == (8, 8 + 5 + 5)
    for row, k in enumerate(poses.place):
        alone, _ = scorer.score(poses.take(np.array([row])))
        assert together[row] == pytest.approx(alone[0], abs=1e-6)
        one = PlaceLikelihood(scorer.query, scorer.index.take(np.array([k])), RATES, LIKELIHOOD)
        moved = replace(poses.take(np.array([row])), place=np.array([0]))
        assert together[row] == pytest.approx(one.score(moved)[0][0], abs=1e-5)
        assert scorer.score_without_pose()[k] == pytest.approx(one.score_without_pose()[0], abs=1e-5)
