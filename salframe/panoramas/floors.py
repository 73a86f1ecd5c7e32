"""Floors seen from above, as masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.array_files import ArrayKind, check_arrays
from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError
from salframe.framework.files import read_arrays, write_arrays

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
    """Which place each position of some floors belongs to: that of the nearest region, walls and sills among them."""

    def __init__(self, floors: Sequence[FloorMasks]) -> None:
        from scipy.ndimage import distance_transform_edt

        self._floors = sorted(floors, key=lambda floor: floor.z_m)
        self._labels = []
        for floor in self._floors:
            labelled = np.isin(floor.region, list(floor.regions))
            nearest = distance_transform_edt(~labelled, return_distances=False, return_indices=True)
            self._labels.append(np.where(labelled.any(), floor.region[tuple(nearest)], 0))

    def at(self, xy_m: np.ndarray, camera_z_m: np.ndarray) -> list[str | None]:
        """The places at positions (N, 2) in the world, on the floors that cameras at these heights (N,) stand on; None
        off the masks."""
        places: list[str | None] = []
        for x, y, z in np.column_stack([xy_m, camera_z_m]).tolist():
            number = find_floor(self._floors, (x, y, z))
            if number is None:
                places.append(None)
                continue
            floor, (left_m, top_m) = self._floors[number], self._floors[number].origin_m
            pixel = int((top_m - y) / floor.resolution_m), int((x - left_m) / floor.resolution_m)
            places.append(floor.regions.get(int(self._labels[number][pixel])))
        return places


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
