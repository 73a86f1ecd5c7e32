"""An agent's knowledge: straight walks, paths along the map, and obstacles from collisions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from salframe_planners.planners import Dijkstra

from salframe.framework.errors import NoRoute
from salframe.navigation.chart import BUMP_AHEAD_M, BUMP_M
from salframe.navigation.guide import Guide, straighten
from salframe.panoramas.geometry import pose_2d
from salframe.topology.topological_map import MapEdge, MapNode, TopologicalMap

A_WEST, B = np.array([1.0, 2.0, 1.5]), np.array([[7.0, 2.0, 0.0]])


def guide(chart) -> Guide:
    return Guide(chart, Dijkstra.Config())


def test_reach_is_the_straight_distance_where_no_wall_is_between(world):
    points = np.array([[7.0, 2.0, 0.0], [3.0, 0.5, 0.0], [7.0, 0.5, 0.0]])
    np.testing.assert_allclose(world.chart.reach(A_WEST, points), [6.0, 2.5, np.inf])


def test_a_position_in_a_wall_sees_what_its_nearest_floor_does(world):
    straight_m = world.chart.reach(np.array([-0.2, 2.0, 1.5]), B)
    np.testing.assert_allclose(straight_m, [7.2])


def test_ways_lead_straight_or_through_the_door(world):
    path = guide(world.chart).shortest_path(A_WEST, "b")
    assert path.length_m == pytest.approx(6.0)
    path = guide(world.chart).shortest_path(np.array([3.0, 3.5, 1.5]), "b")
    door = np.array([4.1, 2.0])
    assert path.length_m == pytest.approx(np.hypot(1.1, 1.5) + 2.9, abs=0.1)
    np.testing.assert_allclose(path.corners_m[-2:, :2], [door, [7.0, 2.0]], atol=0.06)


def test_no_way_is_an_error(world):
    with pytest.raises(NoRoute, match=r"no path leads from \(1.00, 2.00\) m to attic"):
        guide(world.chart).shortest_path(A_WEST, "attic")


def test_a_roomy_chart_keeps_its_distance(world):
    point = np.array([[3.0, 0.2, 0.0]])
    beside_the_wall = np.array([1.0, 0.2, 1.5])
    assert np.isfinite(world.chart.reach(beside_the_wall, point)).all()
    assert np.isinf(world.chart.with_margin().reach(beside_the_wall, point)).all()


def test_a_bump_in_the_open_is_walked_around(world):
    stopped_at = pose_2d(2.0, 2.0, 0.0, 1.5)
    chart = world.chart.after_collision(stopped_at, again=False)
    assert chart is not world.chart
    centre = np.array([2.0 + BUMP_AHEAD_M, 2.0])
    path = guide(chart).shortest_path(np.array([2.0, 2.0, 1.5]), "b")
    line = np.vstack([[2.0, 2.0], path.corners_m[:, :2]])
    walked = np.concatenate([a + (b - a) * np.linspace(0, 1, 200)[:, None] for a, b in pairwise(line)])
    assert np.linalg.norm(walked - centre, axis=1).min() > BUMP_M - 0.06
    assert path.length_m == pytest.approx(
        np.hypot(1.0, 1.5) + np.hypot(1.1, 1.5) + 2.9, abs=0.1
    )  # via a-north, which is still visible from (2, 2)
    assert guide(world.chart).shortest_path(np.array([2.0, 2.0, 1.5]), "b").length_m == pytest.approx(5.0)


def test_a_bump_beside_a_known_wall_tells_nothing(world):
    assert world.chart.after_collision(pose_2d(3.75, 1.0, 0.0, 1.5), again=False) is world.chart
    assert world.chart.after_collision(pose_2d(30.0, 1.0, 0.0, 1.5), again=True) is world.chart


def test_a_second_bump_there_does(world):
    point = np.array([[3.75, 1.5, 0.0]])
    here = np.array([3.75, 0.6, 1.5])
    np.testing.assert_allclose(world.chart.reach(here, point), [0.9])
    assert np.isinf(
        world.chart.after_collision(pose_2d(3.75, 0.8, np.pi / 2, 1.5), again=True).reach(here, point)
    ).all()


def test_an_edge_is_joined_at_its_corners():
    nodes = (MapNode("a", "scene", (0.0, 0.0, 0.0), ("r",)), MapNode("b", "scene", (4.0, 3.0, 0.0), ("r",)))
    bent = MapEdge("a", "b", 7.0, float(np.arctan2(3, 4)), ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)))
    straight = straighten(TopologicalMap(nodes, (bent,)))
    assert [node.xyz_m for node in straight.nodes] == [(0.0, 0.0, 0.0), (4.0, 3.0, 0.0), (4.0, 0.0, 0.0)]
    assert [(edge.length_m, edge.azimuth_rad) for edge in straight.edges] == [
        (4.0, 0.0),
        (3.0, pytest.approx(np.pi / 2)),
    ]
