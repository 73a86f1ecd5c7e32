"""What is compiled against the same in numpy, on rooms drawn at random. The data sets: tests/benchmarks."""

import numpy as np
import pytest
from salframe_graphs import compilation, features, triplet
from salframe_graphs.places import search
from salframe_graphs.places.likelihood import Poses
from salframe_graphs.places.merging import Place
from salframe_graphs.places.outline import BINS, MapOutlines
from salframe_graphs.places.place_index import index_places, lay_out_query
from salframe_graphs.places.rates import Likelihood, shipped_rates
from salframe_graphs.triplet import TripletMatcher

from salframe.framework.columns import read_columns
from salframe.graphs.detections import Detections
from salframe.graphs.graph import GraphConfig, SaliencyGraph, build_graph
from salframe.graphs.matcher import GraphMatcher
from salframe.graphs.table import HeldGraphs, MappedGraphs, write_graphs
from salframe.panoramas.geometry import invert_pose, pose_2d, poses_2d, transform_points

pytest.importorskip("numba")
LABELS = np.array(["chair", "chair", "chair", "table", "lamp", "bed", "desk", "plant", "vase"])
RATES, LIKELIHOOD = shipped_rates(), Likelihood()
ROOMS = 24


def room(rng, objects):
    """Labels, centroids and sizes; chairs are many, so that pairs and hypotheses are more than are looked at."""
    centroid_m = np.column_stack([rng.uniform(-3, 3, (objects, 2)), rng.uniform(-1, 1, objects)])
    return rng.choice(LABELS, objects), centroid_m, rng.uniform(0.3, 1.5, (objects, 3))


def seen(rng, labels, centroid_m, size_m, T):
    """The graph of most of a room's objects from a pose, with errors, and of one that the map lacks."""
    found = rng.random(len(labels)) < 0.8
    moved = transform_points(invert_pose(T), centroid_m[found]) + rng.normal(0, 0.05, (found.sum(), 3))
    objects = Detections(
        [*labels[found].tolist(), "harp"],
        rng.uniform(0.4, 1, found.sum() + 1),
        np.vstack([moved, [1.0, 2.0, 0.0]]),
        np.vstack([size_m[found] * rng.uniform(0.9, 1.1, (found.sum(), 3)), np.ones(3)]),
        np.zeros(found.sum() + 1),
    )
    volume = objects.size_m.prod(1)
    return build_graph(objects, volume / volume.sum(), GraphConfig())


@pytest.fixture(scope="module")
def rooms():
    rng = np.random.default_rng(3)
    return [room(rng, int(rng.integers(1, 40))) for _ in range(ROOMS)]


@pytest.fixture(scope="module")
def queries(rooms) -> list[SaliencyGraph]:
    rng = np.random.default_rng(4)
    poses = [pose_2d(*rng.uniform(-1, 1, 2), rng.uniform(0, 6)) for _ in rooms]
    return [seen(rng, *one, T) for one, T in zip(rooms, poses, strict=True)]


@pytest.fixture(scope="module")
def places(rooms):
    """The index of rooms 1 km apart."""
    rng = np.random.default_rng(5)
    made, cameras = [], []
    for k, (labels, centroid_m, size_m) in enumerate(rooms):
        n, away = len(labels), [1000.0 * k, -500.0 * k, 0]
        variance, sightings = rng.uniform(0.001, 0.05, n), rng.integers(1, 4, n).astype(float)
        saliency = rng.normal(0, 1, n)
        made.append(
            Place(str(k), (k,), tuple(labels), centroid_m + away, variance, np.log(size_m), saliency, sightings)
        )
        cameras.append(np.array([away, [away[0] + 1, away[1], 0]]))
    return index_places(made, cameras, RATES, LIKELIHOOD)


