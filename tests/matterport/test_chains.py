"""Driven queries of real buildings: walks along the connectivity graph, and maps that their views are no part of."""

import json
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from salframe_matterport.dataset import MatterportAnnotations

from salframe.framework.errors import ConfigError
from salframe.framework.validation import validate
from salframe.panoramas.geometry import invert_pose, transform_points

DRIVEN = {"query_views": 3, "query_motion": "driven", "query_odometry": {"drift_share": 0, "heading_drift_deg": 0}}


def opened(building, **settings):
    return MatterportAnnotations(validate(MatterportAnnotations.Config, {"root": building.root, **settings}, "data:"))


@pytest.fixture
def row(building):
    """Eight viewpoints of one region along x, 1.2 m apart, that see the same three balls. There is a way between
    neighbours, except between v3 and v4."""
    names = [f"v{i}" for i in range(8)]
    building.viewpoints = {name: (1.2 * i, 0.1 * i, 1.5, 40 * i, 0) for i, name in enumerate(names)}
    building.balls = {
        1: ("bed", (4.0, 1.8, 0.6), 0.3),
        2: ("lamp", (3.4, -1.2, 2.2), 0.2),
        3: ("sofa", (5, 1, 0.5), 0.4),
    }
    building.sees = {}
    building.write()
    path = building.root / "connectivity" / "fake_connectivity.json"
    listed = json.loads(path.read_text())
    for i, viewpoint in enumerate(listed):
        viewpoint["unobstructed"] = [abs(i - j) == 1 and {i, j} != {3, 4} for j in range(8)]
    path.write_text(json.dumps(listed))
    return building


def viewpoints_of(query):
    """The numbers of the viewpoints of a query's views; an id is fake/QUERY/query or fake/QUERY/query/VIEWPOINT."""
    return [int((view.id.split("/")[3:] or [view.id.split("/")[1]])[0][1:]) for view in query.views]


def test_each_view_of_a_walk_is_a_neighbour_of_the_next_and_in_no_map(row):
    graph = nx.Graph([(i, i + 1) for i in range(7) if i != 3])
    for fold in opened(row, **DRIVEN).folds():
        (query,) = fold.queries
        walk = viewpoints_of(query)
        assert query.id == f"fake/v{walk[-1]}/query"
        assert len(set(walk)) == 3
        assert all(nx.has_path(graph, *pair) for pair in pairwise(walk))
        if walk[-1] in (0, 3, 4, 7):  # at an end of a row of four, the walk can only go on along the row
            assert all(graph.has_edge(*pair) for pair in pairwise(walk))
        mapped = {int(frame.id.removeprefix("fake/v")) for frame in fold.references}
        assert mapped == set(range(8)) - set(walk)


def test_a_walk_is_shorter_where_no_more_viewpoints_can_be_reached_and_its_end_does_not_depend_on_its_length(row):
    walks = [
        {fold.id: viewpoints_of(fold.queries[0]) for fold in opened(row, **DRIVEN | {"query_views": count}).folds()}
        for count in (2, 3, 6)
    ]
    for scene in walks[0]:
        short, middle, long = (walk[scene] for walk in walks)
        assert middle[-2:] == short
        assert long[-3:] == middle
        assert sorted(long) == (list(range(4)) if long[-1] < 4 else list(range(4, 8)))


def test_the_motions_move_the_objects_of_all_views_to_one_place(row):
    dataset = opened(row, range_noise=0.0, **DRIVEN)
    for fold in dataset.folds():
        (query,) = fold.queries
        truth = dataset.truth(query.id).T_world_pano
        seen = []
        for view, T in zip(query.views, query.T_last_view, strict=True):
            objects = view.load().annotations.objects
            centroids = transform_points(truth @ T, objects.centroid_m)
            seen.append(dict(zip(objects.labels, centroids, strict=True)))
        for objects in seen:
            for label, position in objects.items():
                true_position = next(ball[1] for ball in row.balls.values() if ball[0] == label)
                np.testing.assert_allclose(position, true_position, atol=0.1)
        first, last = query.T_last_view[0], query.T_last_view[-1]
        np.testing.assert_allclose(last, np.eye(4), atol=1e-12)
        walk = viewpoints_of(query)
        step_m = np.linalg.norm((invert_pose(last) @ first)[:3, 3])
        assert step_m == pytest.approx(abs(walk[0] - walk[-1]) * np.hypot(1.2, 0.1))


def test_the_last_view_is_the_query_of_one_view(row):
    single = {fold.id: fold.queries[0] for fold in opened(row, map_share=0.5).folds()}
    driven = {fold.id: fold.queries[0] for fold in opened(row, map_share=0.5, **DRIVEN).folds()}
    assert single.keys() == driven.keys()
    for scene, query in driven.items():
        one, last = (q.load().annotations.objects for q in (single[scene], query.views[-1]))
        assert one.keys == last.keys
        np.testing.assert_array_equal(one.centroid_m, last.centroid_m)


def test_an_object_has_one_simulated_error_in_all_views_of_a_query(row):
    noise = {"query_noise": {"mislabelled": 0.5}, **DRIVEN}

    def labels(settings):
        drawn = []
        for fold in opened(row, **settings).folds():
            views = [view.load().annotations.objects for view in fold.queries[0].views]
            drawn += [[dict(zip(v.keys, v.labels, strict=True))[key] for v in views] for key in views[0].keys]
        return drawn

    assert all(len(set(of_object)) == 1 for of_object in labels(noise))
    assert any(len(set(of_object)) > 1 for of_object in labels(noise | {"query_errors": "per-view"}))


def test_a_share_of_the_viewpoints_is_the_map_of_all_queries(row):
    settings = {"map_share": 0.5, "query_triangulates": False}
    (single,), (driven,) = opened(row, **settings).folds(), opened(row, **settings, **DRIVEN).folds()
    assert [frame.id for frame in single.references] == [frame.id for frame in driven.references]
    mapped = {int(frame.id[len("fake/v")]) for frame in single.references}
    queries = {viewpoints_of(query)[-1] for query in single.queries}
    assert len(mapped) == 4
    assert mapped | queries == set(range(8))
    assert not mapped & queries
    assert [query.id for query in single.queries] == [query.id for query in driven.queries]
    assert all(not mapped & set(viewpoints_of(query)) for query in driven.queries)
    others = [{frame.id for frame in opened(row, seed=seed, map_share=0.5).folds()[0].references} for seed in range(5)]
    assert len(set(map(frozenset, others))) > 1
    (one_map,) = opened(row, map_share=0.5, one_map=True).folds()
    assert len(one_map.references) == 4


def test_a_shared_map_is_refused_with_leave_out(row):
    with pytest.raises(ConfigError, match=r"leave_out=2 with map_share=0\.5, expected leave_out=1"):
        opened(row, map_share=0.5, leave_out=2)
