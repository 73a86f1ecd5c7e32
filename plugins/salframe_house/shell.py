"""Mesh of the structure: floors, ceilings, walls with openings, door frames and leaves, windows."""

from __future__ import annotations

import zlib

import numpy as np

from salframe_house import looks
from salframe_house.layout import DOOR_HEIGHT_M, WALL_M, Door, Layout, Room, Window
from salframe_house.mesh import Mesh, MeshBuilder
from salframe_house.scene import Light, Material

_FRAME_M = 0.06
_TRIM_M = 0.012  # projection of door frames and skirting from the wall
_WET = frozenset({"bathroom", "restroom", "kitchen", "laundry-room", "break-room", "linen-room"})
_TILED = frozenset({"bathroom", "restroom"})
_WALLS = {
    "office": ("plaster", ((0.66, 0.66, 0.64), (0.62, 0.63, 0.64), (0.58, 0.60, 0.56), (0.66, 0.62, 0.55))),
    "hotel": ("wallpaper", ((0.62, 0.57, 0.47), (0.55, 0.56, 0.53), (0.50, 0.47, 0.46), (0.62, 0.60, 0.56))),
    "home": ("plaster", ((0.66, 0.64, 0.60), (0.60, 0.58, 0.50), (0.52, 0.57, 0.58), (0.62, 0.55, 0.50))),
}
_FLOORS = {
    "office": (
        ("carpet", ((0.20, 0.21, 0.23), (0.26, 0.24, 0.22), (0.17, 0.20, 0.24))),
        ("laminate", ((0.38, 0.28, 0.18), (0.30, 0.23, 0.16))),
    ),
    "hotel": (
        ("carpet", ((0.26, 0.17, 0.15), (0.22, 0.22, 0.25), (0.30, 0.26, 0.19))),
        ("parquet", ((0.32, 0.21, 0.12), (0.26, 0.17, 0.10))),
    ),
    "home": (
        ("parquet", ((0.38, 0.26, 0.15), (0.30, 0.19, 0.11), (0.45, 0.34, 0.22))),
        ("laminate", ((0.42, 0.34, 0.25), (0.30, 0.23, 0.17))),
    ),
}
_TILES = ((0.55, 0.56, 0.56), (0.46, 0.44, 0.40), (0.36, 0.38, 0.40), (0.60, 0.58, 0.53))


def shell_mesh(layout: Layout, style: str, seed: int) -> Mesh:
    """Return the mesh of the structure (everything except objects) in the world frame."""
    m = MeshBuilder()
    rng = np.random.default_rng((seed, 3))
    trim, pane = Material("plastic", (0.62, 0.62, 0.60)), looks.GLASS
    leaf = looks.wood(rng) if rng.random() < 0.6 else Material("laminate", (0.60, 0.60, 0.58))
    corridor_seed = int(rng.integers(1 << 30))
    for room in layout.rooms:
        # Twins have the same materials, and so do all corridors.
        key = corridor_seed if room.kind == "corridor" else zlib.crc32((room.twin or room.id).encode())
        wall, floor, ceiling = _room_looks(room, style, np.random.default_rng((seed, key)))
        _room(m, room, layout, wall, floor, ceiling, trim)
    for door in layout.doors:
        _door(m, door, trim, leaf)
    for window in layout.windows:
        _window(m, window, trim, pane)
    return m.mesh()


def window_light(window: Window) -> Light:
    """Return the daylight of a window: an area light at its pane, just inside the wall."""
    x, y = np.array(window.centre_m) + np.array(window.inward) * 0.02
    across = np.abs(window.inward[::-1]) * (window.width_m - 0.1)
    height = window.head_m - window.sill_m
    return Light(
        (float(x), float(y), window.sill_m + height / 2),
        (float(across[0]), float(across[1]), 0.0),
        (0.0, 0.0, height - 0.1),
        "window",
        window.room,
    )


