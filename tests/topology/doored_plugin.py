"""The rooms of fake_plugin with doors between them, and the same without masks, without frames, on two floors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fake_plugin import Reader, Rooms
from pydantic import Field

import salframe
from salframe.localization.localizer import Localizer
from salframe.panoramas.floors import without_places
from salframe.panoramas.frames import Fold


class DooredRooms(Rooms):
    """Rooms in a row, with a door of 1 m between neighbours."""

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


class HalfMasked(DooredRooms):
    """Masks of the first room only."""

    name = "half-masked"

    def floors(self):
        return without_places(super().floors(), [f"room-{room}" for room in range(1, self.config.rooms)])


class Frameless(DooredRooms):
    """No frames."""

    name = "frameless"

    def folds(self):
        return []


class Storeys(DooredRooms):
    """A second floor above the first."""

    name = "storeys"

    class Config(DooredRooms.Config):
        height_m: float = Field(3.0, description="height of the upper floor above the lower one")

    def floors(self):
        (floor,) = super().floors()
        return [
            floor,
            replace(
                floor,
                z_m=self.config.height_m,
                regions={number: f"upper-{name}" for number, name in floor.regions.items()},
            ),
        ]


class Upstairs(DooredRooms):
    """The floor above: `upper-room-0` and so on."""

    name = "upstairs"

    class Config(DooredRooms.Config):
        z_m: float = Field(3.0, description="how high it lies")
        rename_frames: bool = Field(True, description="call frames `upper-map-0` and so on, not as below")

    def folds(self):
        (fold,) = super().folds()
        return [Fold(fold.id, tuple(map(self._raise, fold.references)), fold.queries)]

    def _raise(self, frame):
        T_world_pano = frame.T_world_pano.copy()
        T_world_pano[2, 3] += self.config.z_m
        id = f"upper-{frame.id}" if self.config.rename_frames else frame.id
        return replace(frame, id=id, place=f"upper-{frame.place}", T_world_pano=T_world_pano)

    def floors(self):
        (floor,) = super().floors()
        regions = {number: f"upper-{name}" for number, name in floor.regions.items()}
        return [replace(floor, z_m=self.config.z_m, regions=regions)]


class Crooked(DooredRooms):
    """A region mask of another size."""

    name = "crooked"

    def floors(self):
        (floor,) = super().floors()
        return [replace(floor, region=np.zeros((3, 4), np.int32))]


class Sharp(Reader):
    """A reader whose descriptions depend on a setting."""

    name = "sharp"
    describe_identity = Localizer.describe_identity

    class Config(Reader.Config):
        sharpness: int = Field(1, description="how sharp it sees")


@salframe.hookimpl
def salframe_provides():
    return [DooredRooms, Maskless, HalfMasked, Frameless, Storeys, Upstairs, Crooked, Sharp]
