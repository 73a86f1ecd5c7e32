"""Which place a position belongs to, walls and floors above one another among them."""

import numpy as np

from salframe.panoramas.floors import FloorMasks, Regions, find_floor, read_floors, write_floors


def floor(names, z_m=0.0):
    """Two regions of 1 x 1 m with a wall of 0.4 m between them, from x = 0 to 2.4 m and y = 0 to 1 m."""
    region = np.zeros((10, 24), np.int32)
    region[:, :10], region[:, 14:] = 1, 2
    whole = region > 0
    return FloorMasks(whole, region, ~whole, 0.1, (0.0, 1.0), dict(zip((1, 2), names, strict=True)), z_m)


def places(regions, *xyz_m):
    found = regions.at(np.array(xyz_m)[:, :2], np.array(xyz_m)[:, 2])
    return [regions.places[number] if number >= 0 else None for number in found]


def test_a_wall_belongs_to_the_nearest_region_and_nothing_off_the_masks_does():
    regions = Regions([floor(("a", "b"))])
    asked = [(0.5, 0.5, 1.5), (1.15, 0.5, 1.5), (1.25, 0.5, 1.5), (2.0, 0.9, 1.5), (3.0, 0.5, 1.5), (0.5, -0.2, 1.5)]
    assert places(regions, *asked) == ["a", "a", "b", "b", None, None]


def test_the_floor_is_the_highest_below_the_camera():
    regions = Regions([floor(("c", "d"), z_m=3.0), floor(("a", "b"))])
    assert places(regions, (0.5, 0.5, 1.5), (0.5, 0.5, 4.5)) == ["a", "c"]


def test_floors_read_again_are_the_same(tmp_path):
    floors = [floor(("a", "b")), floor(("c", "d"), z_m=3.0)]
    write_floors(tmp_path, floors)
    for one, other in zip(floors, read_floors(tmp_path), strict=True):
        for name in ("free", "region", "obstacle"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert (one.regions, one.z_m, one.origin_m) == (other.regions, other.z_m, other.origin_m)


def test_a_camera_on_a_storey_without_masks_is_on_no_floor():
    lower, upper = floor(("a", "b")), floor(("c", "d"), z_m=3.0)
    for regions in (Regions([lower]), Regions([lower, floor(("e", "f"), z_m=6.0)])):
        assert places(regions, (0.5, 0.5, 0.2), (0.5, 0.5, 2.5), (0.5, 0.5, 4.5)) == ["a", "a", None]
    assert places(Regions([upper]), (0.5, 0.5, 1.5), (0.5, 0.5, 2.9), (0.5, 0.5, 4.5)) == [None, "c", "c"]
    assert find_floor([lower, upper], (0.5, 0.5, 2.7)) == 0  # below the upper floor by 0.3 m, above the lower one
    assert find_floor([lower], (0.5, 0.5, 4.5)) is find_floor([upper], (0.5, 0.5, 1.5)) is None