def _room_looks(room: Room, style: str, rng: np.random.Generator) -> tuple[Material, Material, Material]:
    """Draw the materials of the wall, floor and ceiling of a room."""

    def pick(texture: str, palette) -> Material:
        return Material(texture, palette[rng.integers(len(palette))], int(rng.integers(looks.VARIANTS)))

    texture, palette = _WALLS[style]
    wall = pick("tile", _TILES) if room.kind in _TILED else pick(texture, palette)
    floor = pick("tile", _TILES) if room.kind in _WET else pick(*_FLOORS[style][int(rng.random() < 0.3)])
    ceiling = Material(
        "ceiling" if style == "office" else "plaster", (0.68, 0.68, 0.67), int(rng.integers(looks.VARIANTS))
    )
    return wall, floor, ceiling


def _room(
    m: MeshBuilder, room: Room, layout: Layout, wall: Material, floor: Material, ceiling: Material, trim: Material
) -> None:
    """Add the floor, ceiling and walls of a room."""
    (x0, y0), (x1, y1), h = room.low_m, room.high_m, room.height_m
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    m.quad(np.column_stack([corners, np.zeros(4)]), floor, corners)
    m.quad(np.column_stack([corners, np.full(4, h)])[::-1], ceiling, corners[::-1])
    doors = [door for door in layout.doors if room.id in door.rooms]
    windows = [window for window in layout.windows if window.room == room.id]
    for side in range(4):  # clockwise, so that quads face the room
        start, end = corners[-side], corners[-side - 1]
        along = (end - start) / np.linalg.norm(end - start)
        openings = [
            (d.centre_m, d.width_m, 0.0, DOOR_HEIGHT_M) for d in doors if _on_wall(d.centre_m, start, along, WALL_M)
        ]
        openings += [
            (w.centre_m, w.width_m, w.sill_m, w.head_m) for w in windows if _on_wall(w.centre_m, start, along, 0.01)
        ]
        _wall(m, start, along, float(np.linalg.norm(end - start)), h, openings, wall, trim)


def _on_wall(point_m: tuple[float, float], start: np.ndarray, along: np.ndarray, tolerance_m: float) -> bool:
    """Return whether a point (x, y) lies on a wall."""
    across = np.array([-along[1], along[0]])
    return bool(abs((np.array(point_m) - start) @ across) < tolerance_m)


def _wall(
    m: MeshBuilder,
    start: np.ndarray,
    along: np.ndarray,
    length: float,
    height: float,
    openings: list[tuple[tuple[float, float], float, float, float]],
    look: Material,
    trim: Material,
) -> None:
    """Add one face of a wall: strips between and around its openings, with skirting where it reaches the floor."""
    spans = sorted(
        (float((np.array(centre) - start) @ along) - width / 2, width, low, high)
        for centre, width, low, high in openings
    )
    offset = float(np.abs(along) @ start)  # world position, so that the pattern differs between rooms

    def patch(s0: float, s1: float, z0: float, z1: float) -> None:
        """Add a rectangular part of the wall, from s0 to s1 along the wall and from z0 to z1 in height (metres)."""
        if s1 - s0 < 1e-6 or z1 - z0 < 1e-6:
            return
        low, high = start + along * s0, start + along * s1
        u0, u1 = s0 + offset, s1 + offset
        m.quad(
            np.array([[*low, z0], [*high, z0], [*high, z1], [*low, z1]]),
            look,
            np.array([[u0, z0], [u1, z0], [u1, z1], [u0, z1]]),
        )

    at = skirting = 0.0
    inward = np.array([along[1], -along[0]])
    for s, width, low, high in (*spans, (length, 0.0, 0.0, height)):
        patch(at, s, 0.0, height)
        patch(s, s + width, 0.0, low)
        patch(s, s + width, high, height)
        at = s + width
        if low == 0.0:
            end = s - _FRAME_M if width else s
            if end - skirting > 0.01:
                ends = np.array([start + along * skirting, start + along * end + inward * _TRIM_M])
                m.box((*ends.min(0), 0.0), (*ends.max(0), 0.07), trim)
            skirting = at + _FRAME_M


