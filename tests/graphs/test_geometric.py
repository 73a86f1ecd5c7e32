"""The matcher `geometric` on rooms drawn at random, whose nodes and poses are known."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from drawn_rooms import LABELS, candidates_of, graph_of, room
from salframe_graphs import node_matcher
from salframe_graphs.geometric import GeometricMatcher
from salframe_graphs.retrieval.inverted_lists import InvertedLists

from salframe.framework.errors import ConfigError
from salframe.framework.files.columns import read_columns
from salframe.framework.validation import validate
from salframe.graphs.detections import Detections
from salframe.graphs.graph import without_range
from salframe.graphs.table import MappedGraphs, write_graphs
from salframe.panoramas.geometry import pose_2d, pose_errors


def matcher(**settings):
    return GeometricMatcher(GeometricMatcher.Config(**settings))


@pytest.fixture(scope="module")
def rooms():
    return [room(seed) for seed in range(30)]


def test_candidates_are_those_of_a_large_jaccard_index_of_multisets(rooms):
    """Against collections.Counter, whose & and | are the intersection and union of multisets."""
    graphs, query = [graph_of(r) for r in rooms], graph_of(room(99, nodes=11))
    labels = Counter(query.labels)
    jaccard = [(labels & Counter(g.labels)).total() / (labels | Counter(g.labels)).total() for g in graphs]
    for share in (0.3, 0.6, 0.9):
        expected = {number for number, value in enumerate(jaccard) if value >= share * max(jaccard)}
        assert (
            candidates_of(matcher(rarity=False, min_candidate_ratio=share, min_similarity=0.0), query, graphs)
            == expected
        )


def test_rare_labels_count_more(rooms):
    """With smooth inverse document frequency, by hand."""
    graphs, query = [graph_of(r) for r in rooms], graph_of(room(99, nodes=11, labels=(*LABELS, "stranger")))
    having = Counter(label for graph in graphs for label in set(graph.labels))
    rarity = {label: np.log(31 / (1 + having[label])) + 1 for label in (*LABELS, "stranger")}
    labels = Counter(query.labels)

    def weigh(counter):
        return sum(rarity[label] * number for label, number in counter.items())

    jaccard = [weigh(labels & Counter(g.labels)) / weigh(labels | Counter(g.labels)) for g in graphs]
    expected = {number for number, value in enumerate(jaccard) if value >= 0.7 * max(jaccard)}
    assert candidates_of(matcher(min_candidate_ratio=0.7), query, graphs) == expected


def test_a_moved_room_is_found_with_its_nodes_and_pose(rooms):
    index = matcher().index([graph_of(r) for r in rooms])
    for scene, objects in enumerate(rooms):
        T = pose_2d(0.4, -0.5, 0.2 * scene)
        query = graph_of(objects, T)
        best = matcher().match(query, index, 5)[0]
        assert best.scene == scene
        np.testing.assert_array_equal(
            best.pairs[:, 0], best.pairs[:, 1]
        )  # both graphs list the same objects by saliency
        assert len(best.pairs) == len(objects)
        assert pose_errors(best.T_scene_query, T) == pytest.approx((0, 0), abs=1e-6)


def test_twin_rooms_are_told_apart_by_geometry():
    """The same objects at other places, and the same mirrored: labels cannot tell, one pose can."""
    right = room(5)
    rng = np.random.default_rng(6)
    elsewhere = Detections(
        right.labels,
        right.scores,
        right.centroid_m[rng.permutation(8)] * [1, 1, 0] + right.centroid_m * [0, 0, 1],
        right.size_m,
        right.yaw_rad,
    )
    mirrored = Detections(right.labels, right.scores, right.centroid_m * [1, -1, 1], right.size_m, -right.yaw_rad)
    graphs = [graph_of(elsewhere), graph_of(mirrored), graph_of(right)]
    query = graph_of(right, pose_2d(0.5, 0.3, 2.0))
    one = matcher()
    ranked = one.match(query, one.index(graphs), 3)
    assert ranked[0].scene == 2
    assert ranked[0].score > 1.2 * ranked[1].score
    blind = matcher(geometry_score=0.0, structure_weight=0.0)
    scores = [m.score for m in blind.match(query, blind.index(graphs), 3)]
    assert max(scores) == pytest.approx(min(scores))


def test_matches_are_one_to_one_and_alike(rooms):
    graphs = [graph_of(r) for r in rooms]
    one = matcher()
    for match in one.match(graph_of(room(77, nodes=12)), one.index(graphs), 30):
        query, reference = match.pairs.T
        assert len(set(query)) == len(query)
        assert len(set(reference)) == len(reference)
        assert [graph_of(room(77, nodes=12)).labels[i] for i in query] == [
            graphs[match.scene].labels[j] for j in reference
        ]


def test_strangers_and_empty_maps_match_nothing(rooms):
    one = matcher()
    stranger = graph_of(room(1, labels=("spaceship",)))
    assert one.match(stranger, one.index([graph_of(r) for r in rooms]), 5) == []
    assert one.match(graph_of(rooms[0]), one.index([graph_of(Detections.empty())]), 5) == []
    assert one.match(graph_of(Detections.empty()), one.index([graph_of(r) for r in rooms]), 5) == []


@pytest.mark.parametrize(("geometry_score", "weight"), [(0.0, 1.0), (2.0, 3.0)])
def test_a_node_counts_as_much_as_its_detector_is_sure(geometry_score, weight):
    """Five objects that query and map share, and two of the map's alone: the Jaccard index is that of the sums of their
    scores."""
    shared = Detections(
        LABELS[:5], np.array([0.9, 0.8, 0.7, 0.6, 0.5]), room(0, 5).centroid_m, np.ones((5, 3)), np.zeros(5)
    )
    extra = Detections(
        LABELS[5:7], np.array([0.3, 0.1]), np.array([[2.0, 2, 0], [-2, 2, 0]]), np.ones((2, 3)), np.zeros(2)
    )
    more = Detections(
        (*shared.labels, *extra.labels),
        *(
            np.concatenate([getattr(shared, name), getattr(extra, name)])
            for name in ("scores", "centroid_m", "size_m", "yaw_rad")
        ),
    )
    settings = {"structure_weight": 0.0, "rarity": False, "geometry_score": geometry_score}
    for confidence, expected in ((True, 3.5 / 3.9), (False, 5 / 7)):
        one = matcher(**settings, confidence=confidence)
        for query, reference in ((shared, more), (more, shared)):
            found = one.match(graph_of(query), one.index([graph_of(reference)]), 1)[0]
            assert found.score == pytest.approx(weight * expected)


def test_nodes_of_score_zero_count_nothing():
    unsure = Detections(LABELS[:3], np.zeros(3), room(0, 3).centroid_m, np.ones((3, 3)), np.zeros(3))
    one = matcher()
    assert one.match(graph_of(unsure), one.index([graph_of(unsure)]), 1)[0].score == 0


def test_a_match_tells_the_scale_that_the_positioner_uses(rooms):
    """Found with the settings of a map whose queries' range is estimated; without them the factor is 1."""
    graphs = [graph_of(each) for each in rooms]
    query = graphs[3]
    stretched = replace(query, centroid_m=query.centroid_m * 1.2, size_m=query.size_m * 1.2)
    index = matcher(max_scale_error=0.3).index(graphs)
    best = matcher(max_scale_error=0.3).match(stretched, index, 3)[0]
    assert best.scene == 3
    assert best.scale == pytest.approx(1 / 1.2, abs=1e-6)
    assert matcher().match(stretched, index, 3)[0].scale == 1.0


