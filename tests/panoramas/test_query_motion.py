"""Queries of several views: errors of odometry against their stated sizes, and turned views of a room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tiny_folder import write_tiny_folder

from salframe.framework.errors import DataError
from salframe.graphs.annotated import visible_objects
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.frames import Fold, QueryFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama
from salframe.panoramas.query_motion import OdometryErrors, measured_motion
from salframe.panoramas.query_view import view_queries
from salframe.testing.rooms import query_frames

STEPS = np.array([pose_2d(-2, 1, 0.4), pose_2d(-1, 0.5, 0.2), np.eye(4)])
DRAWS = 2000


def views_of(query: QueryFrame, **settings) -> QueryFrame:
    """The query with views by settings."""
    (fold,) = view_queries([Fold("f", (), (query,))], FolderDataset.Config(**settings), "key")
    return fold.queries[0]


def test_without_errors_the_measured_motion_is_the_true_one():
    exact = OdometryErrors(drift_share=0, heading_drift_deg=0)
    np.testing.assert_allclose(measured_motion(STEPS, exact, (0,)), STEPS, atol=1e-12)


def test_errors_have_the_stated_sizes():
    """One step of 2 m: the position of the last view in coordinates of the first has errors of 0.1 m along each axis
    and of 20 % of a common scale, its heading one of 3 degrees."""
    steps = np.array([pose_2d(-2, 0, 0), np.eye(4)])
    errors = OdometryErrors(drift_share=0.05, heading_drift_deg=3, scale_share=0.2)
    drawn = np.linalg.inv(np.array([measured_motion(steps, errors, (seed,))[0] for seed in range(DRAWS)]))
    tolerance = 4 / np.sqrt(2 * DRAWS)
    assert drawn[:, 0, 3].std() == pytest.approx(np.hypot(0.1, 0.4), rel=tolerance)
    assert drawn[:, 1, 3].std() == pytest.approx(0.1, rel=tolerance)
    assert np.degrees([pose_yaw(T) for T in drawn]).std() == pytest.approx(3, rel=tolerance)
    assert drawn[:, 0, 3].mean() == pytest.approx(2, abs=4 * np.hypot(0.1, 0.4) / np.sqrt(DRAWS))


def test_a_turn_on_the_spot_moves_nothing():
    steps = np.array([pose_2d(0, 0, -1.0), pose_2d(0, 0, -0.5), np.eye(4)])
    measured = measured_motion(steps, OdometryErrors(drift_share=0.5, scale_share=0.5), (3,))
    np.testing.assert_array_equal(measured[:, :3, 3], 0)
    assert not np.allclose(measured[0], steps[0])


def test_shuffled_odometry_gives_each_view_the_motion_of_another():
    steps = np.array([pose_2d(x, 0, 0) for x in (-4.0, -3.0, -2.0, -1.0)] + [np.eye(4)])
    errors = OdometryErrors(drift_share=0, heading_drift_deg=0, shuffled=True)
    for seed in range(50):
        shuffled = measured_motion(steps, errors, (seed,))[:, 0, 3]
        assert sorted(shuffled) == [-4, -3, -2, -1, 0]
        assert shuffled[-1] == 0
        assert (shuffled[:-1] != steps[:-1, 0, 3]).all()


def test_an_object_of_a_turned_view_lies_where_the_motion_says():
    query = query_frames()[0]
    whole = {o.key: o.points_m for o in visible_objects(query.load())}
    exact = {"drift_share": 0, "heading_drift_deg": 0}
    frame = views_of(query, query_fov_deg=150, query_views=3, query_odometry=exact)
    assert [view.id for view in frame.views] == [f"{query.id}/2-before", f"{query.id}/1-before", query.id]
    compared = 0
    for view, T in zip(frame.views, frame.T_last_view, strict=True):
        for found in visible_objects(view.load()):
            if len(found.points_m) == len(whole[found.key]):  # the whole object is in view
                np.testing.assert_allclose(
                    T[:3, :3] @ found.points_m.mean(0), whole[found.key].mean(0), atol=np.radians(1.0) * 5
                )
                compared += 1
    assert compared >= 4
    assert pose_yaw(frame.T_last_view[0]) == pytest.approx(-2 * np.radians(90))


def test_listed_objects_turn_with_the_camera():
    """A bed 60 degrees to the right of the last view is 12 degrees to the left of one turned by 72 degrees."""
    at = 2 * np.array([[np.cos(np.radians(-60)), np.sin(np.radians(-60)), 0]])
    box = ObjectBoxes(("bed",), ("bed",), at, np.ones((1, 3)), np.array([0.3]))
    query = QueryFrame("q", lambda: Panorama("q", annotations=Annotations(objects=box)))
    frame = views_of(query, query_fov_deg=120, query_views=3)
    second, first = [view.load().annotations.objects for view in frame.earlier][::-1]
    angle = np.radians(12)
    np.testing.assert_allclose(second.centroid_m, [[2 * np.cos(angle), 2 * np.sin(angle), 0]], atol=1e-12)
    np.testing.assert_allclose(second.yaw_rad, [0.3 + np.radians(72)])
    assert not first.labels


@pytest.mark.parametrize(("errors", "ids"), [("per-query", {"q"}), ("per-view", {"q", "q/1-before", "q/2-before"})])
def test_errors_per_query_are_equal_in_all_views(errors, ids):
    query = replace(query_frames()[0], id="q", load=lambda: replace(query_frames()[0].load(), id="q"))
    frame = views_of(query, query_fov_deg=90, query_views=3, query_errors=errors)
    assert {view.load().error_id for view in frame.views} == ids


def test_descriptions_are_shared_between_numbers_of_views_and_odometries():
    query = query_frames()[0]
    few = views_of(query, query_fov_deg=90, query_views=2)
    many = views_of(query, query_fov_deg=90, query_views=4, query_odometry={"drift_share": 0.1})
    assert [view.content for view in few.views] == [view.content for view in many.views[-2:]]
    assert len({view.content for view in many.views}) == 4
    assert views_of(query, query_fov_deg=60, query_views=2).views[0].content != few.views[0].content


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"query_views": 3}, "query_views is 3, but the queries are whole panoramas, expected .* narrower"),
        ({"query_views": 3, "query_motion": "driven"}, "query_motion=driven needs other views near the query"),
    ],
)
def test_views_that_cannot_be_taken_are_refused(tmp_path, settings, message):
    dataset = FolderDataset(FolderDataset.Config(root=write_tiny_folder(tmp_path), **settings))
    with pytest.raises(DataError, match=message):
        dataset.folds()
