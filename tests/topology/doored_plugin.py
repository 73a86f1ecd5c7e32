"""The rooms of fake_plugin with doors between them, and the same without masks, without frames, on two floors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fake_plugin import Rooms

import salframe


class DooredRooms(Rooms):
    """Rooms in a row, a door of 1 m from each to the next."""

    name = "doored"

    def floors(self):
        (floor,) = super().floors()
        region, free = floor.region.copy(), floor.free.copy()
        for room in range(1, self.config.rooms):
            free[9:14, 20 * room - 1 : 20 * room + 1] = True
        return [replace(floor, free=free, region=region)]


class Maskless(DooredRooms):
    """No masks."""

    name = "maskless"

    def floors(self):
        return []


class Frameless(DooredRooms):
    """No frames."""

    name = "frameless"

    def folds(self):
        return []


class Storeys(DooredRooms):
    """Another floor on top."""

    name = "storeys"

    def floors(self):
        (floor,) = super().floors()
        return [
            floor,
            replace(floor, z_m=3.0, regions={number: f"upper-{name}" for number, name in floor.regions.items()}),
        ]


class Crooked(DooredRooms):
    """A region mask of another size."""

    name = "crooked"

    def floors(self):
        (floor,) = super().floors()
        return [replace(floor, region=np.zeros((3, 4), np.int32))]


@salframe.hookimpl
def salframe_provides():
    return [DooredRooms, Maskless, Frameless, Storeys, Crooked]