def test_the_same_poses_scores_and_shares(places, queries):
    compiled = compilation.compiled("salframe_graphs.places.compiled")
    every = np.delete(np.arange(ROOMS), 7)
    posed = 0
    for query in queries:
        asked = lay_out_query(query, places)
        plain, fast = (one.search(asked, places, every, RATES, LIKELIHOOD, 3) for one in (search, compiled))
        np.testing.assert_array_equal(fast.poses.place, plain.poses.place)
        np.testing.assert_allclose(fast.poses.shift_m, plain.poses.shift_m, atol=1e-6)
        np.testing.assert_allclose(np.sin(fast.poses.yaw_rad - plain.poses.yaw_rad), 0, atol=1e-6)
        np.testing.assert_allclose(fast.score, plain.score, atol=1e-4)
        for row, place in enumerate(plain.poses.place):
            objects = places.size[every[place]]
            np.testing.assert_allclose(fast.share(row), plain.share(row)[:, :objects], atol=1e-5)
            assert (plain.share(row)[:, objects:] == 0).all()
        np.testing.assert_allclose(fast.unplaced, plain.unplaced, atol=1e-4)
        posed += len(plain.poses)
    assert posed > 5 * ROOMS


def test_the_same_pose_settled(places, queries):
    compiled = compilation.compiled("salframe_graphs.places.compiled")
    for k, query in enumerate(queries):
        asked = lay_out_query(query, places)
        found = search.search(asked, places, np.array([k]), RATES, LIKELIHOOD, 3)
        for row in range(len(found.poses)):
            pose = Poses(np.array([k]), found.poses.shift_m[[row]], found.poses.yaw_rad[[row]])
            (plain, covariance), (fast, again) = (
                one.settle(asked, places, RATES, pose, found.share(row), 0.02) for one in (search, compiled)
            )
            np.testing.assert_allclose(fast.shift_m, plain.shift_m, atol=1e-9)
            np.testing.assert_allclose(fast.yaw_rad, plain.yaw_rad, atol=1e-9)
            np.testing.assert_allclose(again, covariance, rtol=1e-6)


def test_the_same_evidence_of_labels(places, queries):
    compiled = compilation.compiled("salframe_graphs.places.compiled")
    some = np.array([3, 0, 17, 3, 23])
    for query in queries:
        label = lay_out_query(query, places).label
        plain, fast = (one.label_evidence(label, places, some) for one in (search, compiled))
        np.testing.assert_allclose(fast, plain, atol=1e-12)
        assert (plain > 0).any()


def test_the_same_agreement():
    """Some of them without a pose, some with the same."""
    compiled, rng = compilation.compiled("salframe_graphs.places.compiled"), np.random.default_rng(11)
    for _ in range(20):
        poses = poses_2d(rng.uniform(-1, 1, (12, 2)), rng.uniform(-0.6, 0.6, 12))
        poses[2], poses[7:9] = poses[3], np.nan
        score = rng.uniform(0, 2, 12)
        plain, fast = (one.agreed(score, poses, 0.5, 1.5) for one in (search, compiled))
        np.testing.assert_allclose(fast, plain, atol=1e-12)
        assert plain[2] > score[2]
        np.testing.assert_array_equal(plain[7:9], score[7:9])


@pytest.mark.parametrize("labels", ["set", "multiset"])
def test_the_same_jaccard_index(rooms, queries, labels):
    matcher = TripletMatcher(TripletMatcher.Config.model_validate({"labels": labels}))
    index = matcher.index([seen(np.random.default_rng(12), *one, np.eye(4)) for one in rooms[::2]])
    every = np.arange(len(index.graphs))
    for query in queries:
        known = np.array([index.graphs.vocabulary.get(label, -1) for label in query.labels])
        rarity = np.where(known >= 0, index.rarity[known], 3.0)
        fast = compilation.compiled("salframe_graphs.compiled").jaccard(
            *matcher._asked_labels(query.labels, known, rarity),
            index.graphs.sizes,
            index.graphs.take_labels(every),
            index.rarity,
            labels == "set",
        )
        plain = matcher._jaccard(query.labels, known, rarity, index, every)
        np.testing.assert_allclose(fast, plain, atol=1e-12)


def test_exponentials_and_logarithms_are_those_of_numpy():
    from salframe_graphs.places.compiled_functions import exp, log

    power = np.linspace(-86, 87, 20_001, dtype=np.float32)
    found = np.array([exp(x) for x in power], np.float64)
    np.testing.assert_allclose(found, np.exp(power.astype(np.float64)), rtol=3e-7)
    number = np.concatenate([np.exp(power), np.linspace(0.5, 2, 20_001, dtype=np.float32)])
    found = np.array([log(x) for x in number], np.float64)
    np.testing.assert_allclose(found, np.log(number.astype(np.float64)), rtol=2e-7, atol=1e-7)


