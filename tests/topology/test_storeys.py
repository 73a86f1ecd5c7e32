"""Storeys from the heights of cameras, and recorded walks between them."""

from __future__ import annotations

import numpy as np
import pytest
from plans import frame
from rendered_rooms import range_frame, two_room_walls

from salframe.topology.build import build_topology
from salframe.topology.building_map import by_place
from salframe.topology.connections import connect_by_walks
from salframe.topology.derived_floors import derive_floors
from salframe.topology.routes import directions, find_route
from salframe.topology.storeys import find_walks, storeys
from salframe.topology.topological_map import EdgeKind

STAIRS_Z_M = (2.0, 2.6, 3.2, 3.8)
"""Heights of cameras on stairs from 1.5 to 4.5 m."""


def walk_up():
    """Two storeys of two rooms, 3 m apart, in the order of a walk: west, east, up the stairs, up-east, up-west."""
    lower, upper = two_room_walls(), two_room_walls(floor_m=3.0)
    return [
        range_frame("a", "west", -2.5, 0.5, lower),
        range_frame("b", "west", -1.0, 0.5, lower),
        range_frame("c", "east", 1.0, 0.5, lower),
        range_frame("d", "east", 2.5, 0.5, lower),
        *(frame(f"stairs-{k}", 2.5, 0.5 - 0.4 * (k + 1), "stairs", z_m=z) for k, z in enumerate(STAIRS_Z_M)),
        range_frame("up-d", "up-east", 2.5, -1.5, upper, floor_m=3.0),
        range_frame("up-c", "up-east", 1.0, 0.5, upper, floor_m=3.0),
        range_frame("up-a", "up-west", -2.0, 0.5, upper, floor_m=3.0),
    ]


def test_cameras_of_different_heights_stand_on_one_storey_until_a_gap():
    groups = storeys(np.array([1.5, 4.4, 0.6, 1.9, 4.6]))
    assert [sorted(group.tolist()) for group in groups] == [[0, 2, 3], [1, 4]]


def test_cameras_on_stairs_belong_to_no_storey():
    heights_m = np.array([1.5, 1.45, 1.55, *STAIRS_Z_M, 4.5, 4.55])
    groups = storeys(heights_m)
    assert [sorted(group.tolist()) for group in groups] == [[0, 1, 2], [7, 8]]


def test_a_walk_up_the_stairs_connects_the_storeys_of_a_map():
    frames = walk_up()
    plan = derive_floors(frames)
    assert [floor.z_m for floor in plan.floors] == pytest.approx([0.0, 3.0], abs=0.02)
    assert plan.notes == ("4 frames are between the storeys, and are ignored: stairs-0, stairs-1, stairs-2, ...",)
    apart = build_topology(plan.floors, by_place(frames))
    topology = connect_by_walks(apart, frames)
    (connection,) = topology.connections
    length_m = np.hypot(0.4, 0.5) + 3 * np.hypot(0.4, 0.6) + np.hypot(0.4, 0.7)
    assert connection.length_m == pytest.approx(length_m)
    assert connection.kind == EdgeKind.STAIRS
    assert (
        topology.notes[-1]
        == f"two floors are connected by stairs of {length_m:.1f} m, recorded from the frame d to the frame up-d"
    )
    steps = [str(step) for step in directions(find_route(topology, "a", "up-a"))]
    assert any(step.startswith("take the stairs to floor 2, to ") for step in steps)
    assert connect_by_walks(apart, frames[:4] + frames[8:]).connections == ()  # no frame on the stairs


def test_a_frame_above_the_other_is_a_lift_and_distant_frames_are_no_walk():
    lift = [frame("a", 0.0, 0.0), frame("b", 0.3, 0.0, z_m=7.5)]
    (walk,) = find_walks(lift, {"a", "b"})
    assert (walk.start.id, walk.end.id, walk.kind) == ("a", "b", EdgeKind.LIFT)
    assert walk.length_m == pytest.approx(np.hypot(0.3, 6.0))
    assert list(find_walks([lift[0], frame("b", 3.0, 0.0, z_m=7.5)], {"a", "b"})) == []
