"""Cupboards, shelves and other storage furniture."""

from __future__ import annotations

import numpy as np

from salframe_house import looks
from salframe_house.furniture_seating import legs
from salframe_house.mesh import MeshBuilder
from salframe_house.object_class import Size, furniture
from salframe_house.scene import Material

FRONT_M = 0.02  # thickness of doors and drawers


def carcass(m: MeshBuilder, size: Size, low: float, high: float, body: Material) -> None:
    """Add the closed body of a cupboard between two heights, behind its fronts."""
    m.box((-size[0] / 2, -size[1] / 2, low), (size[0] / 2 - FRONT_M - 0.01, size[1] / 2, high), body)


def fronts(
    m: MeshBuilder, size: Size, low: float, high: float, columns: int, rows: int, front: Material, handle: Material
) -> None:
    """Add a grid of doors or drawers with handles on the +x side."""
    x, width, height = size[0] / 2 - 0.01, size[1] / columns, (high - low) / rows
    for column in range(columns):
        y = -size[1] / 2 + column * width
        for row in range(rows):
            z = low + row * height
            m.box((x - FRONT_M, y + 0.005, z + 0.005), (x, y + width - 0.005, z + height - 0.005), front)
            if height < width * 1.2:
                m.box(
                    (x, y + width / 2 - 0.05, z + height * 0.7),
                    (x + 0.01, y + width / 2 + 0.05, z + height * 0.7 + 0.015),
                    handle,
                )
            else:
                side = y + (width - 0.06 if column % 2 == 0 else 0.045)
                m.box((x, side, z + height * 0.45), (x + 0.01, side + 0.015, z + height * 0.45 + 0.12), handle)


def _shelves(
    m: MeshBuilder, size: Size, boards: int, body: Material, thickness: float = 0.025, back: bool = True
) -> list[float]:
    """Add sides, back and boards; return the heights of the upper faces of the boards."""
    x, y = size[0] / 2, size[1] / 2
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - thickness)))
        m.box((-x, low, 0), (x, high, size[2]), body)
    if back:
        m.box((-x, -y + thickness, 0), (-x + 0.01, y - thickness, size[2]), body)
    heights = np.linspace(0.08, size[2] - thickness, boards)
    for z in heights:
        m.box((-x + 0.01, -y + thickness, z), (x, y - thickness, z + thickness), body)
    return [float(z + thickness) for z in heights]


