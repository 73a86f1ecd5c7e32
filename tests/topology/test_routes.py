"""Routes and turns in a plan with known geometry."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from plans import block, frame, two_rooms

from salframe.framework.errors import DataError, NoRoute, UnknownName
from salframe.topology.build import build_topology
from salframe.topology.planner import Route
from salframe.topology.routes import directions, find_nodes, find_route, route_json, with_position
from salframe.topology.topological_map import MapEdge


def leg(start: str, end: str, length_m: float, azimuth_deg: float, path_m=()) -> MapEdge:
    return MapEdge(start, end, length_m, float(np.radians(azimuth_deg)), path_m)


def test_turns_are_relative_to_the_heading_and_then_to_the_leg_before():
    route = Route(
        ("a", "b", "c", "d"), (leg("a", "b", 2.0, 90), leg("b", "c", 1.0, -170), leg("c", "d", 3.0, -170)), 6.0
    )
    turns_deg = [float(np.degrees(step.turn_rad)) for step in directions(route, np.radians(125.0))]
    assert turns_deg == pytest.approx([-35, 100, 0])
    assert [str(step) for step in directions(route, np.radians(125.0))] == [
        "turn right 35 deg, walk 2.0 m to b",
        "turn left 100 deg, walk 1.0 m to c",
        "straight on, walk 3.0 m to d",
    ]
    unknown = directions(route)
    assert unknown[0].turn_rad is None
    assert str(unknown[0]) == "face 90 deg, walk 2.0 m to b"
    assert np.degrees(unknown[1].turn_rad) == pytest.approx(100)


@pytest.mark.parametrize(
    ("heading_deg", "azimuth_deg", "turn_deg"),
    [(170, -170, 20), (-170, 170, -20), (0, 180, 180), (-90, 90, 180), (540, 0, 180)],
)
def test_turns_go_the_short_way_round(heading_deg, azimuth_deg, turn_deg):
    (step,) = directions(Route(("a", "b"), (leg("a", "b", 1.0, azimuth_deg),), 1.0), np.radians(heading_deg))
    assert np.degrees(step.turn_rad) == pytest.approx(turn_deg)


def test_a_bent_leg_is_walked_corner_by_corner():
    path_m = ((0.0, 0.0), (0.0, 2.0), (-3.0, 2.0))
    steps = directions(Route(("a", "b"), (leg("a", "b", 5.0, 146.3, path_m),), 5.0), 0.0)
    assert [(s.to, s.length_m, round(float(np.degrees(s.turn_rad)), 6)) for s in steps] == [
        (None, 2.0, 90.0),
        ("b", 3.0, 90.0),
    ]
    assert str(steps[0]) == "turn left 90 deg, walk 2.0 m to the corner"
    back = directions(Route(("b", "a"), (leg("a", "b", 5.0, 146.3, path_m).reversed(),), 5.0), 0.0)
    assert [(s.to, s.length_m, round(float(np.degrees(s.turn_rad)), 6)) for s in back] == [
        (None, 3.0, 0.0),
        ("a", 2.0, -90.0),
    ]


@pytest.fixture(scope="module")
def flat():
    """Two scene nodes in the west, one in the east, furniture that hides one of the west from the door."""
    floor = block(two_rooms(wall_m=0.2), (-1.6, -1.0), (-0.9, 1.0))
    frames = [frame("far", -2.5, 0.0), frame("corner", -0.5, -1.2), frame("b", 1.5, 0.3, "east")]
    return build_topology([floor], frames)


def test_a_place_stands_for_its_scene_nodes(flat):
    assert find_nodes(flat, "west") == ["far", "corner"]
    assert find_nodes(flat, "west/east") == ["west/east"]
    with pytest.raises(UnknownName, match="unknown node or place 'wets', did you mean 'west'"):
        find_nodes(flat, "wets")


def test_a_place_without_scene_nodes_stands_for_its_doors():
    assert find_nodes(build_topology([two_rooms()], [frame("a", -2.0, 0.0)]), "east") == ["west/east"]


@pytest.mark.parametrize("planner", ["dijkstra", "floyd-warshall"])
def test_the_route_to_a_place_ends_at_its_nearest_node(flat, planner):
    route = find_route(flat, "b", "west", planner)
    assert route.nodes[-1] == "corner"
    graph = nx.Graph()
    graph.add_weighted_edges_from((e.start, e.end, e.length_m) for e in flat.edges)
    assert route.length_m == pytest.approx(nx.dijkstra_path_length(graph, "b", "corner"), abs=1e-9)
    with pytest.raises(UnknownName, match="unknown planner 'dijkstr', did you mean 'dijkstra'"):
        find_route(flat, "b", "west", "dijkstr")


def test_a_place_whose_scene_nodes_are_shut_in_is_reached_at_its_door():
    floor = two_rooms(wall_m=0.2)
    for low, high in (
        ((1.0, -0.7), (1.1, 0.7)),
        ((2.0, -0.7), (2.1, 0.7)),
        ((1.0, 0.6), (2.1, 0.7)),
        ((1.0, -0.7), (2.1, -0.6)),
    ):
        floor = block(floor, low, high)
    topology = build_topology([floor], [frame("a", -2.0, 0.0), frame("shut", 1.5, 0.0, "east")])
    assert "the node shut cannot be reached: obstacles block every path to the node" in topology.notes
    assert find_route(topology, "a", "east").nodes == ("a", "west/east")
    with pytest.raises(NoRoute, match="no route from a to shut"):
        find_route(topology, "a", "shut")


def test_no_route_between_parts_that_nothing_joins():
    closed = build_topology([two_rooms(door_m=0.45)], [frame("a", -2.0, 0.0), frame("b", 1.5, 0.0, "east")])
    with pytest.raises(NoRoute, match="no route from a to east: the map has no path between them"):
        find_route(closed, "a", "east")
    assert [e.end for e in with_position(closed, np.array([-1.5, 0.0, 1.5])).edges] == ["a"]


def test_a_position_is_joined_to_the_nodes_it_sees(flat):
    at = with_position(flat, np.array([0.8, -0.4, 1.5]))
    assert at.nodes[-1].id == "here"
    assert at.nodes[-1].regions == ("east",)
    assert at.nodes[-1].xyz_m == pytest.approx((0.8, -0.4, 0.0))
    assert {e.end for e in at.edges if e.start == "here"} >= {"b", "west/east"}
    to_b = next(e for e in at.edges if e.start == "here" and e.end == "b")
    assert (to_b.length_m, to_b.azimuth_rad) == pytest.approx((np.hypot(0.7, 0.7), np.pi / 4))
    assert flat.nodes == at.nodes[:-1]


def test_a_position_in_a_wall_or_out_of_sight_still_finds_its_way(flat):
    inside = with_position(flat, np.array([-1.25, 0.0, 1.5]))
    x, y, _ = inside.nodes[-1].xyz_m
    assert max(abs(x + 1.25) - 0.35, abs(y) - 1.0) >= 0.18 - 1e-9
    floor = block(block(two_rooms(wall_m=0.2), (-1.6, -1.0), (-0.9, 1.5)), (-3.1, -1.0), (-1.6, -0.6))
    hidden = build_topology([floor], [frame("b", 1.5, 0.0, "east")])
    assert not any(e.path_m for e in hidden.edges)
    with pytest.raises(DataError, match="no node of the map can be reached from"):
        with_position(hidden, np.array([-2.5, 1.0, 1.5]))
    floor = block(two_rooms(wall_m=0.2), (-1.6, -1.0), (-0.9, 1.5))
    behind = with_position(build_topology([floor], [frame("b", 1.5, 0.0, "east")]), np.array([-2.5, 1.0, 1.5]))
    (way,) = [e for e in behind.edges if e.start == "here"]
    assert way.end == "west/east"
    assert len(way.path_m) > 2
    with pytest.raises(DataError, match=r"the position \(99.00, 0.00, 1.50\) m is not on a floor of the map"):
        with_position(flat, np.array([99.0, 0.0, 1.5]))


def test_a_route_between_two_positions():
    """From the west room through the doorway to the east room: two added nodes, the shortest path bends once."""
    flat = build_topology([two_rooms()], [frame("a", -1.8, 0.0), frame("b", 1.8, 0.0, "east")])
    start, goal = np.array([-1.5, 0.3, 1.5]), np.array([1.5, 0.3, 0.0])
    joined = with_position(with_position(flat, start), goal, "goal")
    route = find_route(joined, "here", "goal")
    assert (route.nodes[0], route.nodes[-1]) == ("here", "goal")
    content = route_json(route, heading_rad=np.pi / 2)
    assert content["length_m"] == route.length_m
    assert 3.0 <= route.length_m < 3.2
    assert sum(step["length_m"] for step in content["steps"]) == pytest.approx(route.length_m, abs=0.05)
    first = content["steps"][0]
    assert first["turn_deg"] == pytest.approx(first["azimuth_deg"] - 90)
    assert first["say"].startswith("turn right")
