"""Pixels, clearance, labels and lines of sight, compared with shapely and networkx."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
import shapely
from plans import RESOLUTION_M, block, two_rooms

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks
from salframe.topology.edges import components, joining_paths, sight_pairs
from salframe.topology.grid import FloorGrid, cell, has_line_of_sight, nearest_pixel, pixel_graph


def test_pixels_and_metres_are_laid_out_as_floor_masks_say():
    floor = two_rooms()
    grid = FloorGrid(floor, 0.18)
    left, top = floor.origin_m
    np.testing.assert_allclose(grid.to_metres(np.array([0.0, 0.0])), (left, top))
    np.testing.assert_allclose(
        grid.to_metres(np.array([4.0, 10.0])), (left + 10 * RESOLUTION_M, top - 4 * RESOLUTION_M)
    )
    points = np.random.default_rng(0).uniform(-2, 2, (20, 2))
    np.testing.assert_allclose(grid.to_metres(grid.to_pixel(points)), points, atol=1e-12)
    assert grid.inside(grid.to_pixel(np.array([0.0, 0.0])))
    assert not grid.inside(np.array([-0.1, 3.0]))


@pytest.mark.parametrize(("door_m", "lane"), [(0.3, 0), (0.4, 0), (0.5, 2), (0.9, 10)])
def test_clear_floor_keeps_the_robot_off_the_walls(door_m, lane):
    """A robot of 0.18 m passes where the centre of a pixel is 0.18 m from both jambs: in lanes of door - 0.36 m,
    rounded down to pixels."""
    grid = FloorGrid(two_rooms(door_m), 0.18)
    _, column = cell(grid.to_pixel(np.array([0.0, 0.0])))
    assert grid.clear[:, column].sum() == lane
    rows = np.nonzero(grid.walkable[:, column])[0]
    centres = [row for row in rows if min(row + 0.5 - rows.min(), rows.max() + 0.5 - row) * RESOLUTION_M >= 0.18 - 1e-9]
    assert np.nonzero(grid.clear[:, column])[0].tolist() == centres


@pytest.mark.parametrize("wall_m", [0.1, 0.3, 0.8])
def test_labels_grow_to_the_middle_of_the_threshold(wall_m):
    grid = FloorGrid(two_rooms(wall_m=wall_m), 0.18)
    row, column = cell(grid.to_pixel(np.array([0.0, 0.0])))
    reach = round(wall_m / RESOLUTION_M / 2)
    assert (grid.label[row, column - reach : column] == 1).all()
    assert (grid.label[row, column : column + reach] == 2).all()


def test_labels_do_not_grow_through_walls():
    """The threshold lies beside a third room, behind a thin wall, whose floor is nearer than the floor of the two rooms
    that it connects."""
    region = np.zeros((13, 20), np.int32)
    region[1:12, 1:4], region[1:12, 16:19], region[1:5, 5:15] = 1, 2, 3
    free = region > 0
    free[6:8, 4:16] = True
    grid = FloorGrid(FloorMasks(free, region, np.zeros_like(free), 0.1, (0.0, 0.0), {}), 0.0)
    assert set(grid.label[6:8, 4:16].ravel()) == {1, 2}
    assert (grid.label[6:8, 4:10] == 1).all()
    assert grid.names == {1: "region-1", 2: "region-2", 3: "region-3"}


@pytest.mark.parametrize("seed", range(3))
def test_sight_is_stopped_by_every_pixel_the_line_crosses(seed):
    rng = np.random.default_rng(seed)
    clear = rng.random((17, 23)) > 0.06
    start, end = (rng.uniform((0, 0), clear.shape, (400, 2)) for _ in range(2))
    boxes = [shapely.box(column, row, column + 1, row + 1) for row, column in np.argwhere(~clear)]
    blocked = shapely.union_all(boxes)
    lines = shapely.linestrings(np.stack([start[:, ::-1], end[:, ::-1]], 1))
    expected = ~shapely.intersects(lines, blocked)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(has_line_of_sight(clear, start, end), expected)
    np.testing.assert_array_equal(has_line_of_sight(clear, end, start), expected)


def test_sight_does_not_slip_between_two_corners():
    clear = np.array([[True, False], [False, True]])
    assert not has_line_of_sight(clear, np.array([[0.5, 0.5]]), np.array([[1.5, 1.5]])).any()
    assert has_line_of_sight(np.ones((1, 1), bool), np.array([[0.5, 0.5]]), np.array([[0.5, 0.5]])).all()


def test_the_nearest_pixel_is_the_position_itself_where_that_is_allowed():
    allowed = np.zeros((5, 6), bool)
    assert nearest_pixel(allowed, np.array([2.2, 3.3])) is None
    allowed[4, 5] = allowed[0, 0] = True
    assert nearest_pixel(allowed, np.array([2.9, 3.3])).tolist() == [4.5, 5.5]
    assert nearest_pixel(allowed, np.array([0.9, 0.3])).tolist() == [0.9, 0.3]


def walk_graph(clear: np.ndarray) -> nx.Graph:
    """The graph of steps between clear pixels, built step by step."""
    graph = nx.Graph()
    for row, column in np.argwhere(clear):
        graph.add_node((row, column))
        for step, length in (((0, 1), 1.0), ((1, 0), 1.0), ((1, 1), 2**0.5), ((1, -1), 2**0.5)):
            beside = [(row + step[0], column), (row, column + step[1]), (row + step[0], column + step[1])]
            if all(0 <= r < clear.shape[0] and 0 <= c < clear.shape[1] and clear[r, c] for r, c in beside):
                graph.add_edge((row, column), beside[2], length=length)
    return graph


def test_steps_between_pixels_cut_no_corner():
    clear = np.random.default_rng(1).random((9, 11)) > 0.3
    expected = walk_graph(clear)
    number = {tuple(pixel): i for i, pixel in enumerate(np.argwhere(clear).tolist())}
    made = pixel_graph(clear).tocoo()
    assert made.nnz == 2 * expected.number_of_edges()
    steps = {(int(i), int(j)): length for i, j, length in zip(made.row, made.col, made.data, strict=True)}
    for a, b, data in expected.edges(data=True):
        assert steps[number[a], number[b]] == steps[number[b], number[a]] == pytest.approx(data["length"])


def test_what_sight_leaves_apart_is_joined_by_the_shortest_ways():
    """A maze of walls. The paths are those of the minimum spanning tree of shortest walks between the parts that see
    each other."""
    clear = np.ones((40, 60), bool)
    clear[:32, 14:17] = clear[8:, 30:33] = clear[:30, 45:48] = False
    floor = FloorMasks(clear, np.ones(clear.shape, np.int32), np.zeros_like(clear), 0.1, (0.0, 4.0), {1: "hall"})
    grid = FloorGrid(floor, 0.0)
    nodes = np.array([[5.5, 3.5], [9.5, 8.5], [20.5, 22.5], [35.5, 37.5], [6.5, 54.5]])
    pairs = sight_pairs(grid, nodes)
    part = components(len(nodes), pairs)
    assert len(set(part)) == 4
    paths = joining_paths(grid, nodes, part)
    graph = walk_graph(clear)
    between = nx.Graph()
    for i in range(len(nodes)):
        lengths = nx.single_source_dijkstra_path_length(graph, cell(nodes[i]), weight="length")
        for j in range(i):
            length = lengths[cell(nodes[j])]
            if part[i] != part[j] and length < between.get_edge_data(part[i], part[j], {"length": np.inf})["length"]:
                between.add_edge(part[i], part[j], length=length, nodes={i, j})
    tree = {
        frozenset(data["nodes"]): data["length"] for _, _, data in nx.minimum_spanning_edges(between, weight="length")
    }
    assert {frozenset((i, j)) for i, j, _ in paths} == set(tree)
    for i, j, corners in paths:
        np.testing.assert_array_equal(corners[[0, -1]], nodes[[i, j]])
        assert has_line_of_sight(clear, corners[:-1], corners[1:]).all()
        length = np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()
        assert np.linalg.norm(nodes[i] - nodes[j]) < length <= tree[frozenset((i, j))] + 1e-9
        assert len(corners) > 2
    assert len(set(components(len(nodes), np.vstack([pairs, [(i, j) for i, j, _ in paths]])))) == 1


def test_parts_that_no_clear_floor_joins_stay_apart():
    grid = FloorGrid(block(two_rooms(), (-0.1, -1.0), (0.1, 1.0)), 0.18)
    nodes = grid.to_pixel(np.array([[-2.0, 0.0], [2.0, 0.0]]))
    assert joining_paths(grid, nodes, components(2, sight_pairs(grid, nodes))) == []


def test_masks_of_different_sizes_are_refused():
    free = np.ones((4, 6), bool)
    with pytest.raises(
        DataError,
        match=r"the region mask of the floor with z_m = 0.0 is 7 x 4 pixels, expected 6 x 4, the size of the free",
    ):
        FloorMasks(free, np.zeros((4, 7), np.int32), free, 0.05, (0, 0), {})
    with pytest.raises(
        DataError, match=r"the obstacle mask of the floor with z_m = 0.0 is 6 x 5 pixels, expected 6 x 4"
    ):
        FloorMasks(free, np.zeros((4, 6), np.int32), np.zeros((5, 6), bool), 0.05, (0, 0), {})
    with pytest.raises(
        DataError, match="resolution_m = 0, expected the metres per pixel of its masks, a finite number above 0"
    ):
        FloorMasks(free, np.zeros((4, 6), np.int32), free, 0, (0, 0), {})