@furniture("bookshelf", (0.28, 0.70, 1.50), (0.36, 1.10, 2.10), "wall", front_m=0.4)
def bookshelf(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Shelves with rows of books of different heights and lengths."""
    tops = _shelves(m, size, int(rng.integers(4, 6)), looks.board(rng))
    gap = tops[1] - tops[0]
    for z in tops[:-1]:
        start, end = -size[1] / 2 + 0.03, size[1] / 2 - 0.03
        for length in rng.uniform(0.25, 0.55, 2) * (end - start):
            if rng.random() < 0.85:
                front, top = size[0] / 2 - rng.uniform(0.03, 0.08), z + gap * rng.uniform(0.55, 0.85)
                m.box((-size[0] / 2 + 0.02, start, z), (front, start + length, top), looks.books(rng))
            start += length * 0.85 + 0.02
            if start + 0.5 * (end + size[1] / 2) > end:
                break


@furniture("storage shelf", (0.40, 0.90, 1.60), (0.50, 1.40, 2.00), "wall", front_m=0.4)
def storage_shelf(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A metal rack with cartons."""
    frame, carton = looks.metal(rng), Material("paper", (0.45, 0.34, 0.22), int(rng.integers(looks.VARIANTS)))
    legs(m, size, size[2], 0.035, frame)
    x, y = size[0] / 2, size[1] / 2
    for z in np.linspace(0.12, size[2] - 0.03, 4):
        m.box((-x + 0.005, -y + 0.005, z), (x - 0.005, y - 0.005, z + 0.025), frame)
        start = -y + 0.04
        while z < size[2] - 0.4 and start < y - 0.3:
            width = min(rng.uniform(0.2, 0.4), y - 0.04 - start)
            if rng.random() < 0.75:
                m.box((-x + 0.04, start, z + 0.025), (x - 0.05, start + width, z + rng.uniform(0.18, 0.38)), carton)
            start += width + 0.03


@furniture("cabinet", (0.38, 0.80, 0.75), (0.48, 1.40, 1.20), "wall", front_m=0.4)
def cabinet(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A sideboard with doors."""
    body = looks.board(rng)
    carcass(m, size, 0.08, size[2] - 0.025, body)
    legs(m, size, 0.08, 0.05, body, 0.02)
    m.box((-size[0] / 2, -size[1] / 2, size[2] - 0.025), (size[0] / 2, size[1] / 2, size[2]), body)
    fronts(
        m,
        size,
        0.08,
        size[2] - 0.025,
        2 if size[1] < 1.1 else 3,
        1,
        looks.board(rng) if rng.random() < 0.4 else body,
        looks.metal(rng),
    )


@furniture("file cabinet", (0.48, 0.42, 0.70), (0.62, 0.50, 1.35), "wall", front_m=0.4)
def file_cabinet(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A steel cabinet of drawers."""
    body = looks.paint(rng)
    carcass(m, size, 0.0, size[2], body)
    fronts(m, size, 0.03, size[2], 1, 2 if size[2] < 0.85 else 3 if size[2] < 1.1 else 4, body, looks.STEEL)


@furniture("wardrobe", (0.55, 1.00, 1.90), (0.65, 1.60, 2.15), "wall", front_m=0.5)
def wardrobe(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A tall cupboard for clothes; a door may be a mirror."""
    body = looks.board(rng)
    carcass(m, size, 0.0, size[2], body)
    fronts(
        m,
        size,
        0.06,
        size[2] - 0.02,
        2 if size[1] < 1.3 else 3,
        1,
        body if rng.random() < 0.7 else looks.board(rng),
        looks.metal(rng),
    )


@furniture("locker", (0.40, 0.60, 1.70), (0.50, 1.20, 1.95), "wall", front_m=0.4)
def locker(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Narrow steel doors in two rows."""
    body = looks.paint(rng)
    carcass(m, size, 0.0, size[2], body)
    fronts(m, size, 0.08, size[2] - 0.02, max(2, round(size[1] / 0.3)), 2, looks.paint(rng), looks.STEEL)


@furniture("dresser", (0.42, 0.80, 0.75), (0.52, 1.30, 0.95), "wall", front_m=0.4)
def dresser(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A chest of drawers."""
    body = looks.wood(rng)
    carcass(m, size, 0.07, size[2] - 0.03, body)
    legs(m, size, 0.07, 0.05, body)
    m.box((-size[0] / 2, -size[1] / 2, size[2] - 0.03), (size[0] / 2, size[1] / 2, size[2]), body)
    fronts(m, size, 0.07, size[2] - 0.03, 2, 3, body, looks.metal(rng))


@furniture("nightstand", (0.36, 0.40, 0.45), (0.46, 0.52, 0.60), "beside", ("bed",))
def nightstand(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A bedside cupboard with drawers."""
    body = looks.wood(rng)
    carcass(m, size, 0.10, size[2] - 0.025, body)
    legs(m, size, 0.10, 0.04, body, 0.01)
    m.box((-size[0] / 2, -size[1] / 2, size[2] - 0.025), (size[0] / 2, size[1] / 2, size[2]), body)
    fronts(m, size, 0.10, size[2] - 0.025, 1, 2, body, looks.metal(rng))


@furniture("tv stand", (0.38, 1.10, 0.42), (0.48, 1.70, 0.58), "wall", front_m=0.4)
def tv_stand(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A low board, doors at the sides and an open bay."""
    body, x, y, h = looks.board(rng), size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0.06), (x, y, 0.09), body)
    m.box((-x, -y, h - 0.03), (x, y, h), body)
    m.box((-x, -y, 0.09), (-x + 0.015, y, h - 0.03), body)
    legs(m, size, 0.06, 0.05, body, 0.03)
    third = size[1] / 3
    for low in (-y, y - third):
        m.box((-x + 0.015, low, 0.09), (x - 0.01, low + third, h - 0.03), body)
    m.box((-x + 0.05, -third * 0.35, 0.09), (x - 0.08, third * 0.35, 0.15), looks.BLACK)


@furniture("shoe rack", (0.28, 0.60, 0.50), (0.36, 0.90, 0.90), "wall")
def shoe_rack(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Open boards with a few shoes."""
    tops = _shelves(m, size, 3, looks.wood(rng), back=False)
    shoe = looks.plastic(rng)
    for z in tops[:-1]:
        for y in np.arange(-size[1] / 2 + 0.10, size[1] / 2 - 0.12, 0.16):
            if rng.random() < 0.6:
                m.cushion((-0.11, y - 0.045, z), (0.13, y + 0.045, z + 0.08), shoe, 0.03)


@furniture("luggage rack", (0.45, 0.60, 0.42), (0.52, 0.75, 0.52), "wall")
def luggage_rack(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A folding stand, often with a suitcase."""
    frame, x, y = looks.wood(rng), size[0] / 2, size[1] / 2
    case = rng.random() < 0.6
    top = size[2] - (0.22 if case else 0.0)
    legs(m, size, top, 0.03, frame)
    for cx in np.linspace(-x + 0.04, x - 0.04, 4):
        m.box((cx - 0.02, -y + 0.03, top - 0.02), (cx + 0.02, y - 0.03, top), frame)
    if case:
        m.cushion((-x + 0.05, -y + 0.06, top), (x - 0.05, y - 0.06, size[2]), looks.plastic(rng), 0.04)


@furniture("coat rack", (0.42, 0.42, 1.65), (0.52, 0.52, 1.85), "corner")
def coat_rack(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A pole on a foot with hooks and a coat."""
    frame, r = looks.wood(rng) if rng.random() < 0.5 else looks.metal(rng), size[0] / 2
    m.cylinder((0, 0, 0), (r * 0.75, size[1] * 0.37), 0.03, frame, segments=12)
    m.cylinder((0, 0, 0.03), 0.02, size[2] - 0.03, frame, segments=8)
    m.box((-r, -0.01, size[2] - 0.16), (r, 0.01, size[2] - 0.13), frame)
    m.box((-0.01, -size[1] / 2, size[2] - 0.20), (0.01, size[1] / 2, size[2] - 0.17), frame)
    if rng.random() < 0.6:
        coat = looks.fabric(rng)
        outline = np.array([[0.03, -0.05], [r - 0.02, -0.12], [r - 0.02, 0.12], [0.03, 0.05]])
        m.loft([(outline, 0.72), (outline * (0.8, 0.9), size[2] - 0.2)], coat)


@furniture("box", (0.30, 0.35, 0.25), (0.45, 0.55, 0.42), "corner")
def carton(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A carton with tape."""
    look = Material("paper", (0.45, 0.34, 0.22), int(rng.integers(looks.VARIANTS)))
    m.box((-size[0] / 2, -size[1] / 2, 0), (size[0] / 2, size[1] / 2, size[2] - 0.002), look)
    m.box((-0.03, -size[1] / 2, size[2] - 0.002), (0.03, size[1] / 2, size[2]), looks.PAPER)


@furniture("laundry basket", (0.34, 0.38, 0.50), (0.44, 0.52, 0.64), "corner")
def laundry_basket(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A woven hamper with a lid."""
    look = Material("fabric", (0.48, 0.38, 0.26), int(rng.integers(looks.VARIANTS)))
    m.cylinder(
        (0, 0, 0),
        (size[0] * 0.42, size[1] * 0.42),
        size[2] - 0.04,
        look,
        top_radius=(size[0] * 0.49, size[1] * 0.49),
        segments=14,
    )
    m.cylinder((0, 0, size[2] - 0.04), (size[0] / 2, size[1] / 2), 0.04, looks.linen(rng), segments=14)


@furniture("wall shelf", (0.18, 0.60, 0.24), (0.26, 1.10, 0.34), "hung", base_m=(1.45, 1.6))
def wall_shelf(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A board on brackets with books and a pot."""
    body, x, y = looks.wood(rng), size[0] / 2, size[1] / 2
    m.box((-x, -y, 0.04), (x, y, 0.07), body)
    for side in (-1, 1):
        m.box((-x, side * y * 0.7 - 0.015, 0.0), (x * 0.6, side * y * 0.7 + 0.015, 0.04), looks.STEEL)
    m.box(
        (-x + 0.02, -y + 0.05, 0.07), (x - 0.04, -y + 0.05 + size[1] * rng.uniform(0.3, 0.5), size[2]), looks.books(rng)
    )
    m.cylinder((0, y - 0.15, 0.07), 0.04, 0.12, looks.plastic(rng), top_radius=0.055, segments=10)


@furniture("housekeeping cart", (0.50, 0.90, 0.95), (0.58, 1.15, 1.10), "wall")
def housekeeping_cart(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A trolley with boards, linen and a sack."""
    frame, x, y = looks.paint(rng), size[0] / 2, size[1] / 2
    legs(m, size, size[2] - 0.03, 0.03, looks.STEEL)
    for z in (0.12, 0.5, size[2] - 0.03):
        m.box((-x, -y, z), (x, y * 0.4, z + 0.03), frame)
    for z in (0.15, 0.53):
        m.cushion((-x + 0.05, -y + 0.05, z), (x - 0.05, y * 0.35, z + 0.22), looks.linen(rng), 0.03)
    m.cushion((-x + 0.04, y * 0.45, 0.15), (x - 0.04, y - 0.01, size[2] - 0.04), looks.fabric(rng), 0.05)
