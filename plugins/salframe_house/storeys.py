"""Storeys of a building: buildings of successive seeds, one above the other, connected by stairs."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np

from salframe.panoramas.floors import Connection, FloorMasks
from salframe_house.building import Building
from salframe_house.frames import HouseFrame
from salframe_house.layout import Room
from salframe_house.settings import HouseConfig

STOREY_M = 3.0
"""Height of a storey. It is above MAX_CAMERA_M of the floor masks, so that each camera is on its own storey."""
MIN_STAIRS_M = 6.0
"""Minimum length of the stairs between two storeys."""


def storey_configs(config: HouseConfig) -> tuple[HouseConfig, ...]:
    """Return the settings of each storey as a building of one storey, the lowest first."""
    return tuple(
        config.model_copy(update={"seed": config.seed + number, "storeys": 1}) for number in range(config.storeys)
    )


def storey_at(config: HouseConfig, z_m: float) -> int:
    """Return the index of the storey of a camera at this height."""
    return int(np.clip(z_m // STOREY_M, 0, config.storeys - 1))


def name_on(config: HouseConfig, number: int, name: str) -> str:
    """Return the name of a room, doorway or frame of a storey: with the number of the storey if there are several."""
    return name if config.storeys == 1 else f"{number + 1}-{name}"


def raise_frame(config: HouseConfig, number: int, frame: HouseFrame, id: str) -> HouseFrame:
    """Return a frame of a storey as a frame of the whole building."""
    z_m = round(frame.z_m + number * STOREY_M, 4)
    return replace(frame, id=id, place=name_on(config, number, frame.place), z_m=z_m)


def lower_pose(T_world_pano: np.ndarray, number: int) -> np.ndarray:
    """Convert a pose (4, 4) from the frame of the whole building to the frame of the storey `number`.

    Each storey has a frame of its own, as if it were a building of one storey.
    """
    lowered = np.array(T_world_pano)
    lowered[2, 3] -= number * STOREY_M
    return lowered


def raise_masks(config: HouseConfig, number: int, masks: FloorMasks) -> FloorMasks:
    """Return the floor masks of a storey at its height, with the names of its rooms."""
    regions = {label: name_on(config, number, room) for label, room in masks.regions.items()}
    return replace(masks, z_m=number * STOREY_M, regions=regions)


def stairs_between(config: HouseConfig, storeys: list[Building]) -> list[Connection]:
    """Return the stairs between successive storeys. They lead from the room with most doors to that of the next
    storey. Their length is the distance of the centres of these rooms, at least MIN_STAIRS_M."""
    hubs = [_hub(building) for building in storeys]
    centres_m = [
        np.array([*np.mean([room.low_m, room.high_m], axis=0), number * STOREY_M]) for number, room in enumerate(hubs)
    ]
    names = [name_on(config, number, room.id) for number, room in enumerate(hubs)]
    lengths_m = [max(MIN_STAIRS_M, float(np.linalg.norm(end - start))) for start, end in pairwise(centres_m)]
    return [
        Connection(start=start, end=end, kind="stairs", length_m=round(length_m, 2))
        for (start, end), length_m in zip(pairwise(names), lengths_m, strict=True)
    ]


def _hub(building: Building) -> Room:
    """Return the room with most doors, the first of equal ones."""
    doors = Counter(room for door in building.doors for room in door.rooms)
    return max(building.rooms, key=lambda room: doors[room.id])
