"""Query objects without range: the likelihood against scipy's densities, and poses from bearings."""

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
from salframe_graphs.places.search import refine_final_pose, search
from scipy.stats import multivariate_t, norm

from salframe.graphs.detections import unit_vectors
from salframe.graphs.graph import SaliencyGraph, concatenate_graphs, without_range
from salframe.panoramas.geometry import invert_pose, pose_2d, transform_points

RATES, LIKELIHOOD = shipped_rates(), Likelihood()
BEARINGS = LIKELIHOOD.bearings
LABELS = ("bed", "sofa", "chair", "table", "lamp", "plant", "tv", "desk")
SIDE_M = 0.5


def place(labels, centroid_m, name="a"):
    n = len(labels)
    size = np.full((n, 3), np.log(SIDE_M))
    return Place(
        name, (0,), tuple(labels), np.array(centroid_m, float), np.full(n, 0.01), size, np.zeros(n), np.ones(n)
    )


def with_range(labels, centroid_m):
    n = len(labels)
    unknown = np.zeros((0, 2), np.int64)
    size_m = np.full((n, 3), SIDE_M)
    return SaliencyGraph(
        labels, np.ones(n), np.full(n, 1 / n), np.array(centroid_m, float), size_m, np.zeros(n), unknown
    )


def bearings(labels, centroid_m, origin_m=(0, 0, 0)):
    """Cubes seen from a position: by Cauchy's formula a cube covers 1.5 side^2 / range^2 on average."""
    offset_m = np.array(centroid_m, float) - origin_m
    solid_angle_sr = 1.5 * SIDE_M**2 / (offset_m**2).sum(1) * np.exp(BEARINGS.size_bias_log)
    graph = without_range(with_range(labels, centroid_m))
    origins = np.tile(np.array(origin_m, float), (len(labels), 1))
    return replace(graph, bearing=unit_vectors(offset_m), solid_angle_sr=solid_angle_sr, origin_m=origins)


def scorer_of(places, graph):
    index = index_places(places, [np.zeros((1, 3))] * len(places), RATES, LIKELIHOOD)
    return PlaceLikelihood(QueryObjects.of(graph, index.vocabulary), index, RATES, LIKELIHOOD)


def room(seed):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-2.5, 2.5, (8, 2)), rng.uniform(-1, 1, 8)])


def test_one_bearing_has_the_density_of_student_and_of_the_solid_angle():
    """The query sees a lamp straight ahead. In the map it is at 3 m, 0.03 rad to the left and 0.02 rad higher."""
    azimuth, elevation, range_m = 0.03, 0.02, 3.0
    point = range_m * np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    graph = replace(bearings(["lamp"], [[2.0, 0, 0]]), solid_angle_sr=np.array([0.05]))
    scorer = scorer_of([place(["lamp"], [point])], graph)
    score, share = scorer.score(Poses(np.zeros(1, int), np.zeros((1, 2)), np.zeros(1)))
    rise = point[2] / range_m
    across = BEARINGS.horizontal_error_m**2 + 0.01 + (BEARINGS.side_error_share * SIDE_M) ** 2
    up = BEARINGS.vertical_error_m**2 + (BEARINGS.side_error_share * SIDE_M * rise) ** 2
    shape = np.diag(BEARINGS.bearing_error_rad**2 + np.array([across, up]) / range_m**2)
    offset = [point[1] / range_m, rise]
    frequency = 1.5 / 2  # of one lamp and of what the map lacks, half an object added to each
    ratio = RATES.label_agreement / frequency * BEARINGS.clutter_solid_angle_sr
    ratio *= multivariate_t.pdf(offset, shape=shape, df=3)
    expected_log = np.log(1.5 * SIDE_M**2 / range_m**2) + BEARINGS.size_bias_log
    ratio *= BEARINGS.size_span_log * norm.pdf(np.log(0.05), expected_log, BEARINGS.size_error_log)
    logit = BEARINGS.detection_logit + BEARINGS.detection_per_logit * RATES.detection_logit
    logit += BEARINGS.detection_per_distance * np.log(np.hypot(*point[:2]) / 2)
    odds = np.exp(logit) * ratio / RATES.clutter
    assert score[0] == pytest.approx(np.log1p(odds) - np.log1p(np.exp(logit)), abs=1e-4)
    assert share[0, 0] == pytest.approx(odds / (1 + odds), abs=1e-5)


def test_bearings_behind_the_camera_do_not_match():
    scorer = scorer_of([place(["lamp"], [[-3.0, 0, 0]])], bearings(["lamp"], [[3.0, 0, 0]]))
    _, share = scorer.score(Poses(np.zeros(1, int), np.zeros((1, 2)), np.zeros(1)))
    assert share[0, 0] < 1e-12