def test_the_same_ratio_of_outlines():
    compiled = compilation.compiled("salframe_graphs.places.compiled")
    rng = np.random.default_rng(6)
    range_m = rng.uniform(1, 4, (ROOMS, 3, BINS))
    range_m[rng.random(range_m.shape) < 0.1] = np.nan
    range_m[:5, 1:], range_m[5] = np.nan, np.nan
    pose = rng.uniform(-3, 3, (ROOMS, 3, 3))
    outlines, place = MapOutlines.of(range_m, pose), rng.integers(0, ROOMS, 60)
    shift_m, yaw_rad = rng.uniform(-1, 1, (60, 2)), rng.uniform(-6, 6, 60)
    plain, fast = (one.outline_ratio(outlines, range_m[9, 0], place, shift_m, yaw_rad) for one in (search, compiled))
    np.testing.assert_allclose(fast, plain, atol=1e-3)
    assert (plain[place == 5] == 0).all()


def test_the_same_histograms(rooms):
    rng = np.random.default_rng(9)
    table = HeldGraphs([seen(rng, *one, np.eye(4)) for one in rooms])
    some = np.array([5, 0, 17, 3])
    batch, nodes = table.batch(some), table.take(some)
    every, chair = np.arange(len(table.labels)), table.vocabulary["chair"]
    for part in (batch, nodes):
        part.label[part.label == chair] = -1  # as those of a query that the map lacks
    compiled = compilation.compiled("salframe_graphs.compiled_features")
    for edges_m, hops in (((1.0, 2.0, 4.0), 0), ((1.0, 2.0, 4.0), 2), ((), 2)):
        plain = features.ring_hop_histograms(batch, table.adjacency(some), len(every), edges_m, hops)
        rows = plain.unit(np.arange(plain.width))
        for asked in (every, np.array([-1, *every[:3]])):
            fast = compiled.ring_hop_histograms(nodes, table.take_edges(some), asked, len(every), edges_m, hops)
            counted = np.isin(nodes.label, asked[asked >= 0])
            np.testing.assert_array_equal(fast.unit(np.arange(fast.width)), rows * counted[:, None])


@pytest.mark.parametrize(
    "settings",
    [{}, {"saliency_weight": 0.5, "similarity_score": 0.0, "hops": 1, "confidence": False}, {"tolerance_m": 0.6}],
    ids=["as-set", "other-weights", "wide"],
)
@pytest.mark.parametrize("mapped", [False, True])
def test_the_same_matches(rooms, queries, monkeypatch, tmp_path, settings, mapped):
    """Of graphs in memory, and of many on disk, whose structural features are computed for each query."""
    rng = np.random.default_rng(8)
    graphs = [seen(rng, *one, np.eye(4)) for one in rooms]
    matcher = TripletMatcher(TripletMatcher.Config(most=ROOMS - 4, keep=0.1, **settings))
    monkeypatch.setattr(triplet, "_FEW", 10)
    write_graphs(graphs, tmp_path / "graphs")
    index = matcher.index(MappedGraphs(read_columns(tmp_path / "graphs")) if mapped else graphs)
    assert (index.structure is None) == mapped
    for query in queries:
        fast = matcher.match(query, index, 6)
        with monkeypatch.context() as plainly:
            plainly.setattr(compilation, "compiled", lambda module: None)
            plain = matcher.match(query, index, 6)
        assert [match.scene for match in fast] == [match.scene for match in plain]
        for ranked in (matcher.rank(query, index, 6), GraphMatcher.rank(matcher, query, index, 6)):
            assert ranked.scene.tolist() == [match.scene for match in fast]
            assert ranked.score.tolist() == [match.score for match in fast]
            poses = [np.full((4, 4), np.nan) if m.T_scene_query is None else m.T_scene_query for m in fast]
            np.testing.assert_array_equal(ranked.T_scene_query, np.array(poses).reshape(-1, 4, 4))
        for ours, theirs in zip(fast, plain, strict=True):
            assert ours.score == pytest.approx(theirs.score, abs=1e-6)
            np.testing.assert_array_equal(ours.pairs, theirs.pairs)
            assert (ours.T_scene_query is None) == (theirs.T_scene_query is None)
            if theirs.T_scene_query is not None:
                np.testing.assert_allclose(ours.T_scene_query, theirs.T_scene_query, atol=1e-9)
