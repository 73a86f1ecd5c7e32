"""Places of reference frames against the regions of the floor masks: two storeys drawn by hand, and buildings."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.opening import configure_dataset, find_dataset, reference_frames
from salframe.panoramas.region_check import check_regions, compare_regions

SHARED = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")) / "matterport3d"
KINDS = {"map": FrameKind.SCENE, "transition": FrameKind.TRANSITION}
ROOMS = {"hall": (0.0, 6.0), "kitchen": (0.0, 3.0), "study": (4.2, 3.0)}
"""Left and upper edge of each room; the hall is 10 m x 2.8 m, the others are 4 m x 2.8 m."""


def masks(storey: str = "", z_m: float = 0.0, resolution_m: float = 0.1) -> FloorMasks:
    """Three rooms with walls of 0.2 m between them, from (0, 0) to (10, 6) m."""
    region = np.zeros((round(6 / resolution_m), round(10 / resolution_m)), np.int32)
    for label, (name, (left_m, top_m)) in enumerate(ROOMS.items(), 1):
        row, column = round((6 - top_m) / resolution_m), round(left_m / resolution_m)
        width_m = 10 if name == "hall" else 4
        region[row : row + round(2.8 / resolution_m), column : column + round(width_m / resolution_m)] = label
    names = {label: storey + name for label, name in enumerate(ROOMS, 1)}
    return FloorMasks(region > 0, region, region == 0, resolution_m, (0.0, 6.0), names, z_m)


def frames(storey: str = "", z_m: float = 1.5) -> list[ReferenceFrame]:
    """Six frames in rooms, and one in the door between hall and kitchen."""
    scenes = {"hall": [(2, 4.5), (7, 4.5)], "kitchen": [(1, 1.4), (3, 1.4)], "study": [(5.5, 1.4), (7, 1.4)]}
    listed = [
        ReferenceFrame(f"{storey}{place}-{number}", storey + place, pose_2d(x, y, 0.0, z_m))
        for place, points in scenes.items()
        for number, (x, y) in enumerate(points)
    ]
    return [*listed, ReferenceFrame(f"{storey}door", f"{storey}door", pose_2d(2, 3.1, 0, z_m), FrameKind.TRANSITION)]


def moved(floor: FloorMasks, x_m: float, y_m: float) -> FloorMasks:
    return replace(floor, origin_m=(floor.origin_m[0] + x_m, floor.origin_m[1] + y_m))


def swapped(floor: FloorMasks) -> FloorMasks:
    names = list(floor.regions.values())
    return replace(floor, regions=dict(zip(floor.regions, [names[1], names[0], names[2]], strict=True)))


def mirrored(floor: FloorMasks, axis: int) -> FloorMasks:
    free, region, obstacle = (np.flip(mask, axis) for mask in (floor.free, floor.region, floor.obstacle))
    return replace(floor, free=free, region=region, obstacle=obstacle)


def test_right_masks_are_silent():
    floors = [masks("upper-", 3.0), masks()]
    both = [*frames(), *frames("upper-", 4.5)]
    assert compare_regions(both, floors).num_compared == 12
    assert check_regions(both, floors) is None
    assert check_regions(both, floors[1:]) is None  # a storey without masks
    assert check_regions(frames(z_m=0.2), floors) is check_regions(frames(z_m=2.5), floors) is None
    assert check_regions(both, []) is check_regions([], floors) is None


@pytest.mark.parametrize(
    ("floors", "cause"),
    [
        ([swapped(masks())], r"names in `regions` may be swapped \(kitchen should be hall, hall should be kitchen\)"),
        (
            [masks(z_m=3.0)],
            r"z_m of the floors may be wrong \(3\), expected the height of each floor in the world, below",
        ),
        ([masks(z_m=-2.0)], r"z_m of the floors may be wrong \(-2\)"),
        ([mirrored(masks(), 0)], "masks may be mirrored: row 0 must be at the largest y"),
        ([mirrored(masks(), 1)], "masks may be mirrored: column 0 must be at the smallest x"),
        ([moved(masks(), 0, -6)], "origin_m may be the lower left corner, expected the upper left corner"),
        ([replace(masks(), resolution_m=0.2)], "resolution_m may be wrong, a value 0.5 times as large fits"),
        ([moved(masks(), 0, 1)], r"masks may be shifted: move origin_m by \(0, -0.5\) m"),
        ([moved(masks(), 2.5, 0)], r"masks may be shifted: move origin_m by \(-1.5, 0\) m"),
        (
            [replace(masks(), regions={1: "a", 2: "b", 3: "c"})],
            r"swapped \(a should be hall, b should be kitchen, c should be study\)",
        ),
    ],
)
def test_wrong_masks_are_refused_with_their_likely_cause(floors, cause):
    with pytest.raises(DataError, match=cause) as error:
        check_regions(frames(), floors)
    assert "\n" not in str(error.value)
    assert (
        " reference frames (panoramas of the map) stand outside the region of their place in the floor masks: "
        in str(error.value)
    )


@pytest.mark.parametrize("heights_m", [(3.0, 0.0), (0.0, 1.0), (0.0, 30.0)])
def test_wrong_heights_of_two_storeys_are_refused(heights_m):
    lower_m, upper_m = heights_m
    with pytest.raises(DataError, match="z_m of the floors may be wrong"):
        check_regions([*frames(), *frames("upper-", 4.5)], [masks(z_m=lower_m), masks("upper-", upper_m)])


def test_two_floors_of_one_height_are_refused():
    with pytest.raises(
        DataError,
        match=r"two floors whose masks overlap or touch have z_m = 0 .*, expected a different z_m for each floor",
    ):
        check_regions(frames(), [masks(), masks("upper-")])


def test_few_frames_outside_their_region_are_reported():
    many = [replace(frame, id=f"{frame.id}-{copy}") for copy in range(6) for frame in frames()]
    stray = ReferenceFrame("stray", "kitchen", pose_2d(7, 1.4, 0, 1.5))
    lost = ReferenceFrame("lost", "kitchen", pose_2d(-3, 1.4, 0, 1.5))
    door = ReferenceFrame("door", "door", pose_2d(5, 4.6, 0, 1.5), FrameKind.TRANSITION)
    edge = ReferenceFrame("edge", "kitchen", pose_2d(4.3, 1.4, 0, 1.5))  # at the wall between kitchen and study
    assert check_regions([*many, edge], [masks()]) is None
    begin = (
        " of 37 reference frames (panoramas of the map) stand outside the region of their place in the floor masks: "
    )
    assert check_regions([*many, stray], [masks()]) == f"1{begin}stray (place kitchen, region study)"
    assert check_regions([*many, lost], [masks()]) == f"1{begin}lost (place kitchen, no region)"
    assert check_regions([*many, door], [masks()]) == f"1{begin}door (doorway, region hall)"
    garden = ReferenceFrame("garden", "garden", pose_2d(-3, 1.4, 0, 1.5))
    assert check_regions([*many, garden], [masks()]) is None


@pytest.mark.parametrize(
    "name", ["house-6", "house-12", *(pytest.param(name, marks=pytest.mark.slow) for name in ("house-42", "house-106"))]
)
def test_buildings_agree_with_their_masks(name):
    """Also shifts by 2 m, and mirrored masks, are refused in all of them."""
    for seed in range(5):
        _, config = configure_dataset(name, None, [{"seed": seed}])
        house = registry().build("dataset", config)
        references = [
            ReferenceFrame(frame.id, frame.place, frame.pose, KINDS[frame.role])
            for frame in house.list_frames()
            if not frame.is_query
        ]
        floors = list(house.list_floors().values())
        assert check_regions(references, floors) is None
        for wrong in (mirrored(floors[0], 0), mirrored(floors[0], 1), moved(floors[0], 2, 0)):
            with pytest.raises(DataError):
                check_regions(references, [wrong])


@pytest.mark.skipif(not (SHARED / "habitat_map").is_dir(), reason="no top-down maps of Matterport3D")
def test_a_real_building_agrees_with_its_masks():
    building = find_dataset("habitat-maps", SHARED)
    references = reference_frames(building)
    assert compare_regions(references, building.floors()).num_compared == 40
    assert check_regions(references, building.floors()) is None
