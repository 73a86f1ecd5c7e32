"""Generated buildings: their rooms, what stands in them, masks, twins and changes."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import asdict
from functools import lru_cache

import networkx as nx
import numpy as np
import pytest
from salframe_house.building import Building, change_building, generate_building
from salframe_house.furniture import object_mesh
from scipy import ndimage

from salframe.framework.errors import ConfigError

BUILDINGS = [("home", 6), ("home", 12), ("office", 12), ("office", 42), ("hotel", 6), ("hotel", 12), ("hotel", 42)]


@lru_cache
def building(style: str, rooms: int, seed: int = 0) -> Building:
    return generate_building(style, rooms, seed)


def footprint(placed) -> np.ndarray:
    """(V, 3) vertices of an object in the world, transformed here on their own."""
    mesh = object_mesh(placed.label, placed.size_m, placed.seed, placed.mirrored)
    x, y, z = mesh.vertices_m.T
    c, s = np.cos(placed.yaw_rad), np.sin(placed.yaw_rad)
    return np.column_stack([c * x - s * y + placed.x_m, s * x + c * y + placed.y_m, z + placed.z_m])


def collisions(house: Building) -> list[tuple[str, str]]:
    """Pairs of objects of a room whose meshes' bounding boxes share volume."""
    found = []
    for room in house.rooms:
        objects = [placed for placed in house.objects if placed.room == room.id]
        points = [footprint(placed) for placed in objects]
        low, high = np.array([p.min(0) for p in points]), np.array([p.max(0) for p in points])
        for i, j in zip(*np.triu_indices(len(objects), 1), strict=True):
            if (np.minimum(high[i], high[j]) - np.maximum(low[i], low[j]) > 5e-3).all():
                found.append((objects[i].label, objects[j].label))
    return found


@pytest.mark.parametrize("rooms", [4, 5, 9, 18, 29])
@pytest.mark.parametrize("style", ["home", "office", "hotel"])
def test_a_building_has_exactly_the_rooms_asked_for(style, rooms):
    house = generate_building(style, rooms, 3)
    assert len({room.id for room in house.rooms}) == rooms
    assert any(room.kind == "corridor" for room in house.rooms)
    assert [placed.instance_id for placed in house.objects] == list(range(1, len(house.objects) + 1))


@pytest.mark.parametrize(("style", "rooms"), BUILDINGS)
def test_rooms_are_apart_and_one_walks_from_each_to_each(style, rooms):
    house = building(style, rooms)
    for i, a in enumerate(house.rooms):
        for b in house.rooms[i + 1 :]:
            overlap = np.minimum(a.high_m, b.high_m) - np.maximum(a.low_m, b.low_m)
            assert (overlap <= -0.1).any(), (a.id, b.id)  # a wall stands between them
    assert nx.is_connected(nx.Graph([door.rooms for door in house.doors]))
    assert {name for door in house.doors for name in door.rooms} == {room.id for room in house.rooms}


@pytest.mark.parametrize(("style", "rooms"), BUILDINGS)
def test_rooms_hold_5_to_14_objects_within_their_walls_and_none_collide(style, rooms):
    house = building(style, rooms)
    count = Counter(placed.room for placed in house.objects)
    assert all(5 <= count[room.id] <= 14 for room in house.rooms)
    assert collisions(house) == []
    by_id = {room.id: room for room in house.rooms}
    for placed in house.objects:
        points, room = footprint(placed), by_id[placed.room]
        assert (points[:, :2].min(0) > np.array(room.low_m) - 1e-3).all()
        assert (points[:, :2].max(0) < np.array(room.high_m) + 1e-3).all()
        assert points[:, 2].min() > -1e-3
        assert points[:, 2].max() < room.height_m + 1e-3


def test_the_median_room_of_large_buildings_holds_8_objects():
    count = [Counter(placed.room for placed in building("office", 42, seed).objects) for seed in range(2)]
    assert 7.5 <= np.median([number for rooms in count for number in rooms.values()]) <= 8.5


