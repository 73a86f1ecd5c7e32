"""Doorways of hand-drawn plans and of generated buildings, compared with the generator's doors."""

from __future__ import annotations

import numpy as np
import pytest
from plans import RESOLUTION_M, block, two_rooms
from salframe_house.building import generate_building

from salframe.panoramas.floors import FloorMasks
from salframe.topology.grid import FloorGrid
from salframe.topology.transitions import find_doorways


@pytest.mark.parametrize("wall_m", [0.1, 0.6])
@pytest.mark.parametrize("door_m", [0.5, 0.9, 1.5])
def test_the_transition_point_is_in_the_middle_of_the_threshold(door_m, wall_m):
    grid = FloorGrid(two_rooms(door_m, wall_m), 0.18)
    (doorway,) = find_doorways(grid)
    assert doorway.labels == (1, 2)
    assert doorway.width_m == pytest.approx(door_m, abs=0.01)
    (point,) = doorway.points
    assert np.abs(grid.to_metres(np.array(point) + 0.5)).max() <= 0.75 * RESOLUTION_M


def test_a_threshold_that_belongs_to_a_room_keeps_its_label():
    grid = FloorGrid(two_rooms(0.9, 0.6, label_threshold=True), 0.18)
    (doorway,) = find_doorways(grid)
    x, y = grid.to_metres(np.array(doorway.points[0]) + 0.5)
    assert (x, y) == pytest.approx((0.3, 0.0), abs=0.75 * RESOLUTION_M)


def test_a_doorway_that_furniture_stands_in_is_as_wide_as_what_is_left():
    grid = FloorGrid(block(two_rooms(0.9), (-0.2, -0.5), (0.2, 0.0)), 0.18)
    (doorway,) = find_doorways(grid)
    assert doorway.width_m == pytest.approx(0.45, abs=0.01)
    grid = FloorGrid(block(two_rooms(0.9), (-0.2, -0.2), (0.2, 0.2)), 0.18)
    assert [(round(doorway.width_m, 2), doorway.points) for doorway in find_doorways(grid)] == [(0.25, ()), (0.25, ())]


def test_transition_pixels_are_those_with_a_neighbour_of_another_region():
    """Three random regions in one hall: for each pair the components and medoids are computed independently pixel by
    pixel."""
    rng = np.random.default_rng(5)
    corners = rng.uniform(0, 40, (3, 2))
    rows, columns = np.mgrid[0:40, 0:40] + 0.5
    region = 1 + np.argmin([np.hypot(rows - r, columns - c) for r, c in corners], 0).astype(np.int32)
    free = np.ones(region.shape, bool)
    grid = FloorGrid(FloorMasks(free, region, np.zeros_like(free), 0.1, (0.0, 4.0), {}), 0.0)
    pixels: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for row in range(40):
        for column in range(40):
            for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
                if 0 <= r < 40 and 0 <= c < 40 and region[r, c] != region[row, column]:
                    pair = tuple(sorted((int(region[r, c]), int(region[row, column]))))
                    pixels.setdefault(pair, []).append((row, column))
    doorways = {doorway.labels: doorway for doorway in find_doorways(grid)}
    assert set(doorways) == set(pixels)
    for pair, points in pixels.items():
        points = np.unique(points, axis=0)
        spread = np.linalg.norm(points[:, None] - points, axis=2)
        (medoid,) = doorways[pair].points
        here = int(np.flatnonzero((points == medoid).all(1))[0])
        assert spread[here].sum() == pytest.approx(spread.sum(1).min())
        sides = [points[region[tuple(points.T)] == label] for label in pair]
        reach = min(np.linalg.norm(side[:, None] - side, axis=2).max() for side in sides)
        assert doorways[pair].width_m == pytest.approx((reach + 1) * 0.1)


def test_the_node_of_a_bent_threshold_lies_on_it():
    """The small region is the corner of a hall: its border has the shape of an L, and the centroid of that is off the
    border."""
    region = np.ones((30, 30), np.int32)
    region[:20, :20] = 2
    free = np.ones(region.shape, bool)
    grid = FloorGrid(FloorMasks(free, region, np.zeros_like(free), 0.1, (0.0, 3.0), {}), 0.0)
    (doorway,) = find_doorways(grid)
    ((row, column),) = doorway.points
    assert max(row, column) in (19, 20)


@pytest.mark.parametrize(("style", "rooms"), [("home", 6), ("home", 12), ("office", 12), ("hotel", 12), ("office", 42)])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_door_of_a_building_is_found_and_none_invented(style, rooms, seed):
    """All doors of the generator are 0.85 m and wider, and its furniture keeps off them: test_building says so."""
    building = generate_building(style, rooms, seed)
    floor = building.floor_masks()
    grid = FloorGrid(floor, 0.18)
    doorways = [
        (frozenset(floor.regions[label] for label in doorway.labels), grid.to_metres(np.array(point) + 0.5))
        for doorway in find_doorways(grid)
        if doorway.width_m >= 0.5
        for point in doorway.points
    ]
    assert len(doorways) == len(building.doors)
    for door in building.doors:
        away_m = [np.hypot(*(point - door.centre_m)) for regions, point in doorways if regions == set(door.rooms)]
        assert len(away_m) == sum(set(other.rooms) == set(door.rooms) for other in building.doors)
        assert min(away_m) <= 0.3
