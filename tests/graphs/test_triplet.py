"""The matcher on rooms drawn at random, whose nodes and poses are known."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from salframe_graphs import node_matcher
from salframe_graphs.agreement import agree
from salframe_graphs.features import feature_products, node2vec, ring_hop_histograms
from salframe_graphs.geometric import GeometricMatcher
from salframe_graphs.node_pairs import NodePairs
from salframe_graphs.retrieval.inverted_lists import InvertedLists
from salframe_graphs.triplet import TripletMatcher
from salframe_graphs.verification import ScaleBound, verify
from scipy.sparse import random_array

from salframe.framework.errors import ConfigError, RequirementMissing
from salframe.framework.files.columns import read_columns
from salframe.framework.validation import validate
from salframe.graphs.detections import Detections
from salframe.graphs.graph import GraphConfig, SaliencyGraph, build_graph, without_range
from salframe.graphs.matcher import GraphMatch
from salframe.graphs.table import GraphNodes, HeldGraphs, MappedGraphs, write_graphs
from salframe.panoramas.frames import MapFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, transform_points

LABELS = ("bed", "sofa", "chair", "table", "lamp", "plant", "tv", "desk", "picture", "cabinet")


def room(seed, nodes=8, labels=LABELS):
    """A random room's objects seen from its middle, biggest first."""
    rng = np.random.default_rng(seed)
    centroid = np.column_stack(
        [rng.uniform(-2.5, 2.5, nodes), rng.uniform(-2, 2, nodes), rng.uniform(-1.2, 0.8, nodes)]
    )
    size = rng.uniform(0.3, 1.8, (nodes, 3))
    return Detections(
        [str(name) for name in rng.choice(labels, nodes)], np.ones(nodes), centroid, size, rng.uniform(0, np.pi, nodes)
    )


def graph_of(detections, T=None):
    """The graph of these objects seen from pose T in their frame; every object keeps its saliency."""
    volume = detections.size_m.prod(1)
    if T is not None:
        moved = transform_points(invert_pose(T), detections.centroid_m)
        detections = Detections(detections.labels, detections.scores, moved, detections.size_m, detections.yaw_rad)
    return build_graph(detections, volume / volume.sum(), GraphConfig())


def matcher(**settings):
    return GeometricMatcher(GeometricMatcher.Config(**settings))


def triplets(**settings):
    return TripletMatcher(TripletMatcher.Config(**settings))


def kept(one, query, graphs):
    """The numbers of the graphs that a matcher ranks."""
    return {match.scene for match in one.match(query, one.index(graphs), len(graphs))}


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
        assert kept(matcher(rarity=False, keep=share, least_similarity=0.0), query, graphs) == expected
        assert kept(triplets(rarity=False, keep=share), query, graphs) == expected


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
    assert kept(matcher(keep=0.7), query, graphs) == expected


def test_set_jaccard_ignores_numbers(rooms):
    graphs, query = [graph_of(r) for r in rooms], graph_of(room(99, nodes=11, labels=(*LABELS, "stranger")))
    labels = set(query.labels)
    jaccard = [len(labels & set(g.labels)) / len(labels | set(g.labels)) for g in graphs]
    expected = {number for number, value in enumerate(jaccard) if value >= 0.8 * max(jaccard)}
    assert kept(triplets(rarity=False, labels="set", keep=0.8), query, graphs) == expected


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


def test_triplet_score_by_hand():
    """A path a-b-c against one that lacks b-c: I = w_ab over w_ab + w_bc."""
    saliency = np.array([0.5, 0.3, 0.2])
    base = {
        "labels": ("a", "b", "c"),
        "scores": np.ones(3),
        "saliency": saliency,
        "centroid_m": np.eye(3),
        "size_m": np.ones((3, 3)),
        "yaw_rad": np.zeros(3),
    }
    query = SaliencyGraph(**base, edges=np.array([[0, 1], [1, 2]]))
    reference = SaliencyGraph(**base, edges=np.array([[0, 1], [0, 2]]))
    settings = {"structure_weight": 0.0}
    ab, bc = np.sqrt(0.15), np.sqrt(0.06)
    for normalise, expected in ((True, ab / (ab + bc)), (False, ab)):
        one = triplets(**settings, normalise=normalise)
        assert one.match(query, one.index([reference]), 1)[0].score == pytest.approx(expected)
    edgeless = SaliencyGraph(**base, edges=np.zeros((0, 2), int))
    one = triplets(**settings)
    assert one.match(edgeless, one.index([reference]), 1)[0].score == pytest.approx(1.0)


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


