"""Maps of hand-drawn plans with known nodes, lengths and azimuths, and of generated buildings."""

from __future__ import annotations

from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
from plans import RESOLUTION_M, block, frame, two_rooms
from salframe_house.building import generate_building
from salframe_house.frames import choose_frames
from scipy import ndimage

from salframe.framework.errors import DataError
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.topology.build import build_topology
from salframe.topology.grid import FloorGrid, cell
from salframe.topology.routes import HERE, with_position
from salframe.topology.topological_map import MapEdge, TopologicalMap, TopologySettings


def edge(topology: TopologicalMap, start: str, end: str) -> MapEdge:
    (edge,) = [e if e.start == start else e.reversed() for e in topology.edges if {e.start, e.end} == {start, end}]
    return edge


def house_frames(building) -> list[ReferenceFrame]:
    kinds = {"map": FrameKind.SCENE, "transition": FrameKind.TRANSITION}
    specs = choose_frames(building, building, 0, queries_per_room=1)
    return [
        ReferenceFrame(s.id, s.place, pose_2d(s.x_m, s.y_m, s.yaw_rad, s.z_m), kinds[s.role])
        for s in specs
        if s.role in kinds
    ]


def test_nodes_stand_where_frames_and_doors_are_and_edges_are_metric():
    frames = [frame("a", -2.0, 0.4), frame("b", 1.5, -0.2, "east"), frame("d", 0.1, 0.1, "door", FrameKind.TRANSITION)]
    topology = build_topology([two_rooms(door_m=0.9, wall_m=0.2)], frames)
    a, b, door = topology.nodes
    assert (a.id, a.kind, a.xyz_m, a.regions, a.frames) == (
        "a",
        "scene",
        pytest.approx((-2.0, 0.4, 0.0)),
        ("west",),
        ("a",),
    )
    assert (b.id, b.regions) == ("b", ("east",))
    assert (door.id, door.kind, door.regions, door.frames) == ("west/east", "transition", ("west", "east"), ("d",))
    assert np.abs(door.xyz_m[:2]).max() <= 0.75 * RESOLUTION_M
    assert {frozenset((e.start, e.end)) for e in topology.edges} == {
        frozenset(p) for p in (("a", "b"), ("a", "west/east"), ("b", "west/east"))
    }
    straight = edge(topology, "a", "b")
    assert straight.length_m == pytest.approx(np.hypot(3.5, 0.6))
    assert np.degrees(straight.azimuth_rad) == pytest.approx(np.degrees(np.arctan2(-0.6, 3.5)))
    assert np.degrees(edge(topology, "b", "a").azimuth_rad) == pytest.approx(180 - np.degrees(np.arctan2(0.6, 3.5)))
    assert topology.notes == ()


def test_frames_over_one_pixel_share_a_node():
    topology = build_topology(
        [two_rooms()], [frame("a", -2.01, 0.01), frame("again", -2.015, 0.012), frame("b", 1.5, 0.0, "east")]
    )
    assert [node.frames for node in topology.nodes if node.kind == "scene"] == [("a", "again"), ("b",)]


@pytest.mark.parametrize("frames", [[], [frame("a", -1.0, 1.0)]])
def test_chosen_scene_nodes_are_where_a_region_is_widest(frames):
    floor = block(two_rooms(wall_m=0.2), (-3.1, 0.5), (-0.1, 1.5))
    topology = build_topology([floor], frames, TopologySettings(choose=True))
    west, east = (node for node in topology.nodes if node.kind == "scene")
    assert (west.id, west.regions, west.frames) == ("west", ("west",), tuple(f.id for f in frames))
    assert east.xyz_m == pytest.approx((1.6, 0.0, 0.0), abs=2 * RESOLUTION_M)
    # 2 m x 3 m of the west room are free: any point of the middle line is 1 m from the walls and the furniture.
    assert west.xyz_m[1] == pytest.approx(-0.5, abs=2 * RESOLUTION_M)
    assert -2.1 - 2 * RESOLUTION_M <= west.xyz_m[0] <= -1.1 + 2 * RESOLUTION_M


