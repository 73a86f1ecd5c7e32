"""Views joined in the frame of the last view, against positions, sectors and outlines worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from salframe_graphs.places.likelihood import PlaceLikelihood
from salframe_graphs.places.merging import Place
from salframe_graphs.places.place_index import index_places
from salframe_graphs.places.poses import Poses
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.rates import Likelihood, shipped_rates
from salframe_graphs.sectors import BINS, Sectors, shown_bins
from salframe_graphs.views import ViewObjects, join_objects, join_outlines, join_sectors

from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.graphs.graph import SaliencyGraph
from salframe.localization.map import LocalizationMap
from salframe.panoramas.geometry import equirectangular_rays, invert_pose, pose_2d, pose_errors, transform_points
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.query_view import as_query
from salframe.panoramas.turning import turned
from salframe.panoramas.view import OdometryNoise, View
from salframe.testing.rooms import map_frames, query_frames, query_truths

MOTIONS = np.array([pose_2d(-2, 0, np.pi / 2), np.eye(4)])  # the first view is 2 m behind and looks to the left


def graph(labels, common_m, T_common_view, scores=0.8, yaw_rad=0.0):
    """The graph of a view with objects at positions in the frame of the last view."""
    n = len(labels)
    centroid_m = transform_points(invert_pose(T_common_view), np.reshape(common_m, (n, 3)).astype(float))
    return SaliencyGraph(
        labels,
        np.full(n, scores),
        np.full(n, 1 / max(n, 1)),
        centroid_m,
        np.ones((n, 3)),
        np.full(n, yaw_rad),
        np.zeros((0, 2), np.int64),
    )


def test_sightings_of_one_object_are_merged_and_the_nearest_gives_the_yaw():
    graphs = [
        graph(["bed", "lamp"], [[-2, 1, 0], [1, 5, 0]], MOTIONS[0], scores=0.9, yaw_rad=0.3),
        graph(["bed", "chair"], [[-2, 1.1, 0], [3, 0, 0]], MOTIONS[1], scores=0.5, yaw_rad=1.0),
    ]
    joined = join_objects(graphs, MOTIONS, OdometryNoise(), ViewObjects())
    row = {label: number for number, label in enumerate(joined.labels)}
    assert sorted(row) == ["bed", "chair", "lamp"]
    np.testing.assert_allclose(joined.centroid_m[row["lamp"]], [1, 5, 0], atol=1e-12)
    drift = 0.04**2 + np.radians(1) ** 2  # 2 % of 2 m, and one step seen from 1 m
    variance = np.array([0.15**2 + 0.05**2 + drift, 0.15**2 + 0.05**2 * (4 + 1.21)])
    expected = np.average([1, 1.1], weights=1 / variance)
    np.testing.assert_allclose(joined.centroid_m[row["bed"]], [-2, expected, 0])
    assert joined.scores[row["bed"]] == 0.9
    np.testing.assert_allclose(joined.yaw_rad[row["bed"]] % np.pi, (0.3 + np.pi / 2) % np.pi)


def test_drift_decides_what_is_one_object():
    graphs = [graph(["bed"], [[2, 0, 0]], MOTIONS[0]), graph(["bed"], [[3.2, 0, 0]], MOTIONS[1])]
    assert len(join_objects(graphs, MOTIONS, OdometryNoise(), ViewObjects())) == 2
    assert len(join_objects(graphs, MOTIONS, OdometryNoise(drift_share=0.3), ViewObjects())) == 1
    assert len(join_objects(graphs, MOTIONS, OdometryNoise(heading_drift_deg=10), ViewObjects())) == 1
    assert len(join_objects(graphs, MOTIONS, OdometryNoise(), ViewObjects(position_error_m=0.5))) == 1
    assert len(join_objects(graphs, MOTIONS, OdometryNoise(), ViewObjects(range_error_share=0.25))) == 1


def test_the_joined_outline_is_the_nearest_point_in_each_bin():
    first, last = np.full(BINS, np.nan), np.full(BINS, np.nan)
    first[0] = 4.0  # at 2.5 degrees, 92.5 in the last view's frame, from (-2, 0)
    last[0], last[27] = 3.0, 6.0
    outline = join_outlines([first, last], MOTIONS)
    point = np.array([-2 - 4 * np.sin(np.radians(2.5)), 4 * np.cos(np.radians(2.5))])
    number = int(np.degrees(np.arctan2(point[1], point[0])) // 5)
    np.testing.assert_allclose(outline[0], 3.0)
    np.testing.assert_allclose(outline[number], np.hypot(*point), rtol=1e-6)
    assert np.isfinite(outline).sum() == len({0, 27, number})
    nearer = join_outlines([last / 2, None, last], np.array([np.eye(4)] * 3))
    np.testing.assert_allclose(nearer[[0, 27]], [1.5, 3.0])


def test_shown_bins_are_those_of_the_field_of_view():
    rays = equirectangular_rays(180)
    bins = shown_bins(np.abs(np.arctan2(rays[..., 1], rays[..., 0])) <= np.radians(45))
    np.testing.assert_array_equal(np.flatnonzero(bins), [*range(9), *range(63, 72)])
    poles = np.abs(rays[..., 2]) < 0.9  # a panorama without its poles shows all directions
    assert shown_bins(poles).all()


def test_joined_sectors_are_the_union_around_the_position_of_each_view():
    ahead = np.zeros(BINS, bool)
    ahead[[0, 71]] = True  # 5 degrees to each side
    view = Sectors.of_view(ahead, None)
    joined = join_sectors([view, view], MOTIONS)
    # The first view looks along +y from (-2, 0), the last along +x from the origin.
    shown = joined.show(np.array([-2 + 3j, 0 + 3j, 5 + 0.1j, -5 + 0.1j]))
    np.testing.assert_array_equal(shown, [True, False, True, False])
    assert joined.share == pytest.approx(4 / BINS)
    assert join_sectors([view, Sectors.of_view(None, None)], MOTIONS).share == 1


def test_objects_behind_walls_should_not_be_seen():
    """A view from a corridor along +x: the walls at its sides are 1 m away, and nothing is known of its ends."""
    outline_m = np.full(BINS, np.nan, np.float32)
    outline_m[9:27] = outline_m[45:63] = 1.0
    points = np.array([1.29j, 1.31j, -1.29j, -1.31j, 40 + 0.1j, -40 + 0.1j])
    expected = [True, False, True, False, True, True]
    np.testing.assert_array_equal(Sectors.of_view(None, outline_m).show(points), expected)
    half = np.arange(BINS) < BINS // 2  # the left half
    np.testing.assert_array_equal(Sectors.of_view(half, outline_m).show(points), np.array(expected) & (points.imag > 0))


def test_only_objects_in_shown_sectors_count_as_missed():
    rates, likelihood = shipped_rates(), Likelihood()
    place = Place(
        "a",
        (0,),
        ("bed", "sofa"),
        np.array([[2.0, 0, 0], [-2.0, 0, 0]]),
        np.full(2, 0.01),
        np.zeros((2, 3)),
        np.zeros(2),
        np.ones(2),
    )
    index = index_places([place], [np.zeros((1, 3))], rates, likelihood)
    query = QueryObjects.of(graph(["bed"], [[2, 0, 0]], np.eye(4)), index.vocabulary)
    front = np.zeros(BINS, bool)
    front[[*range(9), *range(63, 72)]] = True
    pose = Poses(np.zeros(1, int), np.zeros((1, 2)), np.zeros(1))
    whole = PlaceLikelihood(query, index, rates, likelihood)
    partial = PlaceLikelihood(query, index, rates, likelihood, Sectors.of_view(front, None))
    logit = whole.detection_logit(np.array([1]), np.array([2.0]))[0]
    gain = partial.score(pose)[0] - whole.score(pose)[0]
    np.testing.assert_allclose(gain, np.log1p(np.exp(logit)), rtol=1e-5)  # the sofa behind the camera


def view_of_a_bed():
    instance_id = np.zeros((64, 128), np.int32)
    instance_id[28:36, 60:68] = 1
    return Panorama("view", annotations=Annotations(instance_id, {1: "bed"}))


def preset(method):
    config = configure("localizer", method, settings("localizer", method), [{"detector": "annotations"}])
    return registry().build("localizer", config)


def test_saliency_graph_does_not_join_views_without_range():
    localizer = preset("saliency-graph")
    description = localizer.describe(view_of_a_bed())
    assert localizer.join([description] * 2, MOTIONS, OdometryNoise()) is None


def test_bearings_of_views_keep_the_positions_of_their_cameras():
    """The bed lies ahead of both cameras, the first of which is turned by 90 degrees."""
    localizer = preset("proposed")
    description = localizer.describe(view_of_a_bed())
    joined = localizer.join([description] * 2, MOTIONS, OdometryNoise())
    assert joined["labels"].tolist() == ["bed", "bed"]
    np.testing.assert_allclose(joined["origin_m"], MOTIONS[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(joined["bearing"][0], MOTIONS[0][:3, :3] @ description["bearing"][0], atol=1e-9)
    np.testing.assert_allclose(joined["solid_angle_sr"], description["solid_angle_sr"][0])


def test_views_with_and_without_range_are_one_query():
    localizer = preset("proposed")
    description = localizer.describe(view_of_a_bed())
    ranged = localizer.describe(replace(view_of_a_bed(), range_m=np.full((64, 128), 2.0, np.float32)))
    joined = localizer.join([description, ranged], MOTIONS, OdometryNoise())
    assert np.isfinite(joined["centroid_m"]).all(1).tolist() == [True, False]


def test_views_that_cover_the_sphere_give_the_pose_of_the_panorama():
    config = configure("localizer", "proposed", settings("localizer", "proposed"), [{"detector": "annotations"}])
    built = LocalizationMap.build(registry().build("localizer", config), map_frames())
    for query in query_frames():
        panorama, truth = query.load(), query_truths()[query.id]
        width = panorama.range_m.shape[1]
        turns = [-width // 2, -width // 4, 0]  # the last view has the heading of the panorama
        half = registry().get("dataset", "house").Config(query_fov_deg=180)
        views = [
            View(as_query(turned(panorama, columns), half), pose_2d(0, 0, 2 * np.pi * columns / width))
            for columns in turns
        ]
        answer = built.localize(views=views)
        assert answer.places[0].place == truth.place
        error_m, error_rad = pose_errors(answer.T_world_query, truth.T_world_pano)
        assert error_m < 0.25
        assert error_rad < np.radians(5)