@pytest.mark.parametrize(("style", "rooms"), BUILDINGS)
def test_all_doorways_are_joined_by_free_floor_for_a_robot(style, rooms):
    masks = building(style, rooms).floor_masks()
    walkable = ndimage.distance_transform_edt(masks.free & ~masks.obstacle) * masks.resolution_m >= 0.18
    labels, _ = ndimage.label(walkable)
    main = np.bincount(labels[labels > 0]).argmax()
    assert {int(label) for label in np.unique(masks.region[labels == main])} == set(masks.regions)
    assert (labels == main).sum() > 0.9 * walkable.sum()


def test_pixels_on_the_edge_of_a_threshold_do_not_close_the_doorway():
    house = building("office", 106, 202)  # its doorways at y = 33.45 m end at centres of pixels
    masks = house.floor_masks()
    for door in house.doors:
        column, row = np.floor((np.array(door.centre_m) - masks.origin_m) / (0.05, -0.05)).astype(int)
        around = masks.free[row - 3 : row + 4, column - 3 : column + 4]
        assert around.any(0).all()
        assert around.any(1).all()


def test_labels_meet_in_the_middle_of_thresholds():
    house = building("office", 12)
    masks = house.floor_masks(0.02)
    by_name = {name: label for label, name in masks.regions.items()}
    for door in house.doors:
        axis = np.array([1.0, 0.0]) if door.axis == "x" else np.array([0.0, 1.0])
        for side, name in zip((-1, 1), door.rooms, strict=True):
            x, y = np.array(door.centre_m) + side * 0.03 * axis
            row, column = int((masks.origin_m[1] - y) / 0.02), int((x - masks.origin_m[0]) / 0.02)
            assert masks.free[row, column]
            assert masks.region[row, column] == by_name[name]


@pytest.mark.parametrize("style", ["office", "hotel"])
@pytest.mark.parametrize("rooms", [6, 12, 42])
def test_a_quarter_of_the_rooms_are_twins_with_the_same_objects(style, rooms):
    house = building(style, rooms)
    groups: dict[str, list] = {}
    for room in house.rooms:
        if room.twin:
            groups.setdefault(room.twin, []).append(room)
    assert sum(map(len, groups.values())) >= rooms / 4
    for twins in groups.values():
        assert len(twins) >= 2
        lists = [
            sorted((placed.label, placed.seed) for placed in house.objects if placed.room == room.id) for room in twins
        ]
        assert all(other == lists[0] for other in lists)


def test_mirrored_twins_have_opposite_handedness():
    house = next(
        h for h in (building("office", 42, seed) for seed in range(5)) if any(room.mirrored for room in h.rooms)
    )
    room = next(room for room in house.rooms if room.mirrored)

    def positions(name: str) -> np.ndarray:
        """(N, 2) objects in the order of their labels and seeds."""
        objects = sorted(
            (placed for placed in house.objects if placed.room == name), key=lambda placed: (placed.label, placed.seed)
        )
        points = np.array([(placed.x_m, placed.y_m) for placed in objects])
        return points - points.mean(0)

    before, after = positions(room.mirror_of), positions(room.id)
    u, _, vt = np.linalg.svd(before.T @ after)
    best = u @ vt  # orthogonal Procrustes: a reflection has determinant -1
    np.testing.assert_allclose(before @ best, after, atol=1e-3)
    assert np.linalg.det(best) == pytest.approx(-1)


def test_the_scene_holds_every_object_and_lights_every_room():
    house = building("hotel", 12)
    scene = house.scene()
    assert set(np.unique(scene.instance_id).tolist()) == {0} | {placed.instance_id for placed in house.objects}
    assert scene.uv_m.shape == (len(scene.triangles), 3, 2)
    assert scene.triangles.max() == len(scene.vertices_m) - 1
    assert scene.material_index.max() == len(scene.materials) - 1
    assert {light.room for light in scene.lights if light.kind == "lamp"} == {room.id for room in house.rooms}
    for placed in house.objects[:20]:
        own = scene.vertices_m[np.unique(scene.triangles[scene.instance_id == placed.instance_id])]
        np.testing.assert_allclose(own.min(0), footprint(placed).min(0), atol=1e-3)
        np.testing.assert_allclose(own.max(0), footprint(placed).max(0), atol=1e-3)


