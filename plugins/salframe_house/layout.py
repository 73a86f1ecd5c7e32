"""Floor plans: rooms, all rectangles between walls 0.12 m thick, with the doors and windows in these."""

from __future__ import annotations

from dataclasses import dataclass

WALL_M = 0.12
DOOR_HEIGHT_M = 2.05


@dataclass(frozen=True)
class Room:
    """A rectangle from `low_m` to `high_m` (x, y), measured between the wall faces.

    Rooms of one `twin` group hold the same list of objects; `mirror_of` names the room whose furniture this one repeats
    mirrored.
    """

    id: str
    kind: str
    low_m: tuple[float, float]
    high_m: tuple[float, float]
    height_m: float
    twin: str | None = None
    mirror_of: str | None = None

    @property
    def mirrored(self) -> bool:
        return self.mirror_of is not None

    @property
    def size_m(self) -> tuple[float, float]:
        """Extent along x and y."""
        return self.high_m[0] - self.low_m[0], self.high_m[1] - self.low_m[1]

    @property
    def centre_m(self) -> tuple[float, float]:
        return (self.low_m[0] + self.high_m[0]) / 2, (self.low_m[1] + self.high_m[1]) / 2


@dataclass(frozen=True)
class Door:
    """An opening in the wall between two rooms, which one walks through along `axis` ("x" or "y"); rooms[0] lies at the
    smaller coordinate.

    `leaf_room` names the room an open leaf stands in (None: an opening without a leaf); `hinge` is the side, -1 or +1
    across the axis.
    """

    centre_m: tuple[float, float]
    width_m: float
    axis: str
    rooms: tuple[str, str]
    leaf_room: str | None = None
    hinge: int = 1

    @property
    def leaf_m(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where an open leaf stands, seen from the door's centre: along `axis` from hinge to edge, and across it from
        back to face."""
        into, half = (1 if self.leaf_room == self.rooms[1] else -1), self.width_m / 2
        near = WALL_M / 2 + 0.015
        return (into * near, into * (near + self.width_m - 0.04)), (self.hinge * half, self.hinge * (half - 0.04))


@dataclass(frozen=True)
class Window:
    """A window in an outer wall: `inward` is the unit vector from the pane into the room, `centre_m` lies on the wall's
    inner face."""

    centre_m: tuple[float, float]
    width_m: float
    sill_m: float
    head_m: float
    inward: tuple[int, int]
    room: str


@dataclass(frozen=True)
class Layout:
    """The structure of a building."""

    rooms: tuple[Room, ...]
    doors: tuple[Door, ...]
    windows: tuple[Window, ...]
