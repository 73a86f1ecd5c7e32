"""Measures of derived floors, on maps and labellings small enough to count by hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from salframe.panoramas.floors import FloorMasks
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap
from training.floors.measure import on_grid, region_agreement
from training.floors.measures import adjusted_rand_index, compare_topologies


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ([0, 0, 1, 1], [7, 7, 3, 3], 1.0),
        ([0, 0, 1, 1], [0, 0, 1, 2], 4 / 7),
        ([0, 0, 1, 1], [0, 1, 0, 1], -0.5),
        ([0, 0, 0, 0], [0, 1, 2, 3], 0.0),
    ],
)
def test_adjusted_rand_index_of_four_items(first, second, expected):
    # Pairs that are together in both labellings: 2, 1, 0, 0. By chance: the product of the pairs of each, over 6.
    assert adjusted_rand_index(np.array(first), np.array(second)) == pytest.approx(expected)


def scene(id: str, x_m: float) -> MapNode:
    return MapNode(id, NodeKind.SCENE, (x_m, 0.0, 0.0), (id.split("-")[0],))


def door(id: str, x_m: float, *regions: str) -> MapNode:
    return MapNode(id, NodeKind.TRANSITION, (x_m, 0.0, 0.0), regions)


def line(*nodes: MapNode, cut: str = "", longer: float = 1.0) -> TopologicalMap:
    """Return a map of nodes in a row. No edge leads to the node `cut`; all edges are longer by a factor."""
    nodes = tuple(sorted(nodes, key=lambda node: node.xyz_m))
    edges = [
        MapEdge(a.id, b.id, longer * (b.xyz_m[0] - a.xyz_m[0]), 0.0)
        for a, b in pairwise(nodes)
        if cut not in (a.id, b.id)
    ]
    return TopologicalMap(nodes, tuple(edges))


def row_of_rooms(shift_m: float = 0.0) -> tuple[MapNode, ...]:
    """Return three rooms 4 m apart with doorways between them, the second one moved by `shift_m`."""
    return (
        scene("a", 0.0),
        door("a/b", 2.0, "a", "b"),
        scene("b", 4.0),
        door("b/c", 6.0 + shift_m, "b", "c"),
        scene("c", 8.0),
    )


def test_doorways_are_common_up_to_their_maximum_distance():
    masks = line(*row_of_rooms())
    for shift_m, common in ((0.7, 2), (0.8, 1)):
        compared = compare_topologies(masks, line(*row_of_rooms(shift_m)))
        assert (compared.mask_doorways, compared.derived_doorways, compared.common_doorways) == (2, 2, common)


def test_a_doorway_between_other_regions_is_not_common_and_counts_once():
    nodes = list(row_of_rooms())
    nodes[3] = door("a/c", 6.0, "a", "c")
    compared = compare_topologies(line(*row_of_rooms()), line(*nodes, door("b/a", 2.1, "b", "a")))
    assert (compared.mask_doorways, compared.derived_doorways, compared.common_doorways) == (2, 3, 1)


def test_route_errors_are_relative_and_lost_routes_are_counted():
    masks = line(*row_of_rooms())
    longer = compare_topologies(masks, line(*row_of_rooms(), longer=1.25))
    np.testing.assert_allclose(longer.route_errors, [0.25, 0.25, 0.25])  # a to b, a to c, b to c
    assert (longer.lost_routes, longer.false_routes) == (0, 0)
    cut = compare_topologies(masks, line(*row_of_rooms(), cut="b/c"))
    assert (len(cut.route_errors), cut.lost_routes, cut.false_routes) == (1, 2, 0)
    back = compare_topologies(line(*row_of_rooms(), cut="b/c"), masks)
    assert (len(back.route_errors), back.lost_routes, back.false_routes) == (1, 0, 2)


def test_routes_shorter_than_a_metre_are_not_compared():
    near = line(scene("a-0", 0.0), scene("a-1", 0.9), scene("a-2", 2.0))
    assert len(compare_topologies(near, near).route_errors) == 2


def masks(region: np.ndarray, origin_m: tuple[float, float]) -> FloorMasks:
    region = region.astype(np.int32)
    return FloorMasks(region > 0, region, np.zeros(region.shape, bool), 0.5, origin_m, {1: "a", 2: "b"}, 0.0)


def test_a_floor_on_the_pixels_of_another_one():
    # One row: the floor starts two pixels to the left and ends one pixel before the right edge.
    moved = on_grid(masks(np.array([[1, 1, 2, 2, 2]]), (-1.0, 0.5)), masks(np.zeros((2, 4)), (0.0, 0.5)))
    assert moved.region.tolist() == [[2, 2, 2, 0], [0, 0, 0, 0]]
    assert moved.origin_m == (0.0, 0.5)


def test_the_agreement_of_regions_uses_the_pixels_of_both_floors():
    exact = masks(np.array([[1, 1, 2, 2, 0]]), (0.0, 0.5))
    derived = masks(np.array([[2, 2, 2, 1, 0, 2]]), (-0.5, 0.5))  # on the pixels of `exact`: 2, 2, 1, 0, 2
    assert region_agreement(exact, derived) == pytest.approx(1.0)
    # Labels 1, 1, 2, 2 and 1, 1, 1, 2: one pair is together in both, as expected by chance (2 x 3 of 6 pairs).
    shifted = masks(np.array([[1, 1, 1, 2, 2]]), (0.0, 0.5))
    assert region_agreement(exact, shifted) == pytest.approx(0.0)