def test_a_scene_point_in_a_wall_moves_to_clear_floor_of_its_room_or_is_left_out():
    frames = [frame("near", -3.12, 0.0), frame("across", 0.05, 1.0), frame("inside", 1.0, 0.0, "east")]
    topology = build_topology([block(two_rooms(wall_m=0.2), (0.5, -1.5), (1.5, 1.0))], frames)
    near, across = (node for node in topology.nodes if node.kind == "scene")
    # The first clear pixel: the wall's face is at -3.1 m, and its centre at least 0.18 m from it.
    assert near.xyz_m[:2] == pytest.approx((-2.9 + RESOLUTION_M / 2, 0.0), abs=RESOLUTION_M / 2 + 1e-9)
    assert across.regions == ("west",)
    assert across.xyz_m[0] == pytest.approx(-0.3, abs=RESOLUTION_M)
    notes = "\n".join(topology.notes)
    assert (
        "frame near at (-3.12, 0.00) m is inside a wall or obstacle, or too near to one; its topology node is 0.2"
        in notes
    )
    left_out = "frame inside at (1.00, 0.00) m is inside a wall or obstacle, or too near to one; the frame is left out"
    assert f"{left_out}: its region has no free floor within 0.5 m" in notes


def test_frames_that_belong_nowhere_are_told():
    frames = [frame("a", -2.0, 0.0), frame("far", 40.0, 0.0), frame("t", -2.0, 1.0, "door", FrameKind.TRANSITION)]
    notes = build_topology([two_rooms()], frames).notes
    assert "frame far at (40.00, 0.00, 1.50) m is left out: no floor mask covers it" in notes
    assert "frame t at (-2.00, 1.00) m belongs to no topology node: no node of a doorway is within 0.5 m" in notes


def test_a_narrow_doorway_is_dropped_and_what_lies_behind_is_told():
    topology = build_topology([two_rooms(door_m=0.45, wall_m=0.2)], [frame("a", -2.0, 0.0)])
    assert [node.id for node in topology.nodes] == ["a"]
    dropped, reach = topology.notes
    assert dropped == "a doorway of 0.45 m between west and east at (0.00, 0.00) m is left out: narrower than 0.5 m"
    assert reach == (
        "the region east cannot be reached from the other regions: no door of the region is wide enough for the robot"
    )


def test_a_doorway_that_the_robot_does_not_fit_through_is_told():
    topology = build_topology([two_rooms(door_m=0.6)], [frame("a", -2.0, 0.0)], TopologySettings(robot_radius_m=0.4))
    assert any(
        "a doorway of 0.60 m" in note and "a robot of radius 0.4 m does not fit through" in note
        for note in topology.notes
    )


def test_a_way_round_a_corner_is_added_where_sight_does_not_reach_and_reported():
    floor = block(two_rooms(wall_m=0.2), (-1.6, -1.0), (-0.9, 1.0))
    topology = build_topology([floor], [frame("a", -2.5, 0.0), frame("b", 1.5, 0.0, "east")])
    (bent,) = [e for e in topology.edges if e.path_m]
    assert {bent.start, bent.end} == {"a", "west/east"}
    # Around one end of a wall of 0.7 m x 2 m, 0.18 m from its corners at (-1.6, +-1) and (-0.9, +-1): the shortest
    # path, and a tolerance of one pixel per corner.
    ends = np.array([[-2.5, 0.0], [-1.6, 1.18], [-0.9, 1.18], [0.0, 0.0]])
    taut_m = np.linalg.norm(np.diff(ends, axis=0), axis=1).sum()
    assert taut_m - 0.1 <= bent.length_m <= taut_m + 0.3
    assert bent.length_m == pytest.approx(np.linalg.norm(np.diff(bent.path_m, axis=0), axis=1).sum())
    assert abs(np.degrees(edge(topology, "a", "west/east").azimuth_rad)) < 2
    assert topology.notes == (
        "these edges follow a shortest path, because obstacles block the straight line: a to west/east",
    )


