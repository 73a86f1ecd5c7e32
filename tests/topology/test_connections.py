"""Stairs and lifts between the storeys of a map: routes, directions, files, and changes of the map."""

from __future__ import annotations

import numpy as np
import pytest
from plans import frame, two_rooms

from salframe.framework.errors import ConfigError, DataError, NoRoute, UnknownName
from salframe.localization.map_files import write_map
from salframe.panoramas.floors import Connection, FloorMasks
from salframe.topology.build import build_topology
from salframe.topology.connections import connect_storeys, read_connections, restore_connections
from salframe.topology.routes import directions, find_route, route_json
from salframe.topology.store import connect_map, open_topology, write_topology
from salframe.topology.topological_map import TopologicalMap

STAIRS = Connection(start="east", end="up-east", kind="stairs", length_m=6.0)
LIFT = Connection(start="a", end="up-a", kind="lift", length_m=20.0)


def two_storeys() -> TopologicalMap:
    """Two storeys of two rooms each; the upper one has the same frames with the prefix up-."""
    lower, upper = two_rooms(wall_m=0.2), two_rooms(wall_m=0.2, z_m=3.0)
    names = {1: "up-west", 2: "up-east"}
    masks = (upper.free, upper.region, upper.obstacle, upper.resolution_m, upper.origin_m, names, upper.z_m)
    frames = [
        frame("a", -2.0, 0.0),
        frame("b", 2.0, 0.0, "east"),
        frame("up-a", -2.0, 0.0, "up-west", z_m=4.5),
        frame("up-b", 2.0, 1.0, "up-east", z_m=4.5),
    ]
    return build_topology([FloorMasks(*masks), lower], frames)


def test_routes_cross_stairs_and_say_so():
    plain = two_storeys()
    with pytest.raises(NoRoute):
        find_route(plain, "a", "up-b")
    connected = connect_storeys(plain, [STAIRS])
    route = find_route(connected, "west", "up-east")
    walk_m = 4.0  # from a to b, straight through the doorway
    assert route.length_m == pytest.approx(walk_m + 6.0)
    assert [step.kind for step in directions(route, 0.0)][-1] == "stairs"
    assert route_json(route)["steps"][-1]["say"] == "take the stairs to floor 2, to up-b"
    back = find_route(connected, "up-b", "a")
    first, second, *_ = directions(back, heading_rad=0.0)
    assert (str(first), first.turn_rad, first.floor) == ("take the stairs to floor 1, to b", None, 1)
    assert second.turn_rad is None, "the heading after stairs is unknown"
    assert abs(second.azimuth_rad) == pytest.approx(np.pi)


def test_the_shorter_connection_is_taken():
    connected = connect_storeys(two_storeys(), [STAIRS, LIFT])
    assert [leg.kind for leg in find_route(connected, "b", "up-b").legs] == ["stairs"]
    far = connect_storeys(connected, [STAIRS.model_copy(update={"length_m": 60.0})])
    assert len(far.connections) == 2, "the same two ends are one connection"
    legs = find_route(far, "b", "up-b").legs
    assert "lift" in [leg.kind for leg in legs]
    assert sum(leg.length_m for leg in legs) == pytest.approx(4.0 + 20.0 + np.hypot(4.0, 1.0), abs=0.2)


def test_connected_floors_are_not_said_to_be_apart():
    plain = two_storeys()
    assert any("are not connected" in note for note in plain.notes)
    assert not any("are not connected" in note for note in connect_storeys(plain, [STAIRS]).notes)


@pytest.mark.parametrize(
    ("end", "error", "message"),
    [("west", DataError, "both on floor 1"), ("attic", UnknownName, "unknown node or place 'attic'")],
)
def test_wrong_ends_are_refused(end, error, message):
    with pytest.raises(error, match=message):
        connect_storeys(two_storeys(), [Connection(start="east", end=end, kind="lift", length_m=1.0)])


def test_a_map_keeps_its_connections(tmp_path):
    plain = two_storeys()
    with write_map(tmp_path / "map") as parts:
        write_topology(parts, plain)
        parts.write_json("method.json", {"kept": True})
    connected = connect_map(tmp_path / "map", [STAIRS])
    assert open_topology(tmp_path / "map") == connected
    both = connect_map(tmp_path / "map", [LIFT])
    assert both.connections == (STAIRS, LIFT)
    assert open_topology(tmp_path / "map") == both
    (folder,) = (tmp_path / "map").glob("parts-*")
    assert (folder / "method.json").exists()


def test_a_connection_whose_end_was_removed_is_dropped_with_a_note():
    restored = restore_connections(build_topology([two_rooms()], [frame("a", -2.0, 0.0)]), [STAIRS])
    assert restored.connections == ()
    assert any(
        "the connection (stairs) from east to up-east is dropped: unknown node or place 'up-east'" in note
        for note in restored.notes
    )


def test_connections_are_read_from_a_table(tmp_path):
    path = tmp_path / "stairs.csv"
    path.write_text("start,end,kind,length_m\neast,up-east,stairs,6\na,up-a,lift,20\n")
    assert read_connections(path) == [STAIRS, LIFT]
    path.write_text("start,end,kind,length_m\neast,up-east,ladder,6\n")
    with pytest.raises(ConfigError, match="row 2"):
        read_connections(path)
