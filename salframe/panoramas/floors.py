"""Floors as masks seen from above: free floor, obstacles, and the region of each place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations, count
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.arrays import as_array, check_array, check_mask
from salframe.framework.errors import DataError
from salframe.framework.files.array_files import ArrayKind, check_arrays
from salframe.framework.files.reading import read_arrays
from salframe.framework.files.writing import write_arrays
from salframe.framework.validation import Settings
from salframe.panoramas.panorama import labels_by_id

FLOORS = "floors.npz"
"""Name of the file with the floors of a map."""
_FLOOR = {
    "free": ArrayKind("u", (None, None)),
    "obstacle": ArrayKind("u", (None, None)),
    "region": ArrayKind("iu", (None, None)),
    "labels": ArrayKind("i", (None,)),
    "places": ArrayKind("U", (None,)),
    "resolution_m": ArrayKind("f", ()),
    "origin_m": ArrayKind("f", (2,)),
    "z_m": ArrayKind("f", ()),
}
"""Arrays of one floor in floors.npz."""
SAME_FLOOR_M = 0.5
"""Minimum difference in height between two floors. Masks that are closer belong to the same floor."""
MIN_STOREY_GAP_M = 1.5
"""Minimum gap, in metres, between the camera heights of two storeys if there are no frames on the stairs between
them."""
MAX_CAMERA_M = 2.8
"""Maximum height of a camera above its floor. A higher camera is on a storey above."""
MAX_PIXELS = 1 << 28
"""Maximum number of pixels of joined masks."""
MAX_EMPTY_RATIO = 4.0
"""Maximum ratio of the pixels of joined masks to the pixels of their parts. Masks that do not touch are not joined
above this ratio, because the joined masks would be mostly empty, as for two buildings 300 m apart."""


@dataclass(frozen=True, eq=False)
class FloorMasks:
    """The masks of a floor in the world frame, top view. Row 0 is at the maximum y, so that the image reads like a map.

    The upper left corner of the pixel (row, column) is at x = origin_m[0] + column * resolution_m,
    y = origin_m[1] - row * resolution_m.

    Attributes:
        free: (rows, columns) bool, free floor. Pixels of obstacles may be true too. Integers are true where not 0.
        region: (rows, columns) int32, label of the region (the floor area of a place); 0 outside all regions.
        obstacle: (rows, columns) bool, obstacles.
        resolution_m: Side of a pixel in metres.
        origin_m: x and y of the upper left corner of the masks in the world, in metres.
        regions: Region label -> name of the place.
        z_m: Height of the floor in the world. A frame belongs to the highest floor at most MAX_CAMERA_M below it.

    Raises:
        DataError: The masks differ in size, a mask has another dtype, a number is not finite, the resolution is not
            positive, or a region label is no whole number.
    """

    free: np.ndarray
    region: np.ndarray
    obstacle: np.ndarray
    resolution_m: float
    origin_m: tuple[float, float]
    regions: Mapping[int, str]
    z_m: float = 0.0

    def __post_init__(self) -> None:
        shape = check_mask(self, "free").shape
        region = check_array(self, "region", np.int32, None, None)
        for name, mask_shape in (("region", region.shape), ("obstacle", check_mask(self, "obstacle").shape)):
            if mask_shape != shape:
                raise DataError(
                    f"the {name} mask of the floor with z_m = {self.z_m} is {mask_shape[1]} x {mask_shape[0]} pixels, "
                    f"expected {shape[1]} x {shape[0]}, the size of the free mask of this floor"
                )
        if not 0 < self.resolution_m < np.inf:
            raise DataError(
                f"the floor with z_m = {self.z_m} has resolution_m = {self.resolution_m}, expected the metres per "
                "pixel of its masks, a finite number above 0"
            )
        position_m = as_array((*self.origin_m, self.z_m), "the origin of a floor")
        if position_m.shape != (3,) or not np.isfinite(position_m).all():
            raise DataError(
                f"a floor has origin_m = {self.origin_m} and z_m = {self.z_m}, expected finite numbers (x, y) and z"
            )
        object.__setattr__(self, "regions", labels_by_id(self.regions, "FloorMasks.regions"))


class Connection(Settings):
    """Stairs or a lift between two storeys.

    Attributes:
        start: Name of a place, or id of a node of a topological map.
        end: Name of a place or id of a node on another storey.
        kind: "stairs" or "lift".
        length_m: Length in metres that the connection adds to a route.
    """

    start: str
    end: str
    kind: Literal["stairs", "lift"]
    length_m: float = Field(gt=0, allow_inf_nan=False)


def masks_touch(floor: FloorMasks, other: FloorMasks) -> bool:
    """Return whether the rectangles of two masks overlap or are adjacent in plan view.

    The heights of the two floors do not matter.
    """
    (left, bottom, right, top), (other_left, other_bottom, other_right, other_top) = map(_bounds_m, (floor, other))
    gap_m = max(other_left - right, left - other_right, other_bottom - top, bottom - other_top)
    return gap_m <= max(floor.resolution_m, other.resolution_m)


def _bounds_m(floor: FloorMasks) -> tuple[float, float, float, float]:
    """Return the minimum and maximum of x and y: left, bottom, right, top."""
    (left, top), (rows, columns) = floor.origin_m, floor.free.shape
    return left, top - rows * floor.resolution_m, left + columns * floor.resolution_m, top


def _stay_apart(floor: FloorMasks, other: FloorMasks) -> bool:
    """Return whether two masks at one height stay separate, because their joined masks would be mostly empty."""
    bounds = np.array([_bounds_m(floor), _bounds_m(other)])
    joined = np.prod((bounds[:, 2:].max(0) - bounds[:, :2].min(0)) / floor.resolution_m)
    return not masks_touch(floor, other) and bool(joined > MAX_EMPTY_RATIO * (floor.free.size + other.free.size))


def find_floor(floors: Sequence[FloorMasks], xyz_m: Sequence[float] | np.ndarray) -> int | None:
    """Return the index of the floor that a camera or an agent is on, by the rule of `floor_numbers`. None if on none.

    Args:
        floors: Floors, sorted by height.
        xyz_m: Position in the world.
    """
    number = int(floor_numbers(floors, np.reshape(xyz_m, (1, 3)))[0])
    return None if number < 0 else number


def floor_numbers(floors: Sequence[FloorMasks], xyz_m: np.ndarray) -> np.ndarray:
    """Return the index of the floor that each position is on, (N,) int; -1 if it is on none.

    A position belongs to the highest floor that is at most MAX_CAMERA_M below it and whose masks cover it. If there is
    no such floor, it belongs to a floor less than SAME_FLOOR_M above it.

    Args:
        floors: Floors, sorted by height.
        xyz_m: (N, 3) positions in the world.
    """
    numbers = np.full(len(xyz_m), -1)
    for max_sink_m in (SAME_FLOOR_M, 0.0):  # floors below the camera come last and replace the others
        for number, floor in enumerate(floors):
            row, column = floor_pixels(floor, xyz_m[:, :2]).T
            over = (row >= 0) & (row < floor.free.shape[0]) & (column >= 0) & (column < floor.free.shape[1])
            height_m = xyz_m[:, 2] - floor.z_m
            numbers[over & (height_m >= -max_sink_m) & (height_m <= MAX_CAMERA_M)] = number
    return numbers


def floor_pixels(floor: FloorMasks, xy_m: np.ndarray) -> np.ndarray:
    """Return the row and column of positions (N, 2) in the masks of a floor, (N, 2) int; they may be outside."""
    column, row = (np.array([1, -1]) * (xy_m - floor.origin_m) / floor.resolution_m).T
    return np.floor(np.stack([row, column], 1)).astype(int)


def _place_of(floor: FloorMasks) -> str:
    places = [*floor.regions.values()]
    return f"with the place {places[0]!r}" if places else "without places"


def check_heights(floors: Sequence[FloorMasks]) -> None:
    """Check that floors whose masks overlap or adjoin have different heights. Raises DataError."""
    for floor, other in combinations(floors, 2):
        if floor.z_m == other.z_m and masks_touch(floor, other):
            raise DataError(
                f"two floors whose masks overlap or touch have z_m = {floor.z_m:g} (one {_place_of(floor)}, one "
                f"{_place_of(other)}), expected a different z_m for each floor"
            )


class Regions:
    """Lookup of the place at a position: the place of the nearest region, also on walls and sills.

    Attributes:
        places: Names of the places.
    """

    def __init__(self, floors: Sequence[FloorMasks]) -> None:
        from scipy.ndimage import distance_transform_edt

        self._floors = sorted(floors, key=lambda floor: floor.z_m)
        self.places = tuple(dict.fromkeys(place for floor in self._floors for place in floor.regions.values()))
        self._numbers = []
        for floor in self._floors:
            labelled = np.isin(floor.region, list(floor.regions))
            nearest = distance_transform_edt(~labelled, return_distances=False, return_indices=True)
            labels = sorted(floor.regions)
            number = np.array([self.places.index(floor.regions[label]) for label in labels], np.int32)
            numbers = np.full(labelled.shape, -1, np.int32)
            numbers[labelled] = number[np.searchsorted(labels, floor.region[labelled])]
            self._numbers.append(numbers[tuple(nearest)])

    def at(self, xy_m: np.ndarray, camera_z_m: np.ndarray) -> np.ndarray:
        """Return the index in `places` of the place at each position, (N,) int; -1 outside the masks.

        Args:
            xy_m: (N, 2) positions in the world.
            camera_z_m: (N,) heights of the cameras in the world, which select the floors.
        """
        place_numbers = np.full(len(xy_m), -1)
        on_floor = floor_numbers(self._floors, np.column_stack([xy_m, camera_z_m]))
        for number, floor in enumerate(self._floors):
            there = on_floor == number
            row, column = floor_pixels(floor, xy_m[there]).T
            place_numbers[there] = self._numbers[number][row, column]
        return place_numbers


def join_floors(floors: Sequence[FloorMasks], more: Sequence[FloorMasks]) -> tuple[FloorMasks, ...]:
    """Return the union of two sets of floors, those of `floors` first.

    Where both sets have a floor at the same height (within SAME_FLOOR_M), the masks of `more` are laid over the others,
    shifted by half a pixel at most. A region of `more` replaces the region of the same place. Where the masks of `more`
    mark a pixel as free floor, as obstacle or as part of a region, their values replace those of `floors`. Masks of one
    height that are far apart stay separate.

    Raises:
        DataError: The resolutions differ, the joined masks have more than MAX_PIXELS, or `more` covers most of a region
            of another place, so the two sets are not in the same world frame.
    """
    joined, added = list(floors), []
    for floor in more:
        is_same = [abs(other.z_m - floor.z_m) < SAME_FLOOR_M and not _stay_apart(other, floor) for other in joined]
        same = [other for other, belongs in zip(joined, is_same, strict=True) if belongs]
        if not same:
            added.append(floor)
            continue
        position = is_same.index(True)
        joined = [other for other, belongs in zip(joined, is_same, strict=True) if not belongs]
        joined.insert(position, reduce(_lay_over, [*same, floor]))
    return (*joined, *added)


def _lay_over(below: FloorMasks, above: FloorMasks) -> FloorMasks:
    resolution_m = below.resolution_m
    if not np.isclose(above.resolution_m, resolution_m, rtol=1e-6):
        raise DataError(
            f"the new masks of the floor at z = {above.z_m:g} m have a resolution of {above.resolution_m:g} m per "
            f"pixel, expected {resolution_m:g} m as in the map"
        )
    below = _without(below, list(above.regions.values()))
    (left_m, top_m), (above_left_m, above_top_m) = below.origin_m, above.origin_m
    shift = np.round([(top_m - above_top_m) / resolution_m, (above_left_m - left_m) / resolution_m]).astype(int)
    corner = np.minimum(shift, 0)
    rows, columns = (np.maximum(below.region.shape, shift + above.region.shape) - corner).tolist()
    if rows * columns > MAX_PIXELS:
        raise DataError(
            f"the old and the new masks of the floor at z = {above.z_m:g} m are too far apart: the rectangle around "
            f"them has {columns} x {rows} pixels, expected at most {MAX_PIXELS} in total. Are the new masks in the "
            "world frame of the map? If not, convert them"
        )
    above = _spread(_relabel(above, below), shift - corner, (rows, columns))
    below = _spread(below, -corner, (rows, columns))
    labelled = above.region != 0
    for label, place in below.regions.items():
        in_place = below.region == label
        if 2 * (in_place & labelled).sum() > in_place.sum():
            raise DataError(
                f"the new masks of the floor at z = {above.z_m:g} m assign most of the area of {place}, a place of the "
                "map, to other places: use new masks in the world frame of the map, or remove the place from the map "
                "if it no longer exists"
            )
    is_covered = above.free | above.obstacle | labelled
    return replace(
        below,
        free=np.where(is_covered, above.free, below.free),
        region=np.where(labelled, above.region, below.region),
        obstacle=np.where(is_covered, above.obstacle, below.obstacle),
        origin_m=(left_m + float(corner[1]) * resolution_m, top_m - float(corner[0]) * resolution_m),
        regions=dict(sorted({**below.regions, **above.regions}.items())),
    )


def _relabel(floor: FloorMasks, other: FloorMasks) -> FloorMasks:
    """Return a floor with new labels that do not collide with those of another floor.

    New labels with a place differ from all labels of the other floor. New labels without a place differ from the labels
    of the other floor that have a place.
    """
    present = {*floor.regions, *np.unique(floor.region).tolist()} - {0}
    others = {*other.regions, *np.unique(other.region).tolist()}
    new_label = count(max(present | others, default=0) + 1)
    labels = {}
    for label in sorted(present):
        taken = others if label in floor.regions else other.regions
        labels[label] = next(new_label) if label in taken else label
    region = floor.region.copy()
    for label, new in labels.items():
        region[floor.region == label] = new
    return replace(floor, region=region, regions={labels[label]: place for label, place in floor.regions.items()})


def _spread(floor: FloorMasks, at: np.ndarray, shape: tuple[int, int]) -> FloorMasks:
    """Return the masks of a floor, padded to a larger shape. `at` is the (row, column) of their first pixel there."""
    margins = [
        (int(start), int(total - start - size)) for start, total, size in zip(at, shape, floor.free.shape, strict=True)
    ]
    free, region, obstacle = (np.pad(mask, margins) for mask in (floor.free, floor.region, floor.obstacle))
    return replace(floor, free=free, region=region, obstacle=obstacle)


def without_places(floors: Sequence[FloorMasks], places: Collection[str]) -> tuple[FloorMasks, ...]:
    """Return the floors with the regions of some places cleared; floors without another region are removed."""
    return tuple(rest for floor in floors if (rest := _without(floor, places)).region.any())


def _without(floor: FloorMasks, places: Collection[str]) -> FloorMasks:
    rest = ~np.isin(floor.region, [label for label, place in floor.regions.items() if place in places])
    return replace(
        floor,
        free=floor.free & rest,
        obstacle=floor.obstacle & rest,
        region=np.where(rest, floor.region, np.int32(0)),
        regions={label: place for label, place in floor.regions.items() if place not in places},
    )


def write_floors(directory: Path, floors: Sequence[FloorMasks]) -> None:
    """Write floors to floors.npz in a folder, atomically: bool masks as bits, labels in the smallest integer type."""
    parts = [_pack_floor(floor) for floor in floors]
    arrays = {f"{number}/{name}": part for number, floor in enumerate(parts) for name, part in floor.items()}
    write_arrays(directory / FLOORS, {"count": np.array(len(floors)), **arrays})


def read_floors(directory: Path) -> tuple[FloorMasks, ...]:
    """Read the floors that `write_floors` wrote. Raises DataError."""
    path = directory / FLOORS
    arrays = read_arrays(path)
    parts: dict[str, dict[str, np.ndarray]] = {}
    count = arrays.pop("count", np.array(-1))
    for name, array in arrays.items():
        number, _, part = name.partition("/")
        parts.setdefault(number, {})[part] = array
    if count.ndim or count.dtype.kind not in "iu" or list(parts) != [str(number) for number in range(int(count))]:
        raise DataError(
            f"{path} has the floors {', '.join(parts) or 'none'} and count = {count}, expected floors numbered from 0, "
            "and count = the number of floors: build the map again"
        )
    return tuple(_unpack_floor(floor, f"{path}, floor {number}") for number, floor in parts.items())


def _pack_floor(floor: FloorMasks) -> dict[str, np.ndarray]:
    smallest = np.result_type(np.min_scalar_type(floor.region.min()), np.min_scalar_type(floor.region.max()))
    return {
        "free": np.packbits(floor.free, axis=1),
        "obstacle": np.packbits(floor.obstacle, axis=1),
        "region": floor.region.astype(smallest),
        "labels": np.array(list(floor.regions), np.int32),
        "places": np.array(list(floor.regions.values()), np.str_),
        "resolution_m": np.array(floor.resolution_m),
        "origin_m": np.array(floor.origin_m),
        "z_m": np.array(floor.z_m),
    }


def _unpack_floor(parts: Mapping[str, np.ndarray], where: str) -> FloorMasks:
    check_arrays(parts, _FLOOR, where)
    left_m, top_m = parts["origin_m"].tolist()
    height, width = parts["region"].shape
    if any(parts[name].shape != (height, -(-width // 8)) for name in ("free", "obstacle")):
        raise DataError(
            f"{where}: the masks `free`, `obstacle` and `region` have different sizes, expected {width} x {height} "
            "pixels for all: build the map again"
        )
    if len(parts["labels"]) != len(parts["places"]):
        raise DataError(
            f"{where} has {len(parts['labels'])} labels and {len(parts['places'])} places, expected equal numbers: "
            "build the map again"
        )
    return FloorMasks(
        np.unpackbits(parts["free"], axis=1, count=width).astype(bool),
        parts["region"],
        np.unpackbits(parts["obstacle"], axis=1, count=width).astype(bool),
        resolution_m=float(parts["resolution_m"]),
        origin_m=(left_m, top_m),
        regions=dict(zip(parts["labels"].tolist(), parts["places"].tolist(), strict=True)),
        z_m=float(parts["z_m"]),
    )
