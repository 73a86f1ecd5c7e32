"""Floors derived from range images of rooms whose walls, doorways and furniture are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rendered_rooms import box_range, range_frame, two_room_walls

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks, floor_pixels
from salframe.panoramas.folder_format import FrameEntry, write_manifest, write_objects, write_panorama
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama
from salframe.topology.build import build_topology
from salframe.topology.building_map import build_map
from salframe.topology.derived_floors import derive_floors, extend_floors
from salframe.topology.map_changes import add_to_map
from salframe.topology.routes import find_route
from salframe.topology.store import open_topology
from salframe.topology.topological_map import NodeKind, PartSource, TopologySources

TABLE = ((1.5, 0.6, 0.7), (2.7, 1.4, 0.75))
"""A table top without legs; the floor below it is not walkable."""
RUG = ((-3.0, -1.0, 0.0), (-2.0, 0.0, 0.04))


def two_rooms(extra=(), floor_m: float = 0.0, prefix: str = "") -> list[ReferenceFrame]:
    boxes = [*two_room_walls(floor_m=floor_m), *extra]
    return [
        range_frame(f"{prefix}{id}", f"{prefix}{place}", x, y, boxes, floor_m=floor_m)
        for id, place, x, y in (
            ("a", "west", -3.0, -1.2),
            ("b", "west", -1.0, 1.0),
            ("c", "east", 1.0, -1.0),
            ("d", "east", 3.2, 1.2),
        )
    ]


def at(floor: FloorMasks, mask: np.ndarray, x_m: float, y_m: float):
    row, column = floor_pixels(floor, np.array([[x_m, y_m]]))[0]
    return mask[row, column]


def test_free_space_ends_at_walls_and_furniture():
    (floor,) = derive_floors(two_rooms([TABLE, RUG])).floors
    walkable = floor.free & ~floor.obstacle
    assert floor.z_m == pytest.approx(0.0, abs=0.02)
    # Two rooms of 3.9 x 4 m and a threshold of 0.2 x 0.9 m, less a table of 1.2 x 0.8 m; one cell at each edge.
    area_m2 = 2 * 3.9 * 4.0 + 0.2 * 0.9 - 1.2 * 0.8
    assert walkable.sum() * 0.05**2 == pytest.approx(area_m2, rel=0.03)
    assert at(floor, floor.obstacle, 2.1, 1.0)
    assert at(floor, walkable, 1.3, 1.0)
    assert at(floor, walkable, -2.5, -0.5), "a rug is floor"
    for x, y in ((0.0, 1.0), (4.03, 0.0), (-1.0, -2.03)):
        assert not at(floor, floor.free, x, y)


def test_regions_meet_in_the_doorway():
    plan = derive_floors(two_rooms([TABLE]))
    topology = build_topology(plan.floors, plan.frames, sources=plan.sources)
    (door,) = [node for node in topology.nodes if node.kind is NodeKind.TRANSITION]
    assert set(door.regions) == {"west", "east"}
    assert np.hypot(*door.xyz_m[:2]) <= 0.15
    assert [node.id for node in topology.nodes if node.kind is NodeKind.SCENE] == ["a", "b", "c", "d"]
    assert topology.sources.free_space is PartSource.RANGE
    assert topology.sources.regions is PartSource.PLACES
    assert [frame.place for frame in plan.frames] == ["west", "west", "east", "east"]


def test_frames_of_a_doorway_are_no_seeds_of_regions():
    frames = two_rooms()
    door = range_frame("door", "transition-1", 0.0, 0.0, two_room_walls(), kind=FrameKind.TRANSITION)
    (floor,) = derive_floors([*frames, door]).floors
    assert set(floor.regions.values()) == {"west", "east"}
    topology = build_topology([floor], [*frames, door])
    assert [node.frames for node in topology.nodes if node.kind is NodeKind.TRANSITION] == [("door",)]


def test_tilted_cameras_give_the_same_free_space():
    boxes = two_room_walls()
    level = derive_floors(two_rooms()).floors[0]
    tilted = []
    for frame in two_rooms():
        pose = frame.T_world_pano.copy()
        c, s = np.cos(0.3), np.sin(0.3)
        pose[:3, :3] = pose[:3, :3] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        image = box_range(boxes, pose)
        tilted.append(replace(frame, T_world_pano=pose, load=lambda image=image: Panorama("x", range_m=image)))
    floor = derive_floors(tilted).floors[0]
    for x, y in ((-2.0, 0.0), (0.0, 0.0), (2.0, -1.0), (3.5, 1.5)):
        assert at(floor, floor.free & ~floor.obstacle, x, y)
        assert at(level, level.free & ~level.obstacle, x, y)
    assert floor.free.sum() == pytest.approx(level.free.sum(), rel=0.03)


def test_frames_without_places_get_the_regions_between_doorways_named_by_their_objects():
    frames = [replace(frame, place=frame.id) for frame in two_rooms()]
    labels = {"a": ["bed", "chair", "wardrobe"], "b": ["toilet"], "c": ["oven"], "d": ["fridge", "table"]}
    plan = derive_floors(frames, lambda frame: labels[frame.id])
    assert [frame.place for frame in plan.frames] == ["bedroom 1", "bedroom 1", "kitchen 1", "kitchen 1"]
    assert sorted(plan.floors[0].regions.values()) == ["bedroom 1", "kitchen 1"]
    assert plan.sources.regions is PartSource.FREE_SPACE
    unlabelled = derive_floors(frames)
    assert sorted(unlabelled.floors[0].regions.values()) == ["room 1", "room 2"]


def test_places_that_are_ids_stay_if_each_region_has_one_frame():
    frames = [replace(frame, place=frame.id) for frame in two_rooms()][1:3]
    plan = derive_floors(frames)
    assert [frame.place for frame in plan.frames] == ["b", "c"]
    assert plan.sources.regions is PartSource.PLACES


def test_storeys_have_floors_at_their_heights():
    frames = [*two_rooms(), *two_rooms(floor_m=3.0, prefix="up-")]
    plan = derive_floors(frames[::-1])
    assert [floor.z_m for floor in plan.floors] == pytest.approx([0.0, 3.0], abs=0.02)
    assert [set(floor.regions.values()) for floor in plan.floors] == [{"west", "east"}, {"up-west", "up-east"}]


def test_frames_without_range_are_noted_and_data_without_range_are_refused():
    pose = pose_2d(-2.0, 0.0, 0.0, 1.5)
    blind = ReferenceFrame("blind", "west", pose, load=lambda: Panorama("blind", rgb=np.zeros((8, 16, 3), np.uint8)))
    plan = derive_floors([*two_rooms(), blind])
    assert plan.notes == ("1 of 5 frames at z = 0.0 m add no free space, because they have no range: blind",)
    with pytest.raises(DataError, match="neither floor masks nor range images"):
        derive_floors([blind])


def write_folder(folder, frames, with_range: bool = True):
    """Write frames as a folder without floor masks, in which all surfaces are a table."""
    folder.mkdir(exist_ok=True)
    write_objects(folder / "objects.parquet", {"instance_id": [1], "label": ["table"]})
    entries = []
    for frame in frames:
        range_m = frame.load().range_m
        ids = np.ones(range_m.shape, np.int32)
        pose = tuple(frame.T_world_pano.ravel().tolist())
        files = {"instances": f"{frame.id}.instances.png"}
        if with_range:
            files["range"] = f"{frame.id}.range.png"
        entry = FrameEntry(id=frame.id, role="map", place=frame.place, pose=pose, **files)
        write_panorama(folder, entry, None, range_m if with_range else None, ids)
        entries.append(entry)
    write_manifest(folder, entries, {}, objects="objects.parquet")
    return folder


def test_a_folder_without_masks_gets_a_map_with_routes(tmp_path):
    write_folder(tmp_path, two_rooms([TABLE]))
    built = build_map(tmp_path, tmp_path / "map", "saliency-graph")
    read = open_topology(tmp_path / "map")
    assert read == built.topology
    assert read.sources == TopologySources(free_space=PartSource.RANGE, regions=PartSource.PLACES)
    assert read.notes[0] == (
        "floors without masks: the free space is derived from range, the regions are derived from places"
    )
    route = find_route(read, "west", "east")
    assert route.length_m == pytest.approx(np.hypot(1.0, 1.0) * 2, abs=0.1)  # from b through (0, 0) to c


def test_a_strip_that_no_camera_sees_is_walkable_if_it_is_narrower_than_a_robot():
    # A camera at (-1, 1) sees boxes 0.12 and 0.3 m wide, 1 m away; their shadows are 0.22 and 0.55 m wide at 1.8 m.
    narrow = ((-2.06, 0.94, 0.0), (-1.94, 1.06, 1.0))
    wide = ((-2.06, 0.85, 0.0), (-1.94, 1.15, 1.0))
    for box, is_walkable in ((narrow, True), (wide, False)):
        (floor,) = derive_floors([range_frame("b", "west", -1.0, 1.0, [*two_room_walls(), box])]).floors
        assert at(floor, floor.free & ~floor.obstacle, -2.8, 1.0) == is_walkable
        assert at(floor, floor.obstacle, -1.96, 1.0)


def overlap(floor: FloorMasks, place: str, low_m, high_m) -> float:
    """Return the intersection over union of the region of a place and a rectangle, on the cells of the floor."""
    row, column = np.indices(floor.region.shape)
    x_m = floor.origin_m[0] + (column + 0.5) * floor.resolution_m
    y_m = floor.origin_m[1] - (row + 0.5) * floor.resolution_m
    inside = (x_m > low_m[0]) & (x_m < high_m[0]) & (y_m > low_m[1]) & (y_m < high_m[1])
    (label,) = [label for label, name in floor.regions.items() if name == place]
    return float((inside & (floor.region == label)).sum() / (inside | (floor.region == label)).sum())


def test_a_room_that_is_added_to_a_map_with_derived_floors_gets_nodes_and_routes(tmp_path):
    frames = two_rooms()
    build_map(write_folder(tmp_path / "west", frames[:2]), tmp_path / "map", "saliency-graph")
    lines: list[str] = []
    change = add_to_map(tmp_path / "map", write_folder(tmp_path / "east", frames[2:]), tell=lines.append)
    assert change.added == ("east",)
    assert not [line for line in lines if "nodes" in line]
    topology = open_topology(tmp_path / "map")
    assert topology.sources.free_space is PartSource.RANGE
    (floor,) = topology.floors
    # Each room has 3.9 x 4 m, and the doorway is at x = 0.
    assert overlap(floor, "west", (-4.0, -2.0), (-0.1, 2.0)) > 0.96
    assert overlap(floor, "east", (0.1, -2.0), (4.0, 2.0)) > 0.96
    (door,) = [node for node in topology.nodes if node.kind is NodeKind.TRANSITION]
    assert np.hypot(*door.xyz_m[:2]) <= 0.15
    assert find_route(topology, "west", "east").length_m == pytest.approx(2 * np.hypot(1.0, 1.0), abs=0.1)


def test_a_place_that_is_added_again_replaces_its_floor(tmp_path):
    frames = two_rooms()
    build_map(write_folder(tmp_path / "both", frames), tmp_path / "map", "saliency-graph")
    (before,) = open_topology(tmp_path / "map").floors
    add_to_map(tmp_path / "map", write_folder(tmp_path / "east", two_rooms([TABLE])[2:]))
    (after,) = open_topology(tmp_path / "map").floors
    assert at(before, before.free & ~before.obstacle, 2.1, 1.0)
    assert not at(after, after.free & ~after.obstacle, 2.1, 1.0), "the new table stands here"
    assert at(after, after.free & ~after.obstacle, -2.5, -0.5)


def test_a_storey_that_is_added_to_derived_floors_has_its_height(tmp_path):
    build_map(write_folder(tmp_path / "lower", two_rooms()), tmp_path / "map", "saliency-graph")
    add_to_map(tmp_path / "map", write_folder(tmp_path / "upper", two_rooms(floor_m=3.0, prefix="up-")))
    floors = open_topology(tmp_path / "map").floors
    assert [floor.z_m for floor in floors] == pytest.approx([0.0, 3.0], abs=0.02)
    assert [set(floor.regions.values()) for floor in floors] == [{"west", "east"}, {"up-west", "up-east"}]


def test_places_without_range_are_added_without_nodes_and_a_line_says_so(tmp_path):
    frames = two_rooms()
    build_map(write_folder(tmp_path / "west", frames[:2]), tmp_path / "map", "objects")
    lines: list[str] = []
    blind = write_folder(tmp_path / "east", frames[2:], with_range=False)
    assert add_to_map(tmp_path / "map", blind, tell=lines.append).places == 2
    (line,) = [line for line in lines if "nodes" in line]
    assert line == (
        "warning: places without floor masks get no topology nodes: the data have neither floor masks nor range images "
        "to derive floors from, expected one of them"
    )
    topology = open_topology(tmp_path / "map")
    assert {node.regions for node in topology.nodes} == {("west",)}


def test_derived_places_are_not_extended_by_frames_without_places():
    frames = [replace(frame, place=frame.id) for frame in two_rooms()]
    plan = derive_floors(frames)
    assert plan.sources.regions is PartSource.FREE_SPACE
    new = [replace(frame, id=f"new-{frame.id}", place=f"new-{frame.id}") for frame in two_rooms()]
    with pytest.raises(DataError, match="only possible for all frames together: build the map again"):
        extend_floors(plan.floors, plan.frames, new, plan.sources)


def test_regions_of_a_map_file_grow_again_from_frames_without_range():
    (floor,) = derive_floors(two_rooms()).floors
    one_region = replace(floor, region=floor.free.astype(np.int32), regions={1: "west"})
    blind = [replace(frame, load=lambda: pytest.fail("the range was read")) for frame in two_rooms()]
    sources = TopologySources(free_space=PartSource.MAP_FILE, regions=PartSource.PLACES)
    (extended,) = extend_floors([one_region], blind[:2], blind[2:], sources)
    np.testing.assert_array_equal(extended.free, floor.free)
    assert overlap(extended, "west", (-4.0, -2.0), (-0.1, 2.0)) > 0.96
    assert overlap(extended, "east", (0.1, -2.0), (4.0, 2.0)) > 0.96
