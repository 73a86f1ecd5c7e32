"""Floors of two sets of masks, drawn by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks, join_floors, without_places


def floor(
    plan: str, left_m: float = 0.0, top_m: float = 0.0, z_m: float = 0.0, resolution_m: float = 0.5, **names: str
) -> FloorMasks:
    """A letter a pixel: of the region of that name, `.` free floor of none, `#` a wall; capitals are obstacles."""
    rows = np.array([list(row) for row in plan.split()])
    region = np.zeros(rows.shape, np.int32)
    for number, name in enumerate(names, 1):
        region[np.char.lower(rows) == name] = number
    return FloorMasks(
        rows != "#",
        region,
        np.char.isupper(rows),
        resolution_m,
        (left_m, top_m),
        dict(enumerate(names.values(), 1)),
        z_m,
    )


def drawn(masks: FloorMasks) -> list[str]:
    """The plan again, by the first letters of the places."""
    letters = {label: place[0] for label, place in masks.regions.items()}
    return [
        "".join(
            (letters.get(label, ".").upper() if blocked else letters.get(label, ".")) if free else "#"
            for free, blocked, label in zip(*row, strict=True)
        )
        for row in zip(masks.free.tolist(), masks.obstacle.tolist(), masks.region.tolist(), strict=True)
    ]


HALL = floor("hhH.# hhh## #####", h="hall")
"""Its top left corner is at (0, 0), and so it goes to x = 2.5 m and y = -1.5 m."""


def test_a_floor_is_joined_to_the_one_beside_it():
    kitchen = floor("kk kK", left_m=2.1, top_m=0.9, k="kitchen")  # off the pixels of the hall by a fifth of one
    (joined,) = join_floors([HALL], [kitchen])
    assert drawn(joined) == ["####kk", "####kK", "hhH.##", "hhh###", "######"]
    assert joined.origin_m == (0.0, 1.0)
    assert sorted(joined.regions.values()) == ["hall", "kitchen"]
    (turned,) = join_floors([kitchen], [HALL])
    assert drawn(turned) == drawn(joined)
    assert turned.origin_m == pytest.approx((0.1, 0.9))  # on the pixels of the kitchen


def test_what_both_know_is_as_the_second_knows_it():
    smaller = floor("##.k# hh.kk", left_m=0.0, h="hall", k="kitchen")
    (joined,) = join_floors([HALL], [smaller])
    assert drawn(joined) == ["##.k#", "hh.kk", "#####"]


def test_a_floor_joined_to_itself_is_itself():
    (joined,) = join_floors([HALL], [HALL])
    assert (joined.regions, joined.origin_m, joined.z_m) == (HALL.regions, HALL.origin_m, HALL.z_m)
    for name in ("free", "obstacle", "region"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(HALL, name))


def test_floors_at_other_heights_stay_apart():
    above = replace(HALL, z_m=3.0, regions={1: "loft"})
    assert join_floors([HALL], [above]) == (HALL, above)
    (joined,) = join_floors([HALL], [replace(HALL, z_m=0.2)])
    assert joined.z_m == 0.0


def test_labels_of_no_name_are_not_mixed_with_names():
    nameless = replace(HALL, regions={})
    (joined,) = join_floors([nameless], [floor("kk", left_m=2.5, k="kitchen")])
    hall, kitchen = joined.region[0, 0], joined.region[0, 5]
    assert hall != kitchen
    assert joined.regions == {kitchen: "kitchen"}


def test_masks_of_another_frame_are_refused():
    with pytest.raises(
        DataError,
        match="assign most of the area of hall, a place of the map, to other places: use new masks in the world frame",
    ):
        join_floors([HALL], [floor("kkkkk kkkkk", k="kitchen")])
    assert join_floors([HALL], [floor("kkk", k="kitchen")])  # half of it and no more


def test_masks_of_another_resolution_are_refused():
    with pytest.raises(DataError, match=r"a resolution of 0\.1 m per pixel, expected 0\.5 m as in the map"):
        join_floors([HALL], [floor("kk", resolution_m=0.1, k="kitchen")])


def test_masks_far_from_one_another_stay_apart_without_a_mask_of_all():
    kitchen, hall = floor("kk", k="kitchen"), floor("hh", left_m=10_000.0, h="hall")
    assert join_floors([kitchen], [hall]) == (kitchen, hall)


def test_masks_that_touch_are_joined_however_long():
    """A corridor of 1 x 2,000 pixels and a room at its far end, 1 km away."""
    corridor, room = floor("c" * 2000, c="corridor"), floor("rr", left_m=1000.0, r="room")
    (joined,) = join_floors([corridor], [room])
    assert joined.region.shape == (1, 2002)


def test_a_floor_between_two_joins_them():
    """Two rooms 100 m apart, and a corridor that touches both."""
    west, east = floor("w", w="west"), floor("e", left_m=100.0, e="east")
    corridor = floor("c" * 199, left_m=0.5, c="corridor")
    assert join_floors([west], [east]) == (west, east)
    (joined,) = join_floors([west, east], [corridor])
    assert joined.region.shape == (1, 201)
    assert sorted(joined.regions.values()) == ["corridor", "east", "west"]


def test_a_place_goes_with_its_floor():
    (joined,) = join_floors([HALL], [floor("kk kK", left_m=2.0, top_m=-0.5, k="kitchen")])
    assert drawn(joined) == ["hhH.##", "hhh#kk", "####kK"]
    (rest,) = without_places([joined], ["hall"])
    assert drawn(rest) == ["###.##", "####kk", "####kK"]
    assert list(rest.regions.values()) == ["kitchen"]
    assert not rest.obstacle[0].any()
    assert without_places([joined], ["hall", "kitchen"]) == ()


def test_masks_that_were_read_from_images_are_accepted():
    masks = FloorMasks(
        np.where(HALL.free, np.uint8(255), np.uint8(0)),
        HALL.region.astype(np.int64),
        HALL.obstacle.astype(np.uint8),
        0.5,
        (0.0, 0.0),
        {"1": "hall"},
    )
    assert drawn(masks) == drawn(HALL)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"resolution_m": np.inf},
            "z_m = 0.* has resolution_m = inf, expected the metres per pixel of its masks, a finite number above 0",
        ),
        ({"resolution_m": np.nan}, "has resolution_m = nan"),
        ({"origin_m": (0.0, np.nan)}, r"has origin_m = \(0.0, nan\)"),
        ({"origin_m": (0.0, 1.0, 2.0)}, "expected finite numbers"),
        ({"z_m": np.inf}, "z_m = inf"),
        ({"regions": {"hall": 1}}, "FloorMasks.regions has the instance id 'hall', expected a whole number"),
        ({"free": np.ones((3, 5))}, "FloorMasks.free has dtype float64, expected bool"),
    ],
)
def test_floors_with_other_values_are_refused(change, message):
    with pytest.raises(DataError, match=message):
        replace(HALL, **change)
