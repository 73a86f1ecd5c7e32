"""Floors seen from above, as masks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.framework.files.array_files import ArrayKind, check_arrays
from salframe.framework.files.reading import read_arrays
from salframe.framework.files.writing import write_arrays

FLOORS = "floors.npz"
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
"""What floors.npz holds of a floor."""
SAME_FLOOR_M = 0.5
"""Masks whose heights differ by less are of one floor."""
MAX_PIXELS = 1 << 28
"""Larger floors are not joined."""


@dataclass(frozen=True, eq=False)
class FloorMasks:
    """A floor seen from above. Row 0 is at the largest y, so that the picture reads like a map.

    free, region (rows, columns): bool free floor before obstacles, int32 region label (0 outside); obstacle bool. Pixel
    (row, column) covers x = origin_m[0] + column * resolution_m, y = origin_m[1] - row * resolution_m at its upper left
    corner. regions: label -> place. z_m is the floor's height in the world: a frame belongs to the highest floor below
    it. Raises DataError on masks of different sizes.
    """

    free: np.ndarray
    region: np.ndarray
    obstacle: np.ndarray
    resolution_m: float
    origin_m: tuple[float, float]
    regions: Mapping[int, str]
    z_m: float = 0.0

    def __post_init__(self) -> None:
        shape = check_array(self, "free", np.bool_, None, None).shape
        for name, dtype in (("region", np.int32), ("obstacle", np.bool_)):
            got = check_array(self, name, dtype, None, None).shape
            if got != shape:
                raise DataError(
                    f"the {name} mask of a floor is {got[1]} x {got[0]} pixels, "
                    f"expected {shape[1]} x {shape[0]} as its free mask"
                )
        if not self.resolution_m > 0:
            raise DataError(
                f"the masks of a floor have a resolution of {self.resolution_m} m a pixel, expected more than 0"
            )


def find_floor(floors: Sequence[FloorMasks], xyz_m: Sequence[float] | np.ndarray) -> int | None:
    """Which floor, of those sorted by height, a camera or an agent at this position is on: the highest below it whose
    masks it is over."""
    for number in reversed(range(len(floors))):
        floor = floors[number]
        column = (xyz_m[0] - floor.origin_m[0]) / floor.resolution_m
        row = (floor.origin_m[1] - xyz_m[1]) / floor.resolution_m
        over = 0 <= row < floor.free.shape[0] and 0 <= column < floor.free.shape[1]
        if over and (floor.z_m <= xyz_m[2] or len(floors) == 1):
            return number
    return None


class Regions:
    """Which place each position of some floors belongs to: that of the nearest region, walls and sills among them;
    places: their names."""

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
        """(N,) int: the numbers of the places (`places`) at positions (N, 2) in the world, on the floors that cameras
        at these heights (N,) stand on; -1 off the masks."""
        found = np.full(len(xy_m), -1)
        for floor, numbers in zip(self._floors, self._numbers, strict=True):  # the highest last
            column, row = (np.array([1, -1]) * (xy_m - floor.origin_m) / floor.resolution_m).T
            over = (row >= 0) & (row < numbers.shape[0]) & (column >= 0) & (column < numbers.shape[1])
            over &= (floor.z_m <= camera_z_m) | (len(self._floors) == 1)
            found[over] = numbers[row[over].astype(int), column[over].astype(int)]
        return found


def join_floors(floors: Sequence[FloorMasks], more: Sequence[FloorMasks]) -> tuple[FloorMasks, ...]:
    """The floors of a building that two sets of masks show, those of `floors` first.

    Where both show a floor, by its height within SAME_FLOOR_M, `more` lies on top, moved by half a pixel at most:
    regions replace those of their names, and so do pixels that are free, blocked or of a region. Raises DataError on
    masks of different resolutions, and where most of a region would come to lie under others, as it does where two sets
    are not of one world frame.
    """
    joined = list(floors)
    for floor in more:
        same = next((i for i, known in enumerate(floors) if abs(known.z_m - floor.z_m) < SAME_FLOOR_M), None)
        if same is None:
            joined.append(floor)
        else:
            joined[same] = _lay_over(joined[same], floor)
    return tuple(joined)


def _lay_over(below: FloorMasks, above: FloorMasks) -> FloorMasks:
    resolution_m = below.resolution_m
    if not np.isclose(above.resolution_m, resolution_m, rtol=1e-6):
        raise DataError(
            f"masks of the floor at z = {above.z_m:g} m have {above.resolution_m:g} m a pixel, "
            f"expected {resolution_m:g} m as those of the map"
        )
    below = _without(below, list(above.regions.values()))
    (left_m, top_m), (above_left_m, above_top_m) = below.origin_m, above.origin_m
    shift = np.round([(top_m - above_top_m) / resolution_m, (above_left_m - left_m) / resolution_m]).astype(int)
    corner = np.minimum(shift, 0)
    rows, columns = (np.maximum(below.region.shape, shift + above.region.shape) - corner).tolist()
    if rows * columns > MAX_PIXELS:
        raise DataError(
            f"masks of the floor at z = {above.z_m:g} m make one of {columns} x {rows} pixels with those of the map, "
            f"expected at most {MAX_PIXELS}"
        )
    above = _spread(_relabel(above, below), shift - corner, (rows, columns))
    below = _spread(below, -corner, (rows, columns))
    labelled = above.region != 0
    for label, place in below.regions.items():
        here = below.region == label
        if 2 * (here & labelled).sum() > here.sum():
            raise DataError(
                f"masks of the floor at z = {above.z_m:g} m have other regions where most of {place} lies, expected "
                f"masks in the world frame of the map, or {place} removed from it"
            )
    known = above.free | above.obstacle | labelled
    return replace(
        below,
        free=np.where(known, above.free, below.free),
        region=np.where(labelled, above.region, below.region),
        obstacle=np.where(known, above.obstacle, below.obstacle),
        origin_m=(left_m + float(corner[1]) * resolution_m, top_m - float(corner[0]) * resolution_m),
        regions=dict(sorted({**below.regions, **above.regions}.items())),
    )


def _relabel(floor: FloorMasks, other: FloorMasks) -> FloorMasks:
    """A floor whose labels mean nothing else in another: none with a name is a label there, none without has a name."""
    own = {*floor.regions, *np.unique(floor.region).tolist()} - {0}
    others = {*other.regions, *np.unique(other.region).tolist()}
    new_label = count(max(own | others, default=0) + 1)
    labels = {}
    for label in sorted(own):
        taken = others if label in floor.regions else other.regions
        labels[label] = next(new_label) if label in taken else label
    region = floor.region.copy()
    for label, new in labels.items():
        region[floor.region == label] = new
    return replace(floor, region=region, regions={labels[label]: place for label, place in floor.regions.items()})


def _spread(floor: FloorMasks, at: np.ndarray, shape: tuple[int, int]) -> FloorMasks:
    """The masks of a floor in larger ones of this shape, from the pixel `at` on."""
    margins = [
        (int(start), int(total - start - size)) for start, total, size in zip(at, shape, floor.free.shape, strict=True)
    ]
    free, region, obstacle = (np.pad(mask, margins) for mask in (floor.free, floor.region, floor.obstacle))
    return replace(floor, free=free, region=region, obstacle=obstacle)


def without_places(floors: Sequence[FloorMasks], places: Collection[str]) -> tuple[FloorMasks, ...]:
    """The floors without the regions of some places and without what lies in them; those that have no other region are
    left out."""
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
    """Write floors to floors.npz in a folder, atomically; masks of bool as bits, labels in the smallest type."""
    parts = [_pack_floor(floor) for floor in floors]
    arrays = {f"{number}/{name}": part for number, floor in enumerate(parts) for name, part in floor.items()}
    write_arrays(directory / FLOORS, {"count": np.array(len(floors)), **arrays})


def read_floors(directory: Path) -> tuple[FloorMasks, ...]:
    """The floors that `write_floors` wrote. Raises DataError."""
    path = directory / FLOORS
    arrays = read_arrays(path)
    parts: dict[str, dict[str, np.ndarray]] = {}
    count = arrays.pop("count", np.array(-1))
    for name, array in arrays.items():
        number, _, part = name.partition("/")
        parts.setdefault(number, {})[part] = array
    if count.ndim or count.dtype.kind not in "iu" or list(parts) != [str(number) for number in range(int(count))]:
        raise DataError(f"{path} has the floors {', '.join(parts)} and a count of {count}, expected as many from 0")
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
        raise DataError(f"{where}: the masks have other sizes than the regions, expected {width} x {height} pixels")
    if len(parts["labels"]) != len(parts["places"]):
        raise DataError(f"{where}: {len(parts['labels'])} labels and {len(parts['places'])} places, expected as many")
    return FloorMasks(
        np.unpackbits(parts["free"], axis=1, count=width).astype(bool),
        parts["region"],
        np.unpackbits(parts["obstacle"], axis=1, count=width).astype(bool),
        resolution_m=float(parts["resolution_m"]),
        origin_m=(left_m, top_m),
        regions=dict(zip(parts["labels"].tolist(), parts["places"].tolist(), strict=True)),
        z_m=float(parts["z_m"]),
    )