def histograms(table):
    """(N, F) the structural features of all nodes of a table."""
    every = np.arange(len(table))
    labels = np.arange(len(table.labels))
    return ring_hop_histograms(table.take(every), table.adjacency(every), labels, (1.0, 2.0, 4.0), 2)


def test_ring_and_hop_histograms_by_hand():
    """Labels a, b, c on a line at 0, 1.5 and 3 m; only a and b are linked."""
    graph = SaliencyGraph(
        ("a", "b", "c"),
        np.ones(3),
        np.full(3, 1 / 3),
        np.array([[0, 0, 0], [1.5, 0, 0], [3, 0, 0]], float),
        np.ones((3, 3)),
        np.zeros(3),
        np.array([[0, 1]]),
    )
    found = histograms(HeldGraphs([graph]))
    a = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 0]]).ravel()
    np.testing.assert_allclose(found[0], a / np.linalg.norm(a))


def test_node2vec_is_seeded_and_joint():
    pytest.importorskip("gensim")
    graphs = [graph_of(room(3)), graph_of(room(3), pose_2d(0.3, 0.1, 1.0))]
    first, again = node2vec(graphs, seed=1), node2vec(graphs, seed=1)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    same_label = np.array([[x == y for y in graphs[1].labels] for x in graphs[0].labels])
    similarity = first[0] @ first[1].T
    assert similarity[same_label].mean() > similarity[~same_label].mean()


def every_pair(nodes):
    """All pairs of the nodes of a query and of one graph of that many nodes."""
    query, node = np.nonzero(np.ones((nodes, nodes)))
    return NodePairs(query, node, np.zeros(nodes * nodes, int), 1)


def test_verification_ignores_outliers():
    rng = np.random.default_rng(3)
    reference = rng.uniform(-3, 3, (1, 9, 2))
    T = pose_2d(0.7, -0.2, 1.1)
    query = transform_points(invert_pose(T), np.column_stack([reference[0], np.zeros(9)]))[:, :2]
    query[:3] = rng.uniform(-3, 3, (3, 2))
    given = query, reference[0], every_pair(9), np.ones(81), np.full(81, 0.3), np.full(9, 1 / 9)
    found = verify(*given, 4.0)
    assert pose_errors(found.poses(np.array([0]))[0], T) == pytest.approx((0, 0), abs=0.05)
    np.testing.assert_allclose(found.kernel.reshape(9, 9)[range(3, 9), range(3, 9)], 1, atol=0.05)
    far = verify(*given, 0.1)
    assert np.isnan(far.poses(np.array([0]))[0]).all()


@pytest.mark.parametrize("factor", [0.8, 0.92, 1.0, 1.15])
def test_a_bounded_scale_is_estimated_with_the_pose(factor):
    """A room whose ranges are all off by a factor: the exact pose and the factor that puts them right."""
    reference = np.random.default_rng(2).uniform(-3, 3, (9, 3)) * (1, 1, 0.4)
    truth = pose_2d(1.0, -0.5, 2.0)
    query = transform_points(invert_pose(truth), reference) * factor
    bound = ScaleBound(0.3, query[:, 2], reference[:, 2], 0.2)
    given = query[:, :2], reference[:, :2], every_pair(9), np.ones(81), np.full(81, 0.2), np.ones(9), 6.0
    found = verify(*given, bound)
    assert pose_errors(found.poses(np.array([0]))[0], truth) == pytest.approx((0, 0), abs=1e-6)
    np.testing.assert_allclose(np.diag(found.kernel.reshape(9, 9)), 1, atol=1e-5)
    rigid = verify(*given)
    assert (np.diag(rigid.kernel.reshape(9, 9)).sum() > 8.99) == (factor == 1.0)