@pytest.mark.parametrize("camera_height_offset_m", [0.0, 0.3, -0.3])
def test_bearings_give_place_pose_and_height_of_the_camera(camera_height_offset_m):
    rooms = [room(seed) for seed in range(6)]
    T = pose_2d(0.6, -0.3, 2.2, camera_height_offset_m)
    graph = bearings(LABELS, transform_points(invert_pose(T), rooms[3]))
    scorer = scorer_of([place(LABELS, points, str(k)) for k, points in enumerate(rooms)], graph)
    refined = scorer.refine(best_poses(scorer, 3))
    best = int(refined.score.argmax())
    assert refined.poses.place[best] == 3
    start = refined.poses.take(np.array([best]))
    pose, covariance = refine_final_pose(scorer, start, scorer.score(start)[1], 0.0)
    estimate = [*pose.shift_m[0], pose.yaw_rad[0] % (2 * np.pi)]
    np.testing.assert_allclose(estimate, [0.6, -0.3, 2.2], atol=0.01 + 0.03 * abs(camera_height_offset_m))
    assert pose.camera_height_offset_m[0] == pytest.approx(
        camera_height_offset_m, abs=0.01 + 0.1 * abs(camera_height_offset_m)
    )
    assert (np.diag(covariance) > 0).all()


@pytest.mark.parametrize("camera_height_offset_m", [-0.22, 0.0, 0.22])
def test_a_hypothesis_has_the_height_of_the_camera(camera_height_offset_m):
    """The initial poses, before they are fitted, include one near the pose at each height of the camera."""
    points = room(3)
    graph = bearings(LABELS, transform_points(invert_pose(pose_2d(0.6, -0.3, 2.2, camera_height_offset_m)), points))
    poses = best_poses(scorer_of([place(LABELS, points)], graph), 3)
    offset_m = np.hypot(*(poses.shift_m - [0.6, -0.3]).T)
    assert (offset_m + np.abs(poses.camera_height_offset_m - camera_height_offset_m)).min() < 0.1


def test_bearings_from_several_positions_are_one_query():
    """Half of the objects seen from the pose, the others from a camera 1 m beside it."""
    points = room(5)
    local_m = transform_points(invert_pose(pose_2d(0.4, 0.5, 1.1)), points)
    parts = [bearings(LABELS[:4], local_m[:4]), bearings(LABELS[4:], local_m[4:], (0.0, 1.0, 0.0))]
    scorer = scorer_of([place(LABELS, points)], concatenate_graphs(parts))
    refined = scorer.refine(best_poses(scorer, 3))
    best = refined.poses.take(np.array([int(refined.score.argmax())]))
    np.testing.assert_allclose([*best.shift_m[0], best.yaw_rad[0]], [0.4, 0.5, 1.1], atol=0.02)


def test_objects_with_and_without_range_are_one_query():
    points = room(8)
    local_m = transform_points(invert_pose(pose_2d(-0.4, 0.2, 0.7)), points)
    # The graph of one sighting with a bearing first: objects with range come first in the query.
    graph = concatenate_graphs([bearings(LABELS[4:], local_m[4:]), with_range(LABELS[:4], local_m[:4])])
    index = index_places([place(LABELS, points)], [np.zeros((1, 3))], RATES, LIKELIHOOD)
    result = search(QueryObjects.of(graph, index.vocabulary), index, RATES, LIKELIHOOD, 3)
    pose, _ = refine_final_pose(result.scorer, result.poses, result.share(0), 0.0)
    np.testing.assert_allclose([*pose.shift_m[0], pose.yaw_rad[0]], [-0.4, 0.2, 0.7], atol=0.01)
    assert (result.share(0).max(1) > 0.5).all()


@pytest.mark.parametrize("factor", [0.85, 1.0, 1.2])
def test_ranges_that_are_off_by_one_factor_give_the_factor(factor):
    points = room(2)
    local_m = factor * transform_points(invert_pose(pose_2d(0.5, -0.6, 2.0)), points)
    scorer = scorer_of([place(LABELS, points)], with_range(LABELS, local_m))
    refined = scorer.refine(best_poses(scorer, 3))
    start = refined.poses.take(np.array([int(refined.score.argmax())]))
    pose, _ = refine_final_pose(scorer, start, scorer.score(start)[1], 0.0)
    assert pose.scale[0] == pytest.approx(1 / factor, rel=0.02)
    np.testing.assert_allclose([*pose.shift_m[0], pose.yaw_rad[0]], [0.5, -0.6, 2.0], atol=0.06)