def test_no_more_candidates_than_asked_for_are_matched(rooms):
    """The first of the scene index: the query's own room is one of three, among thirty."""
    graphs = [graph_of(r) for r in rooms]
    query = graph_of(rooms[7], pose_2d(0.3, -0.2, 1.0))
    few, all_of_them = (
        matcher(max_candidates=3, min_candidate_ratio=0.0),
        matcher(max_candidates=None, min_candidate_ratio=0.0),
    )
    found, others = (one.match(query, one.index(graphs), 30) for one in (few, all_of_them))
    assert len(found) == 3 < len(others)
    assert (found[0].scene, found[0].score) == (7, pytest.approx(others[0].score, rel=1e-12))


def test_candidates_are_those_of_the_scene_index(rooms):
    """And where ranges may be off by a factor, those by labels alone."""
    graphs = [graph_of(r) for r in rooms]
    query = graph_of(rooms[7], pose_2d(0.3, -0.2, 1.0))
    scenes = InvertedLists()
    scenes.take(graphs)
    for error, asked in ((0.0, query), (0.2, without_range(query))):
        one = matcher(max_candidates=5, min_candidate_ratio=0.0, max_scale_error=error)
        found = [match.scene for match in one.match(query, one.index(graphs), 30)]
        assert sorted(found) == sorted(scenes.candidates(asked, 5).scene.tolist())


def test_graphs_on_disk_match_alike_whether_features_are_kept_or_not(rooms, tmp_path, monkeypatch):
    graphs = [graph_of(room(seed, nodes=3 + seed % 9)) for seed in range(30)]
    write_graphs(graphs, tmp_path / "graphs")
    table, query = MappedGraphs(read_columns(tmp_path / "graphs")), graph_of(rooms[7], pose_2d(0.3, -0.2, 1.0))
    one = matcher()
    precomputed, scores = one.index(table), []
    monkeypatch.setattr(node_matcher, "MAX_PRECOMPUTED", 10)
    anew = one.index(table)
    assert precomputed.structure is not None
    assert anew.structure is None
    for index in (precomputed, anew):
        scores.append([match.score for match in one.match(query, index, 30)])
    assert scores[0] == pytest.approx(scores[1], abs=1e-12)


@pytest.mark.parametrize("edges_m", [[2.0, 1.0], [0.0, 1.0], [1.0, 1.0]])
def test_rings_that_do_not_widen_are_refused(edges_m):
    with pytest.raises(ConfigError, match=r"ring_edges_m.*expected positive values in ascending order"):
        validate(GeometricMatcher.Config, {"kind": "geometric", "ring_edges_m": edges_m}, "matcher")