def _oriented_box(
    m: MeshBuilder,
    centre: tuple[float, float],
    axis: int,
    along: tuple[float, float],
    across: tuple[float, float],
    z: tuple[float, float],
    look: Material,
) -> None:
    """Add a box.

    Args:
        m: Builder of the mesh.
        centre: Reference point (x, y).
        axis: Axis of `along` (0: x, 1: y).
        along: Range along the axis, relative to `centre`.
        across: Range across the axis, relative to `centre`.
        z: Range of the height.
        look: Material.
    """
    low, high = np.array([0.0, 0.0, z[0]]), np.array([0.0, 0.0, z[1]])
    low[axis], high[axis] = centre[axis] + min(along), centre[axis] + max(along)
    low[1 - axis], high[1 - axis] = centre[1 - axis] + min(across), centre[1 - axis] + max(across)
    m.box(tuple(low), tuple(high), look)


def _door(m: MeshBuilder, door: Door, trim: Material, leaf: Material) -> None:
    """Add the frame, threshold, leaf and handle of a door."""
    axis, half, reach = "xy".index(door.axis), door.width_m / 2, WALL_M / 2 + _TRIM_M
    top = DOOR_HEIGHT_M + _FRAME_M
    for side in (-1, 1):
        _oriented_box(
            m, door.centre_m, axis, (-reach, reach), (side * half, side * (half + _FRAME_M)), (0.0, top), trim
        )
    _oriented_box(m, door.centre_m, axis, (-reach, reach), (-half, half), (DOOR_HEIGHT_M, top), trim)
    _oriented_box(m, door.centre_m, axis, (-WALL_M / 2, WALL_M / 2), (-half, half), (-0.02, 0.0), leaf)
    if door.leaf_room is not None:
        along, across = door.leaf_m
        _oriented_box(m, door.centre_m, axis, along, across, (0.01, DOOR_HEIGHT_M - 0.01), leaf)
        handle = along[1] - np.sign(along[1]) * 0.16, along[1] - np.sign(along[1]) * 0.04
        _oriented_box(
            m, door.centre_m, axis, handle, (across[1], across[1] - door.hinge * 0.04), (1.02, 1.04), looks.CHROME
        )


def _window(m: MeshBuilder, window: Window, trim: Material, pane: Material) -> None:
    """Add the frame, mullion, sill and pane of a window; the reveal extends to the outer side of the wall."""
    axis = 0 if window.inward[0] else 1
    inwards, half, low, high = window.inward[axis], window.width_m / 2, window.sill_m, window.head_m
    depth = (-inwards * 0.10, 0.0)
    for side in (-1, 1):
        _oriented_box(m, window.centre_m, axis, depth, (side * (half - 0.05), side * half), (low, high), trim)
    _oriented_box(m, window.centre_m, axis, depth, (-half + 0.05, half - 0.05), (high - 0.05, high), trim)
    _oriented_box(
        m,
        window.centre_m,
        axis,
        (-inwards * 0.10, inwards * 0.02),
        (-half + 0.05, half - 0.05),
        (low, low + 0.04),
        trim,
    )
    if window.width_m > 1.0:
        _oriented_box(
            m,
            window.centre_m,
            axis,
            (-inwards * 0.09, -inwards * 0.05),
            (-0.025, 0.025),
            (low + 0.04, high - 0.05),
            trim,
        )
    across = np.array([0.0, 0.0])
    across[1 - axis] = half
    centre = np.array(window.centre_m) - np.array(window.inward) * 0.07
    left, right = centre - across, centre + across
    m.quad(np.array([[*left, low], [*right, low], [*right, high], [*left, high]]), pane)
