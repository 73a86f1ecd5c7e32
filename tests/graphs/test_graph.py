"""Boxes, saliency, graphs and their packed form."""

import dataclasses

import numpy as np
import pytest
from salframe_graphs.saliency import VolumetricSaliency, object_volumes_m3

from salframe.framework.errors import DataError, InvalidAnswer
from salframe.graphs.boxes import MIN_SIDE_M, detections_from_points, upright_box
from salframe.graphs.detections import Detections
from salframe.graphs.graph import GraphConfig, box_distances, build_graph
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays, pack_graph, unpack_graph


def box_points(centre, size, yaw=0.0, count=4000, seed=0):
    """Points of a solid box, its corners included."""
    rng = np.random.default_rng(seed)
    unit = np.concatenate(
        [rng.uniform(-0.5, 0.5, (count, 3)), np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, 8).T]
    )
    c, s = np.cos(yaw), np.sin(yaw)
    return ((unit * size) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + centre).astype(np.float32)


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.3, 2.9])
def test_upright_box_recovers_a_turned_box(yaw):
    size, found = upright_box(box_points([3, -1, 0.5], [2.0, 0.8, 1.1], yaw))
    np.testing.assert_allclose(size, [2.0, 0.8, 1.1], atol=1e-4)
    assert np.abs(np.sin(found - yaw)) < 1e-3


def test_flat_points_get_the_least_side():
    points = box_points([2, 0, 1], [1.0, 0.0, 0.6])
    assert upright_box(points)[0] == pytest.approx([1.0, MIN_SIDE_M, 0.6], abs=1e-4)


def test_volumes_against_closed_form():
    """A full box, a tetrahedron (1/6 of its box), a flat picture (the least side thick)."""
    tetrahedron = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32) + 4
    found = detections_from_points(
        ["a", "b", "c"],
        np.ones(3),
        [box_points([2, 1, 0], [1, 2, 0.5], 0.7), tetrahedron, box_points([2, 0, 1], [1.0, 0.0, 0.6])],
    )
    np.testing.assert_allclose(object_volumes_m3(found), [1.0, 1.0, 1.0 * MIN_SIDE_M * 0.6], rtol=1e-4)
    saliency = VolumetricSaliency().score(found)
    assert saliency.sum() == pytest.approx(1)
    assert saliency[0] == pytest.approx(saliency[1], rel=1e-3)


def detections(centroids, sizes, labels=None):
    n = len(centroids)
    labels = labels or [f"object-{i}" for i in range(n)]
    return Detections(labels, np.ones(n), np.array(centroids, float), np.array(sizes, float), np.zeros(n))


def test_edges_follow_equation_1():
    """Cubes of 1 m: surfaces 0.9 m apart are in context, 1.1 m apart are not; by centroids neither is."""
    found = detections([[0, 0, 0], [1.9, 0, 0], [0, 2.1, 0]], np.ones((3, 3)))
    graph = build_graph(found, np.array([0.5, 0.3, 0.2]), GraphConfig())
    assert graph.edges.tolist() == [[0, 1]]
    assert graph.weights == pytest.approx([np.sqrt(0.15)])
    assert len(build_graph(found, np.array([0.5, 0.3, 0.2]), GraphConfig(distance="centroid")).edges) == 0


def test_box_distance_is_euclidean_in_the_corner_and_over_height():
    found = detections([[0, 0, 0], [4, 5, 0], [0, 0, 3]], np.ones((3, 3)))
    assert box_distances(found, np.zeros(3, int), np.arange(3)) == pytest.approx([0, 5, 2])


def test_nodes_are_chosen_by_share_and_number():
    found = detections([[1, 0, 0], [2, 0, 0], [3, 0, 0], [np.nan, 0, 0]], np.ones((4, 3)))
    saliency = np.array([0.1, 0.5, 0.3, 0.1])
    assert build_graph(found, saliency, GraphConfig()).labels == ("object-1", "object-2", "object-0")
    assert build_graph(found, saliency, GraphConfig(min_share=0.2)).labels == ("object-1", "object-2")
    assert build_graph(found, saliency, GraphConfig(top_k=1)).labels == ("object-1",)


@pytest.mark.parametrize("score", [1.5, -0.1, np.nan])
def test_a_score_that_is_no_share_is_refused(score):
    with pytest.raises(InvalidAnswer, match=rf"Detections.scores contains {score}, expected numbers from 0 to 1"):
        Detections(("bed", "sofa"), np.array([0.5, score]), np.ones((2, 3)), np.ones((2, 3)), np.zeros(2))