def test_floors_are_told_apart_by_height_and_said_to_be_apart():
    upper = replace(two_rooms(z_m=3.0), regions={1: "loft", 2: "attic"})
    frames = [
        frame("below", -2.0, 0.0),
        frame("above", -2.0, 0.0, "loft", z_m=4.5),
        frame("cellar", -2.0, 0.0, z_m=-1.0),
    ]
    topology = build_topology([upper, two_rooms()], frames)
    assert {node.id: node.xyz_m[2] for node in topology.nodes} == {
        "below": 0.0,
        "west/east": 0.0,
        "above": 3.0,
        "loft/attic": 3.0,
    }
    assert [floor.z_m for floor in topology.floors] == [0.0, 3.0]
    assert (
        "the 2 floors at z = 0.00, 3.00 m are not connected: add stairs or lifts with `salframe map connect`"
        in topology.notes
    )
    assert any(note.startswith("frame cellar at (-2.00, 0.00, -1.00) m is left out") for note in topology.notes)


def test_two_buildings_at_one_height_are_one_map_of_two_parts():
    here = two_rooms()
    far = replace(two_rooms(), origin_m=(here.origin_m[0] + 300.0, here.origin_m[1]), regions={1: "north", 2: "south"})
    topology = build_topology([here, far])
    assert {node.id for node in topology.nodes if node.xyz_m[0] > 200} == {"north", "south", "north/south"}
    assert any("not connected" in note for note in topology.notes)
    at_far = with_position(topology, np.array([298.5, 0.0, 1.5]))
    neighbours = {e.start if e.end == HERE else e.end for e in at_far.edges if HERE in (e.start, e.end)}
    assert neighbours
    assert neighbours <= {"north", "south", "north/south"}


@pytest.mark.parametrize(
    ("floors", "message"),
    [
        ([], r"a topology \(graph for routes\) needs the masks of at least one floor, received none"),
        (
            [two_rooms(), two_rooms(0.6)],
            "two floors whose masks overlap or touch have z_m = 0 .*, expected a different z_m for each floor",
        ),
        ([two_rooms(), two_rooms(z_m=3.0)], r"two nodes of the topology .* would have the name 'west'"),
        ([replace(two_rooms(), region=np.zeros_like(two_rooms().region))], "has no free space in any region"),
    ],
)
def test_floors_that_make_no_map_are_refused_in_one_line(floors, message):
    with pytest.raises(DataError, match=message) as caught:
        build_topology(floors)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("style", "rooms", "seed"), [("home", 12, 1), ("office", 18, 2), ("hotel", 12, 3)])
def test_every_room_of_a_building_is_reachable(style, rooms, seed):
    building = generate_building(style, rooms, seed)
    frames = house_frames(building)
    topology = build_topology([building.floor_masks()], frames)
    graph = nx.Graph()
    graph.add_nodes_from(node.id for node in topology.nodes)
    graph.add_edges_from((e.start, e.end) for e in topology.edges)
    main = max(nx.connected_components(graph), key=len)
    assert {name for node in topology.nodes for name in node.regions if node.id in main} == {
        room.id for room in building.rooms
    }
    assert sorted(name for node in topology.nodes for name in node.frames) == sorted(f.id for f in frames)
    at = {f.id: f.T_world_pano[:2, 3] for f in frames}
    for node in topology.nodes:
        for name in node.frames:
            assert np.hypot(*(at[name] - node.xyz_m[:2])) <= (0.3 if node.kind == "transition" else 1e-9)
    pockets = [
        f"the node {name} cannot be reached: obstacles block every path to the node"
        for name in sorted(set(graph) - main)
    ]
    assert sorted(note for note in topology.notes if "these edges follow a shortest path" not in note) == pockets
    grid = FloorGrid(building.floor_masks(), 0.18)
    clear = ndimage.label(grid.clear)[0]
    parts = {node.id: clear[cell(grid.to_pixel(np.array(node.xyz_m[:2])))] for node in topology.nodes}
    assert len({parts[name] for name in main}) == 1
    assert all(parts[name] != parts[next(iter(main))] for name in set(graph) - main)


def test_the_same_masks_give_the_same_map():
    building = generate_building("home", 6, 4)
    first, second = (build_topology([building.floor_masks()], house_frames(building)) for _ in range(2))
    assert first == second
