"""Signs of rooms: a plate beside the door outside, and a poster on a wall inside, with the number of the room."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from salframe.panoramas.panorama import TEXT_PREFIX, split_text
from salframe_house.layout import DOOR_HEIGHT_M, WALL_M, Layout, Room
from salframe_house.mesh import Mesh, MeshBuilder
from salframe_house.placement import PlacedObject
from salframe_house.scene import Material
from salframe_house.textures import image_texture

FIRST_ID, FIRST_CHANGED_ID = 60_000, 62_000
"""First instance ids of signs, and of signs whose text differs from the mapped building. Furniture has smaller ids."""
POSTER_M, PLATE_M = (0.60, 0.30), (0.30, 0.15)
"""Width and height of a poster and of a plate."""
POSTER_BASE_M, PLATE_BASE_M = 1.75, 1.50
"""Height of the lower edge of a poster, above most furniture, and of a plate."""
DEPTH_M, GAP_M = 0.015, 0.004
"""Thickness of a sign, and its distance from the wall."""
MARGIN_M = 0.12
"""Minimum distance of a sign from openings, corners and other objects."""
STEP_M = 0.1
"""Spacing of the positions along a wall that are tried."""
PIXELS = (512, 256)
"""Width and height of the picture of a sign."""


def room_number(index: int) -> str:
    """Return the number of a room as text. A group has 99 rooms: 3.14 is the 14th room of the third group."""
    return f"{1 + index // 99}.{index % 99 + 1:02d}"


def place_signs(layout: Layout, objects: Sequence[PlacedObject], seed: int) -> tuple[PlacedObject, ...]:
    """Return the signs of all rooms, at most two for each, with the labels "text: NUMBER".

    A room has a poster and a plate. The poster is at a random free position of a wall in the room. The plate is on the
    wall outside of the first door, beside the door. A sign without a free position is left out. Twin rooms (rooms with
    the same list of objects) use the same random numbers.
    """
    signs: list[PlacedObject] = []
    for index, room in enumerate(layout.rooms):
        rng = np.random.default_rng((seed, 8, zlib.crc32((room.twin or room.id).encode())))
        inside = _positions(room, POSTER_M, POSTER_BASE_M, layout, [*objects, *signs])
        spots = [inside[rng.integers(len(inside))]] if inside else []
        door = next((door for door in layout.doors if room.id in door.rooms), None)
        if door is not None:
            (outside,) = (other for other in layout.rooms if other.id in door.rooms and other.id != room.id)
            beside = _positions(outside, PLATE_M, PLATE_BASE_M, layout, [*objects, *signs])
            reach_m = door.width_m / 2 + PLATE_M[0] / 2 + MARGIN_M + 2 * STEP_M
            near = [spot for spot in beside if np.hypot(*np.subtract(spot[:2], door.centre_m)) < reach_m + WALL_M]
            spots += [min(near, key=lambda spot: np.hypot(*np.subtract(spot[:2], door.centre_m)))] if near else []
        for x_m, y_m, z_m, yaw_rad, (width_m, height_m), of_room in spots:
            size_m = (DEPTH_M, width_m, height_m)
            label = TEXT_PREFIX + room_number(index)
            signs.append(PlacedObject(FIRST_ID + len(signs), label, of_room, x_m, y_m, z_m, yaw_rad, size_m, seed))
    return tuple(signs)


def change_signs(signs: Sequence[PlacedObject], unreadable: float, wrong: float, seed: int) -> tuple[PlacedObject, ...]:
    """Return the signs after some became unreadable (label "text") and some were replaced by the sign of another room.

    Args:
        signs: The signs of the mapped building.
        unreadable: Probability that a sign is unreadable.
        wrong: Probability that a sign has the number of another room.
        seed: Seed of the changes.
    """
    rng = np.random.default_rng((seed, 9))
    changed = []
    for number, sign in enumerate(signs):
        draw, other = rng.random(), rng.integers(len(signs))
        if draw < unreadable + wrong:
            others = [label for label in dict.fromkeys(s.label for s in signs) if label != sign.label] or [sign.label]
            label = split_text(sign.label)[0] if draw < unreadable else others[other % len(others)]
            sign = replace(sign, instance_id=FIRST_CHANGED_ID + number, label=label)
        changed.append(sign)
    return tuple(changed)


def sign_mesh(sign: PlacedObject) -> Mesh:
    """Return the mesh of a sign in its object frame: a white board with dark letters on its front, the +x side."""
    m, (depth_m, width_m, height_m) = MeshBuilder(), sign.size_m
    x, y = depth_m / 2, width_m / 2
    pixels = sign_picture(split_text(sign.label)[1])
    red, green, blue = ((pixels / 255) ** 2.2).mean((0, 1)).tolist()
    m.box((-x, -y, 0), (x - 1e-3, y, height_m), Material("plastic", (0.62, 0.62, 0.60)))
    front = np.array([[x, -y, 0], [x, y, 0], [x, y, height_m], [x, -y, height_m]])
    m.quad(front, Material(image_texture(pixels[::-1], fills=True), (red, green, blue)))
    return m.mesh()


@lru_cache(maxsize=2048)
def sign_picture(text: str) -> np.ndarray:
    """Return the picture (256, 512, 3) uint8 of a sign. Without a text, it shows smeared letters.

    The font is Aileron (public domain, CC0), which is part of Pillow.
    """
    import cv2
    from PIL import Image, ImageDraw, ImageFont

    width, height = PIXELS
    image = Image.new("RGB", PIXELS, (232, 232, 228))
    size = min(170, int(0.85 * width * 100 / ImageFont.load_default(100).getlength(text or "0.00")))
    ImageDraw.Draw(image).text(
        (width / 2, height / 2), text or "0.00", (25, 28, 35), ImageFont.load_default(size), anchor="mm"
    )
    pixels = np.asarray(image)
    return pixels if text else cv2.GaussianBlur(pixels, (0, 0), 45)


_Spot = tuple[float, float, float, float, tuple[float, float], str]


def _positions(
    room: Room, size_m: tuple[float, float], base_m: float, layout: Layout, objects: Sequence[PlacedObject]
) -> list[_Spot]:
    """Return the free positions of a sign on the walls of a room: x, y, base height, yaw, size, room."""
    low, high = np.array(room.low_m), np.array(room.high_m)
    if base_m + size_m[1] > room.height_m:
        return []
    boxes = [obj.bounds_m for obj in objects if obj.room == room.id]
    boxes += [
        _opening(door.centre_m, door.width_m, 0.0, DOOR_HEIGHT_M) for door in layout.doors if room.id in door.rooms
    ]
    boxes += [_opening(w.centre_m, w.width_m, w.sill_m, w.head_m) for w in layout.windows if w.room == room.id]
    blocked = np.array(boxes).reshape(-1, 2, 3)
    spots: list[_Spot] = []
    for axis in (0, 1):
        for side in (-1, 1):
            wall_m = (low if side < 0 else high)[axis] - side * (GAP_M + DEPTH_M / 2)
            yaw_rad = {(0, -1): 0.0, (0, 1): np.pi, (1, -1): np.pi / 2, (1, 1): -np.pi / 2}[axis, side]
            half_m = size_m[0] / 2 + MARGIN_M
            for along_m in np.arange(low[1 - axis] + half_m, high[1 - axis] - half_m, STEP_M):
                centre = np.zeros(2)
                centre[axis], centre[1 - axis] = wall_m, along_m
                reach = np.array([half_m, half_m])
                reach[axis] = DEPTH_M
                box = np.array([[*(centre - reach), base_m], [*(centre + reach), base_m + size_m[1]]])
                if not ((box[0] < blocked[:, 1]) & (blocked[:, 0] < box[1])).all(1).any():
                    x_m, y_m = (round(float(value), 4) for value in centre)
                    spots.append((x_m, y_m, base_m, round(yaw_rad, 6), size_m, room.id))
    return spots


def _opening(centre_m: tuple[float, float], width_m: float, low_m: float, high_m: float) -> np.ndarray:
    """Return a box (2, 3) around an opening of a wall along either axis."""
    half = np.full(2, width_m / 2)
    return np.array([[*(centre_m - half), low_m], [*(centre_m + half), high_m]])