def test_a_scale_beyond_the_bound_is_not_estimated():
    reference = np.random.default_rng(2).uniform(-3, 3, (9, 3)) * (1, 1, 0.4)
    bound, itself = ScaleBound(0.1, reference[:, 2] * 0.6, reference[:, 2], None), np.arange(9)
    pairs = NodePairs(itself, itself, np.zeros(9, int), 1)
    query_xy = reference[:, :2] * 0.6
    found = verify(query_xy, reference[:, :2], pairs, np.ones(9), np.full(9, 0.2), np.ones(9), 6.0, bound)
    assert found.kernel.sum() < 5


def test_a_match_tells_the_scale_that_the_positioner_uses(rooms):
    """Found with the settings of a map whose queries' range is estimated; without them the factor is 1."""
    graphs = [graph_of(each) for each in rooms]
    query = graphs[3]
    stretched = replace(query, centroid_m=query.centroid_m * 1.2, size_m=query.size_m * 1.2)
    index = matcher(largest_scale_error=0.3).index(graphs)
    best = matcher(largest_scale_error=0.3).match(stretched, index, 3)[0]
    assert best.scene == 3
    assert best.scale == pytest.approx(1 / 1.2, abs=1e-6)
    assert matcher().match(stretched, index, 3)[0].scale == 1.0


def test_agreeing_matches_outvote_a_lone_one():
    frames = [MapFrame(str(i), f"place-{i}", pose_2d(2.0 * i, 0, 0.5 * i)) for i in range(4)]
    there = pose_2d(3.0, 1.0, 0.3)
    matches = [GraphMatch(3, 1.0, np.zeros((0, 2), int), pose_2d(0, 0, 2.0))]
    matches += [
        GraphMatch(i, 0.8, np.zeros((0, 2), int), invert_pose(frames[i].T_world_pano) @ there) for i in range(2)
    ]
    matches.append(GraphMatch(2, 0.1, np.zeros((0, 2), int)))
    ranked = agree(matches, frames, 0.5, 1.5)
    assert [m.scene for m in ranked] == [0, 1, 3, 2]
    assert [m.score for m in ranked] == pytest.approx([1.2, 1.2, 1.0, 0.1])


def test_node2vec_without_gensim_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(RequirementMissing, match=r"needs gensim, not installed: pip install 'salframe\[node2vec\]'"):
        triplets(structure="node2vec")


def test_an_unweighted_graph_counts_triplets():
    """Four objects in a row, each in context with the next; the map lacks the edge of the last two."""

    def chain(edges):
        centroid = np.column_stack([np.arange(4.0), np.ones(4), np.zeros(4)])
        saliency = np.array([0.5, 0.3, 0.15, 0.05])
        return SaliencyGraph(LABELS[:4], np.ones(4), saliency, centroid, np.ones((4, 3)), np.zeros(4), np.array(edges))

    query, reference = chain([(0, 1), (1, 2), (2, 3)]), chain([(0, 1), (1, 2)])
    shares = {"unit": 2 / 3, "saliency": (0.15**0.5 + 0.045**0.5) / (0.15**0.5 + 0.045**0.5 + 0.0075**0.5)}
    numbers = {"unit": 2, "saliency": 0.15**0.5 + 0.045**0.5}
    for normalise, expected in ((True, shares), (False, numbers)):
        for weights, score in expected.items():
            one = triplets(edge_weights=weights, normalise=normalise)
            assert one.match(query, one.index([reference]), 1)[0].score == pytest.approx(score)


