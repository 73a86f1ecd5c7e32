"""Floor plans: rectangular rooms between walls 0.12 m thick, with doors and windows."""

from __future__ import annotations

from dataclasses import dataclass

WALL_M = 0.12
DOOR_HEIGHT_M = 2.05


@dataclass(frozen=True)
class Room:
    """A rectangular room, measured between the wall faces.

    Attributes:
        id: Unique identifier.
        kind: Kind of room.
        low_m: Corner (x, y) with the smaller coordinates.
        high_m: Corner (x, y) with the larger coordinates.
        height_m: Height of the ceiling.
        twin: Name of the group of rooms with the same list of objects; None if no other room has the same list.
        mirror_of: Id of the room whose furniture is mirrored in this room; None if the room has its own furniture.
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
        """Whether the furniture is the mirror image of the furniture of another room."""
        return self.mirror_of is not None

    @property
    def size_m(self) -> tuple[float, float]:
        """Extent along x and y."""
        return self.high_m[0] - self.low_m[0], self.high_m[1] - self.low_m[1]

    @property
    def centre_m(self) -> tuple[float, float]:
        """Centre (x, y)."""
        return (self.low_m[0] + self.high_m[0]) / 2, (self.low_m[1] + self.high_m[1]) / 2


@dataclass(frozen=True)
class Door:
    """An opening in the wall between two rooms.

    Attributes:
        centre_m: Centre (x, y).
        width_m: Width of the opening.
        axis: Direction of passage, "x" or "y".
        rooms: Ids of the two rooms; rooms[0] lies at the smaller coordinate along `axis`.
        leaf_room: Room in which the open leaf stands; None for an opening without a leaf.
        hinge: Side of the doorway that has the hinge, -1 or +1.
    """

    centre_m: tuple[float, float]
    width_m: float
    axis: str
    rooms: tuple[str, str]
    leaf_room: str | None = None
    hinge: int = 1

    @property
    def leaf_m(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Two ranges in metres that the open leaf covers, relative to the centre of the door.

        The first range is along `axis`, from the hinge to the edge of the leaf. The second range is across `axis`, from
        the back to the face of the leaf.
        """
        into, half = (1 if self.leaf_room == self.rooms[1] else -1), self.width_m / 2
        near = WALL_M / 2 + 0.015
        return (into * near, into * (near + self.width_m - 0.04)), (self.hinge * half, self.hinge * (half - 0.04))


@dataclass(frozen=True)
class Window:
    """A window in an outer wall.

    Attributes:
        centre_m: Centre (x, y), on the inner face of the wall.
        width_m: Width of the window.
        sill_m: Height of the lower edge.
        head_m: Height of the upper edge.
        inward: Unit vector from the pane into the room.
        room: Id of the room.
    """

    centre_m: tuple[float, float]
    width_m: float
    sill_m: float
    head_m: float
    inward: tuple[int, int]
    room: str


@dataclass(frozen=True)
class Layout:
    """Structure of a building: rooms, doors and windows."""

    rooms: tuple[Room, ...]
    doors: tuple[Door, ...]
    windows: tuple[Window, ...]
