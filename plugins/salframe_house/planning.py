"""Generator of floor plans: rows of rooms on both sides of corridors.

Larger buildings have several corridors that branch off a spine. Courtyards separate the wings, so that every room has
an outer wall.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from salframe_house.layout import WALL_M, Door, Layout, Room, Window


@dataclass(frozen=True)
class RoomKind:
    """A kind of room in one style.

    Attributes:
        width_m: Range of the width along the corridor.
        weight: Share among the rooms of the style.
        small_window: Whether the room has a small, high window, as wet rooms do.
    """

    width_m: tuple[float, float]
    weight: float
    small_window: bool = False


ROOM_KINDS: dict[str, dict[str, RoomKind]] = {
    "office": {
        "office": RoomKind((2.8, 3.6), 0.50),
        "meeting-room": RoomKind((3.8, 4.8), 0.14),
        "lounge": RoomKind((3.6, 4.6), 0.07),
        "break-room": RoomKind((3.2, 4.0), 0.08),
        "restroom": RoomKind((2.4, 3.0), 0.07, True),
        "storage": RoomKind((2.4, 3.0), 0.06, True),
        "copy-room": RoomKind((2.6, 3.2), 0.08),
    },
    "hotel": {
        "lobby": RoomKind((4.6, 5.8), 0.15),
        "breakfast-room": RoomKind((4.4, 5.4), 0.25),
        "meeting-room": RoomKind((3.8, 4.8), 0.20),
        "linen-room": RoomKind((2.6, 3.2), 0.20, True),
        "office": RoomKind((2.8, 3.6), 0.20),
    },
    "home": {
        "living-room": RoomKind((4.6, 5.6), 0.14),
        "kitchen": RoomKind((3.4, 4.4), 0.12),
        "bedroom": RoomKind((3.4, 4.4), 0.28),
        "bathroom": RoomKind((2.4, 3.0), 0.16, True),
        "dining-room": RoomKind((3.6, 4.6), 0.10),
        "study": RoomKind((2.8, 3.6), 0.12),
        "laundry-room": RoomKind((2.2, 2.8), 0.08, True),
    },
}
_DEPTH_M = {"office": (4.0, 4.6), "hotel": (4.9, 5.4), "home": (3.8, 4.6)}
_HEIGHT_M = {"office": (2.7, 2.9), "hotel": (2.6, 2.75), "home": (2.45, 2.6)}
_CORRIDOR_M = {"office": (2.0, 2.4), "hotel": (1.9, 2.2), "home": (1.7, 2.0)}
# In homes, adjacent rooms of these kinds share an opening.
_OPEN_PLAN = frozenset({"living-room", "kitchen", "dining-room"})
_TWIN_SHARE = {"office": 0.36, "hotel": 0.36, "home": 0.0}
_ROOMS_PER_WING = 12


@dataclass(frozen=True)
class _Cell:
    """One or several rooms that are placed together in a row of rooms, with their doors and windows.

    Coordinates: u along the corridor from 0 to `width_m`, v away from the corridor from 0 to the depth of the row.

    Attributes:
        width_m: Width along the corridor.
        rooms: (kind, u0, u1, v0, v1) between wall axes.
        doors: (u, v, axis, width, room, other room or -1 for the corridor).
        windows: (u, width, sill, head, room), all in the outer wall.
        leaves: Hinge side of the leaf of each door; 0 for no leaf.
        twins: `Room.twin` of each room.
        copy_of: Index of the cell that this cell repeats; None for an original cell.
        mirrored: Whether the cell is the mirror image of the cell `copy_of`.
    """

    width_m: float
    rooms: tuple[tuple[str, float, float, float, float], ...]
    doors: tuple[tuple[float, float, str, float, int, int], ...]
    windows: tuple[tuple[float, float, float, float, int], ...]
    leaves: tuple[int, ...]
    twins: tuple[str | None, ...]
    copy_of: int | None = None
    mirrored: bool = False


@dataclass
class _LayoutBuilder:
    """A layout under construction."""

    style: str
    height_m: float
    rooms: list[Room] = field(default_factory=list)
    doors: list[Door] = field(default_factory=list)
    windows: list[Window] = field(default_factory=list)

    def add_room(
        self,
        kind: str,
        corner_a: tuple[float, float],
        corner_b: tuple[float, float],
        twin: str | None = None,
        mirror_of: str | None = None,
    ) -> str:
        """Add a rectangular room and return its id.

        The centre lines of its walls form a rectangle, with the opposite corners `corner_a` and `corner_b`. `kind`,
        `twin` and `mirror_of` are described in `Room`.
        """
        (ax, ay), (bx, by) = corner_a, corner_b
        low = min(ax, bx) + WALL_M / 2, min(ay, by) + WALL_M / 2
        high = max(ax, bx) - WALL_M / 2, max(ay, by) - WALL_M / 2
        number = sum(room.kind == kind for room in self.rooms) + 1
        self.rooms.append(Room(f"{kind}-{number:02d}", kind, low, high, self.height_m, twin, mirror_of))
        return self.rooms[-1].id

    def add_door(
        self,
        centre: tuple[float, float],
        width: float,
        axis: str,
        first: str,
        second: str,
        leaf_room: str | None = None,
        hinge: int = 1,
    ) -> None:
        """Add a door between two rooms, sorted by their coordinates."""
        rooms_by_id = {room.id: room for room in self.rooms}
        along = "xy".index(axis)
        rooms = sorted((first, second), key=lambda name: rooms_by_id[name].centre_m[along])
        self.doors.append(Door(centre, width, axis, (rooms[0], rooms[1]), leaf_room, hinge))


def plan_layout(style: str, rooms: int, seed: int) -> Layout:
    """Generate the floor plan of a building with exactly `rooms` rooms, including corridors.

    Small buildings have a single corridor. Buildings of 18 or more rooms have wings of about 12 rooms on both sides of
    a spine.
    """
    rng = np.random.default_rng((seed, rooms, 1))
    builder = _LayoutBuilder(style, round(rng.uniform(*_HEIGHT_M[style]), 2))
    depth, corridor = round(rng.uniform(*_DEPTH_M[style]), 2), round(rng.uniform(*_CORRIDOR_M[style]), 2)
    wings = max(1, round(rooms / _ROOMS_PER_WING))
    levels = math.ceil(wings / 2) if wings > 1 else 0
    cells = _draw_cells(style, rooms - wings - levels, math.ceil(_TWIN_SHARE[style] * rooms), depth, rng)
    wing_cells = _distribute(cells, 2 * wings, rng)
    pitch = corridor + 2 * depth + round(rng.uniform(4.0, 6.0), 2)
    lengths = [max(sum(cells[i].width_m for i in row) for row in wing_cells[2 * w : 2 * w + 2]) for w in range(wings)]
    corridors = [_add_wing(builder, w, lengths[w], corridor, pitch, wings > 1) for w in range(wings)]
    if levels:
        _add_spine(builder, corridors, corridor, depth, pitch)
    room_ids: dict[int, tuple[str, ...]] = {}
    order = [(w, row) for w in range(wings) for row in (0, 1)]
    for copies in (False, True):  # originals first: copies refer to the rooms that they repeat
        for w, row in order:
            origin = _wing_origin(w, corridor, pitch, wings > 1)
            _add_row(builder, cells, wing_cells[2 * w + row], copies, room_ids, corridors[w], origin, row, depth)
    return Layout(tuple(builder.rooms), tuple(builder.doors), tuple(builder.windows))


def _wing_origin(wing: int, corridor: float, pitch: float, spine: bool) -> tuple[float, float, int, float]:
    """Return the origin of a wing.

    Returns:
        x of its first wall axis, y of the middle of its corridor, direction along x, width of the corridor.
    """
    return (
        (corridor / 2 * (1 if wing % 2 == 0 else -1) if spine else 0.0),
        wing // 2 * pitch,
        1 if wing % 2 == 0 else -1,
        corridor,
    )


def _add_wing(builder: _LayoutBuilder, wing: int, length: float, corridor: float, pitch: float, spine: bool) -> str:
    """Add the corridor of a wing, with windows at its free ends; return its id."""
    x, y, direction, _ = _wing_origin(wing, corridor, pitch, spine)
    name = builder.add_room("corridor", (x, y - corridor / 2), (x + direction * length, y + corridor / 2))
    room = builder.rooms[-1]
    ends = [room.high_m[0] if direction > 0 else room.low_m[0]] if spine else [room.low_m[0], room.high_m[0]]
    for end in ends:
        inward = 1 if end == room.low_m[0] else -1
        builder.windows.append(Window((end, y), min(1.2, corridor - 0.7), 0.9, 2.2, (inward, 0), name))
    return name


def _add_spine(builder: _LayoutBuilder, wings: list[str], corridor: float, depth: float, pitch: float) -> None:
    """Add one corridor per level, joined end to end, with openings to the wings and windows to the courtyards."""
    half, levels = corridor / 2, math.ceil(len(wings) / 2)
    bounds = (
        [-half - depth] + [(level + 0.5) * pitch for level in range(levels - 1)] + [(levels - 1) * pitch + half + depth]
    )
    opening = round(corridor - 0.5, 2)
    names = []
    for level in range(levels):
        names.append(builder.add_room("corridor", (-half, bounds[level]), (half, bounds[level + 1])))
        if level:
            builder.add_door((0.0, bounds[level]), opening, "y", names[-2], names[-1])
        for wing in range(2 * level, min(2 * level + 2, len(wings))):
            side = 1 if wing % 2 == 0 else -1
            builder.add_door((side * half, level * pitch), opening, "x", names[-1], wings[wing])
        for y, courtyard in ((bounds[level] + 1.2, level > 0), (bounds[level + 1] - 1.2, level < levels - 1)):
            for side in (-1, 1) if courtyard else ():
                builder.windows.append(Window((side * (half - WALL_M / 2), y), 1.4, 0.9, 2.2, (-side, 0), names[-1]))
    for y, name, inward in ((bounds[0] + WALL_M / 2, names[0], 1), (bounds[-1] - WALL_M / 2, names[-1], -1)):
        builder.windows.append(Window((0.0, y), round(corridor - 0.8, 2), 0.9, 2.2, (0, inward), name))


def _add_row(
    builder: _LayoutBuilder,
    cells: list[_Cell],
    row_cells: list[int],
    copies: bool,
    room_ids: dict[int, tuple[str, ...]],
    corridor_id: str,
    origin: tuple[float, float, int, float],
    row: int,
    depth: float,
) -> None:
    """Add cells of a row (0 above the corridor, 1 below): the copies if `copies` is true, otherwise the originals."""
    x, y, direction, corridor = origin
    up = 1 if row == 0 else -1
    base = y + up * corridor / 2
    previous: str | None = None
    for index in row_cells:
        cell = cells[index]
        left = x if direction > 0 else x - cell.width_m
        x += direction * cell.width_m
        if (cell.copy_of is not None) != copies:
            continue
        # The lower row is the upper one rotated by 180 deg, so that cells that are not mirrored remain congruent.
        flip = (up < 0) != cell.mirrored

        def world(u: float, v: float, left=left, flip=flip, width=cell.width_m) -> tuple[float, float]:
            """Convert cell coordinates to world coordinates."""
            return round(left + (width - u if flip else u), 4), round(base + up * v, 4)

        originals: Sequence[str | None] = (None,) * len(cell.rooms)
        if cell.mirrored and cell.copy_of is not None:
            originals = room_ids[cell.copy_of]
        names = tuple(
            builder.add_room(kind, world(u0, v0), world(u1, v1), twin, original)
            for (kind, u0, u1, v0, v1), twin, original in zip(cell.rooms, cell.twins, originals, strict=True)
        )
        room_ids[index] = names
        for (u, v, axis, width, room, other), leaf in zip(cell.doors, cell.leaves, strict=True):
            hinge = leaf * (-1 if axis == "v" and flip else 1) * (up if axis == "u" else 1)
            builder.add_door(
                world(u, v),
                width,
                "x" if axis == "u" else "y",
                names[room],
                names[other] if other >= 0 else corridor_id,
                names[room] if leaf else None,
                hinge or 1,
            )
        for u, width, sill, head, room in cell.windows:
            builder.windows.append(Window(world(u, depth - WALL_M / 2), width, sill, head, (0, -up), names[room]))
        if builder.style == "home" and previous and {cell.rooms[0][0], previous.rsplit("-", 1)[0]} <= _OPEN_PLAN:
            edge = left if direction > 0 else left + cell.width_m
            builder.add_door((round(edge, 4), round(base + up * depth * 0.55, 4)), 1.2, "x", names[0], previous)
        previous = names[0]


def _distribute(cells: list[_Cell], rows: int, rng: np.random.Generator) -> list[list[int]]:
    """Distribute the cells in random order over the rows, each to the row that is shortest so far."""
    row_cells: list[list[int]] = [[] for _ in range(rows)]
    length = np.zeros(rows)
    for index in rng.permutation(len(cells)):
        row = int(np.argmin(length))
        row_cells[row].append(int(index))
        length[row] += cells[index].width_m
    return row_cells


def _draw_cells(style: str, rooms: int, twins: int, depth: float, rng: np.random.Generator) -> list[_Cell]:
    """Draw cells with `rooms` rooms in total, of which about `twins` are twins."""
    kinds = ROOM_KINDS[style]
    cells: list[_Cell] = []
    num_singles = rooms
    if style == "hotel":
        for _ in range(max(1, round(0.82 * rooms / 4)) if rooms >= 4 else 0):
            cells.append(_suite_cell(depth, rng))
            num_singles -= 4
    start = len(cells)
    cells += [_single_cell(kind, kinds[kind], depth, rng) for kind in _draw_kinds(style, num_singles, rng)]
    return _make_twins(cells, start, twins, rng)


def _draw_kinds(style: str, count: int, rng: np.random.Generator) -> list[str]:
    """Draw room kinds by their shares (largest remainder method), each share multiplied by a random factor."""
    kinds = ROOM_KINDS[style]
    share = np.array([kind.weight for kind in kinds.values()]) * rng.uniform(0.8, 1.2, len(kinds))
    share *= count / share.sum()
    number = np.floor(share).astype(int)
    for index in np.argsort(number - share, kind="stable")[: count - number.sum()]:
        number[index] += 1
    return [name for name, times in zip(kinds, number, strict=True) for _ in range(times)]


def _door_u(width: float, rng: np.random.Generator) -> float:
    """Draw the position of a door: near one end of the wall, far enough from it for a wardrobe."""
    near = rng.uniform(0.68, 0.85)
    return round(float(near if rng.random() < 0.5 else width - near), 3)


def _single_cell(kind: str, spec: RoomKind, depth: float, rng: np.random.Generator) -> _Cell:
    """Draw a cell of one room."""
    width = round(rng.uniform(*spec.width_m), 2)
    door = (_door_u(width, rng), 0.0, "v", 0.9, 0, -1)
    leaf = int(rng.choice((-1, 0, 0, 1)))
    windows: tuple[tuple[float, float, float, float, int], ...]
    if spec.small_window:
        windows = ((round(width * rng.uniform(0.4, 0.6), 3), 0.8, 1.5, 2.15, 0),)
    elif width > 3.7:
        pane = round(rng.uniform(1.1, 1.5), 2)
        windows = tuple((round(width * at, 3), pane, 0.9, 2.2, 0) for at in (0.28, 0.72))
    else:
        windows = ((round(width * rng.uniform(0.45, 0.55), 3), round(rng.uniform(1.3, 1.8), 2), 0.9, 2.2, 0),)
    return _Cell(width, ((kind, 0.0, width, 0.0, depth),), (door,), windows, (leaf,), (None,))


def _suite_cell(depth: float, rng: np.random.Generator) -> _Cell:
    """Draw a cell of two hotel rooms with two bathrooms back to back between them."""
    width_a, width_b, bath = (round(rng.uniform(low, high), 2) for low, high in ((3.5, 4.1), (3.5, 4.1), (2.4, 2.8)))
    end, middle = width_a + bath, depth / 2
    rooms = (
        ("hotel-room", 0.0, width_a, 0.0, depth),
        ("bathroom", width_a, end, 0.0, middle),
        ("bathroom", width_a, end, middle, depth),
        ("hotel-room", end, end + width_b, 0.0, depth),
    )
    doors = (
        (0.75, 0.0, "v", 0.9, 0, -1),
        (end + width_b - 0.75, 0.0, "v", 0.9, 3, -1),
        (width_a, round(rng.uniform(0.7, middle - 0.7), 3), "u", 0.85, 1, 0),
        (end, round(rng.uniform(middle + 0.7, depth - 0.7), 3), "u", 0.85, 2, 3),
    )
    windows = (
        (width_a / 2, round(rng.uniform(1.4, 1.8), 2), 0.8, 2.2, 0),
        (width_a + bath / 2, 0.7, 1.5, 2.15, 2),
        (end + width_b / 2, round(rng.uniform(1.4, 1.8), 2), 0.8, 2.2, 3),
    )
    return _Cell(
        end + width_b, rooms, doors, windows, (int(rng.choice((0, -1))), int(rng.choice((0, 1))), 0, 0), (None,) * 4
    )


def _make_twins(cells: list[_Cell], start: int, num_twins: int, rng: np.random.Generator) -> list[_Cell]:
    """Replace cells by copies of other cells until `num_twins` rooms are twins. About 40 % of the copies are mirrored.

    Cells before `start` are hotel suites, and only suites are copied to suites. If there is only one suite, its two
    rooms become twins, and so do its two bathrooms.
    """
    cells = list(cells)
    num_made, group = 0, 0
    by_kind: dict[str, list[int]] = {}
    for index in rng.permutation(len(cells)):
        by_kind.setdefault(cells[index].rooms[0][0], []).append(int(index))
    while num_made < num_twins:
        choices = [kind for kind, indices in sorted(by_kind.items()) if len(indices) >= 2]
        if not choices:
            break
        weights = np.array([len(by_kind[kind]) * len(cells[by_kind[kind][0]].rooms) for kind in choices], float)
        indices = by_kind[choices[rng.choice(len(choices), p=weights / weights.sum())]]
        original = indices.pop()
        names = tuple(f"twins-{group + i + 1:02d}" for i in range(len(cells[original].rooms)))
        group += len(names)
        cells[original] = replace(cells[original], twins=names)
        cells[indices.pop()] = replace(cells[original], copy_of=original, mirrored=bool(rng.random() < 0.4))
        num_made += 2 * len(names)
    if num_made < num_twins and start == 1:
        cells[0] = replace(cells[0], twins=("twins-01", "twins-02", "twins-02", "twins-01"))
    return cells