def test_no_more_candidates_than_asked_for_are_matched(rooms):
    """The first of the scene index: the query's own room is one of three, among thirty."""
    graphs = [graph_of(r) for r in rooms]
    query = graph_of(rooms[7], pose_2d(0.3, -0.2, 1.0))
    few, all_of_them = matcher(most=3, keep=0.0), matcher(most=None, keep=0.0)
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
        one = matcher(most=5, keep=0.0, largest_scale_error=error)
        found = [match.scene for match in one.match(query, one.index(graphs), 30)]
        assert sorted(found) == sorted(scenes.candidates(asked, 5).scene.tolist())


def defined_histograms(graph, vocabulary):
    """(N, F) structural features node by node, as defined."""
    rows = np.zeros((len(graph), 5, len(vocabulary)))
    for node in range(len(graph)):
        hops = {node: 0}
        for step in (1, 2):
            for a, b in [*graph.edges.tolist(), *graph.edges[:, ::-1].tolist()]:
                if hops.get(a) == step - 1:
                    hops.setdefault(b, step)
        for other in range(len(graph)):
            if other == node or graph.labels[other] not in vocabulary:
                continue
            label = vocabulary[graph.labels[other]]
            distance = np.hypot(*(graph.centroid_m[node] - graph.centroid_m[other])[:2])
            ring = np.searchsorted((1.0, 2.0, 4.0), distance, side="right")
            if ring < 3:
                rows[node, ring, label] += 1
            if other in hops:
                rows[node, 2 + hops[other], label] += 1
    rows = rows.reshape(len(graph), -1)
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)


def test_histograms_are_as_defined():
    """Graphs of other sizes together, node by node; a label that the vocabulary lacks is not counted."""
    graphs = [graph_of(room(seed, nodes=3 + seed % 9)) for seed in range(30)]
    table = HeldGraphs(graphs)
    expected = np.concatenate([defined_histograms(graph, table.vocabulary) for graph in graphs])
    np.testing.assert_allclose(histograms(table), expected, atol=1e-12)
    query = graph_of(room(7, labels=(*LABELS, "stranger")))
    nodes = GraphNodes.of(query, table.vocabulary)
    expected = defined_histograms(query, table.vocabulary).reshape(len(query), 5, -1)
    for labels in (np.arange(len(table.labels)), np.array([3, 0])):
        columns = ring_hop_histograms(nodes, query.adjacency[None], labels, (1.0, 2.0, 4.0), 2)
        np.testing.assert_allclose(columns, expected[..., labels].reshape(len(query), -1), atol=1e-12)


def test_products_of_features_are_those_of_matrices():
    rng = np.random.default_rng(2)
    query, features = rng.uniform(size=(4, 30)), random_array((9, 30), density=0.2, random_state=3, format="csr")
    i, row = rng.integers(0, 4, 40), rng.integers(0, 9, 40)
    expected = (query @ features.T.toarray())[i, row]
    np.testing.assert_allclose(feature_products(query, features, i, row), expected, atol=1e-12)


def test_graphs_on_disk_match_alike_whether_features_are_kept_or_not(rooms, tmp_path, monkeypatch):
    graphs = [graph_of(room(seed, nodes=3 + seed % 9)) for seed in range(30)]
    write_graphs(graphs, tmp_path / "graphs")
    table, query = MappedGraphs(read_columns(tmp_path / "graphs")), graph_of(rooms[7], pose_2d(0.3, -0.2, 1.0))
    one = matcher()
    kept, scores = one.index(table), []
    monkeypatch.setattr(node_matcher, "MAX_PRECOMPUTED", 10)
    anew = one.index(table)
    assert kept.structure is not None
    assert anew.structure is None
    for index in (kept, anew):
        scores.append([match.score for match in one.match(query, index, 30)])
    assert scores[0] == pytest.approx(scores[1], abs=1e-12)


@pytest.mark.parametrize("edges_m", [[2.0, 1.0], [0.0, 1.0], [1.0, 1.0]])
def test_rings_that_do_not_widen_are_refused(edges_m):
    with pytest.raises(ConfigError, match=r"ring_edges_m.*expected edges above 0, each above the one before"):
        validate(GeometricMatcher.Config, {"kind": "geometric", "ring_edges_m": edges_m}, "matcher")