def test_ranges_of_nodes():
    graph = build_graph(
        detections([[0, 2, 0], [0, 0, 3], [-1, 0, 1]], np.ones((3, 3))), np.array([0.5, 0.3, 0.2]), GraphConfig()
    )
    assert graph.range_m == pytest.approx([2, 3, np.sqrt(2)])


@pytest.fixture
def graph():
    rng = np.random.default_rng(4)
    centroid_m, size_m = rng.uniform(-3, 3, (9, 3)), rng.uniform(0.3, 2, (9, 3))
    found = Detections(list("abcabcabc"), rng.uniform(size=9), centroid_m, size_m, rng.uniform(0, np.pi, 9))
    return build_graph(found, np.full(9, 1 / 9), GraphConfig())


def test_packed_graph_is_small_and_read_back_to_the_millimetre(graph):
    packed = pack_graph(graph_to_arrays(graph))
    assert packed["nodes"].nbytes + packed["edges"].nbytes == 16 * 9 + 5
    back = graph_from_arrays(unpack_graph(packed))
    assert back.labels == graph.labels
    np.testing.assert_array_equal(back.edges, graph.edges)
    np.testing.assert_allclose(back.centroid_m, graph.centroid_m, atol=0.00051)
    np.testing.assert_allclose(back.size_m, graph.size_m, atol=0.00051)
    np.testing.assert_allclose(back.saliency, graph.saliency, atol=1e-5)
    np.testing.assert_allclose(back.scores, graph.scores, atol=0.5 / 255)
    assert np.abs(np.sin(back.yaw_rad - graph.yaw_rad)).max() <= np.sin(np.pi / 512)


def test_packing_again_changes_nothing(graph):
    once = pack_graph(graph_to_arrays(graph))
    again = pack_graph(unpack_graph(once))
    for name, array in once.items():
        np.testing.assert_array_equal(again[name], array)


def test_an_empty_graph_and_a_thin_box_are_packed():
    nothing = graph_to_arrays(build_graph(Detections.empty(), np.zeros(0), GraphConfig()))
    assert len(graph_from_arrays(unpack_graph(pack_graph(nothing)))) == 0
    thin = graph_to_arrays(build_graph(detections([[1, 0, 0]], [[2.0, 1e-5, 99.0]]), np.ones(1), GraphConfig()))
    assert unpack_graph(pack_graph(thin))["size_m"].tolist() == [[2.0, 0.001, 65.535]]  # its logarithm is taken


def test_packing_says_what_does_not_fit(graph):
    arrays = graph_to_arrays(graph)
    for reach_m in (33.0, np.nan):
        far = {**arrays, "centroid_m": np.full((9, 3), reach_m)}
        with pytest.raises(
            DataError, match=f"an object is {reach_m:.1f} m from the camera along one axis, expected at most 32.767 m"
        ):
            pack_graph(far)


def test_an_object_out_of_reach_is_left_out_and_counted():
    """64 m away, through a hole in the range: it costs itself, not the panorama."""
    far = np.array([[1.0, 0.0, 0.0], [64.0, 0.0, 0.0], [0.0, -32.0, 0.0]])
    seen = Detections(("bed", "sofa", "lamp"), np.ones(3), far, np.ones((3, 3)), np.zeros(3))
    graph = build_graph(seen, np.full(3, 1 / 3), GraphConfig())
    assert (sorted(graph.labels), graph.out_of_reach) == (["bed", "lamp"], 1)
    assert graph_from_arrays(graph_to_arrays(graph)).out_of_reach == 1
    assert len(pack_graph(graph_to_arrays(graph))["nodes"]) == 2


def test_deviations_of_triangulated_nodes_are_packed_to_the_millimetre(graph):
    deviation_m = np.linspace(0.0004, 0.8, 9)
    arrays = graph_to_arrays(dataclasses.replace(graph, variance_m2=deviation_m**2))
    packed = pack_graph(arrays)
    assert packed["deviation_mm"].dtype == np.uint16
    back = graph_from_arrays(unpack_graph(packed))
    np.testing.assert_allclose(np.sqrt(back.variance_m2), deviation_m, atol=0.0005)
    assert "deviation_mm" not in pack_graph(graph_to_arrays(graph))
    assert not graph_from_arrays(unpack_graph(pack_graph(graph_to_arrays(graph)))).variance_m2.any()


def test_a_deviation_beyond_65_m_is_limited(graph):
    arrays = graph_to_arrays(dataclasses.replace(graph, variance_m2=np.full(9, 100.0**2)))
    np.testing.assert_allclose(np.sqrt(unpack_graph(pack_graph(arrays))["variance_m2"]), 65.535)