def test_42_rooms_stay_under_300_000_triangles():
    assert len(building("office", 42).scene().triangles) < 300_000


def test_the_same_arguments_give_the_same_building_and_another_seed_another():
    again = generate_building("office", 12, 0)
    assert again.objects == building("office", 12).objects
    assert again.rooms == building("office", 12).rooms
    assert generate_building("office", 12, 1).objects != again.objects


@pytest.mark.parametrize("fraction", [0.1, 0.5])
def test_a_third_each_of_the_changes_removes_moves_and_adds(fraction):
    house = building("office", 12)
    changed = change_building(house, fraction, 7)
    before = {placed.instance_id: placed for placed in house.objects}
    after = {placed.instance_id: placed for placed in changed.objects}
    removed, added = before.keys() - after.keys(), after.keys() - before.keys()
    moved = [i for i in before.keys() & after.keys() if before[i] != after[i]]
    third = fraction * len(before) / 3
    assert all(abs(number - third) <= 1 for number in (len(removed), len(added), len(moved)))
    assert len(removed) + len(added) + len(moved) == round(fraction * len(before))
    for i in moved:
        assert (before[i].label, before[i].room, before[i].seed) == (after[i].label, after[i].room, after[i].seed)
        assert np.hypot(before[i].x_m - after[i].x_m, before[i].y_m - after[i].y_m) >= 0.3
    assert collisions(changed) == []
    assert change_building(house, fraction, 7).objects == changed.objects
    assert change_building(house, fraction, 8).objects != changed.objects


@pytest.mark.parametrize(
    ("kinds", "shares"),
    [
        (("removed",), (1, 0, 0)),
        (("moved",), (0, 1, 0)),
        (("added",), (0, 0, 1)),
        (("added", "removed"), (1 / 2, 0, 1 / 2)),
    ],
)
def test_changes_may_be_of_some_kinds_alone(kinds, shares):
    house = building("office", 12)
    before = {placed.instance_id: placed for placed in house.objects}
    after = {placed.instance_id: placed for placed in change_building(house, 0.3, 7, kinds=kinds).objects}
    moved = [i for i in before.keys() & after.keys() if before[i] != after[i]]
    counts = len(before.keys() - after.keys()), len(moved), len(after.keys() - before.keys())
    total = round(0.3 * len(before))
    assert sum(counts) == total
    assert counts == pytest.approx([share * total for share in shares], abs=0.5)


@pytest.mark.parametrize(
    ("arguments", "drawn"), [(("home", 12, 3), "8ad7276dcb301c0a"), (("office", 42, 200), "b5c04e4a6f9c8740")]
)
def test_the_draw_of_changes_stays_as_it_was(arguments, drawn):
    """Digests of what version 0.1 drew: published figures rest on them."""
    changed = change_building(generate_building(*arguments), 0.1, arguments[2])
    content = json.dumps([asdict(placed) for placed in changed.objects], sort_keys=True, default=float)
    assert hashlib.sha256(content.encode()).hexdigest()[:16] == drawn


def test_nothing_is_left_in_the_air_by_changes():
    house = building("home", 12)
    changed = change_building(house, 0.6, 2)
    for placed in changed.objects:
        if placed.z_m > 0 and placed.label in (
            "monitor",
            "lamp",
            "microwave",
            "coffee machine",
            "kettle",
            "laptop",
            "printer",
            "flowers",
        ):
            assert any(other.carries(placed) for other in changed.objects), placed


def test_bad_arguments_are_named():
    with pytest.raises(ConfigError, match=r"'castle'.*home, office, hotel"):
        generate_building("castle", 12, 0)
    with pytest.raises(ConfigError, match=r"3 rooms.*at least 4"):
        generate_building("home", 3, 0)
    with pytest.raises(ConfigError, match=r"1\.5.*0 to 1"):
        change_building(building("home", 6), 1.5, 0)
