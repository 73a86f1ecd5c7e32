"""Seats, beds and tables."""

from __future__ import annotations

import numpy as np

from salframe_house import looks
from salframe_house.mesh import MeshBuilder, circle
from salframe_house.object_class import Size, furniture
from salframe_house.scene import Material


def legs(m: MeshBuilder, size: Size, top: float, thickness: float, material: Material, inset: float = 0.0) -> None:
    """Add four square legs under the corners of the footprint, up to height `top`."""
    x, y = size[0] / 2 - inset - thickness, size[1] / 2 - inset - thickness
    for sx in (-1, 1):
        for sy in (-1, 1):
            cx, cy = sx * (x + thickness / 2), sy * (y + thickness / 2)
            m.box((cx - thickness / 2, cy - thickness / 2, 0), (cx + thickness / 2, cy + thickness / 2, top), material)


def _backrest(
    m: MeshBuilder, size: Size, low: float, material: Material, thickness: float, width: float, lean: float = 0.05
) -> None:
    """Add a back that leans towards -x, from height `low` to the top."""
    x, half = -size[0] / 2, width / 2

    def section(shift: float) -> np.ndarray:
        return np.array(
            [[x + shift, -half], [x + shift + thickness, -half], [x + shift + thickness, half], [x + shift, half]]
        )

    m.loft([(section(lean), low), (section(0.0), size[2])], material)


@furniture(
    "chair",
    (0.42, 0.40, 0.80),
    (0.52, 0.48, 0.98),
    "around",
    ("dining table", "conference table", "breakfast table", "desk"),
)
def chair(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Four legs, a seat, and a back of slats or in one piece."""
    frame = looks.wood(rng) if rng.random() < 0.6 else looks.metal(rng)
    seat = frame if rng.random() < 0.4 else looks.upholstery(rng)
    x, y, h = size[0] / 2, size[1] / 2, 0.46
    legs(m, size, h - 0.03, 0.035, frame)
    m.cushion((-x, -y, h - 0.03), (x, y, h + 0.02), seat, 0.015)
    if rng.random() < 0.5:
        for side in (-1, 1):
            m.box((-x, side * (y - 0.018) - 0.018, h + 0.02), (-x + 0.03, side * (y - 0.018) + 0.018, size[2]), frame)
        for z in np.linspace(h + 0.14, size[2] - 0.08, 3):
            m.box((-x + 0.005, -y + 0.036, z), (-x + 0.025, y - 0.036, z + 0.06), frame)
    else:
        _backrest(m, size, h + 0.02, seat, 0.035, size[1] * 0.94)


@furniture("office chair", (0.58, 0.58, 0.92), (0.66, 0.66, 1.12), "front", ("desk", "reception desk"))
def office_chair(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A five-star base with castors, a gas spring, padded seat and back, armrests."""
    dark, pad = looks.BLACK, looks.fabric(rng)
    x, y, h = size[0] / 2, size[1] / 2, 0.48
    for angle in 2 * np.pi * (np.arange(5) + rng.random()) / 5:
        cx, cy = (x - 0.04) * np.cos(angle), (y - 0.04) * np.sin(angle)
        sx, sy = -np.sin(angle) * 0.025, np.cos(angle) * 0.025
        m.quad(
            np.array([[sx, sy, 0.10], [-sx, -sy, 0.10], [cx - sx, cy - sy, 0.07], [cx + sx, cy + sy, 0.07]])[::-1], dark
        )
        m.cylinder((cx, cy, 0.0), 0.03, 0.07, looks.RUBBER, segments=6)
    m.cylinder((0, 0, 0.08), 0.03, h - 0.16, looks.STEEL, segments=8)
    m.cushion((-x * 0.75, -y * 0.8, h - 0.08), (x * 0.9, y * 0.8, h), pad, 0.04)
    _backrest(m, size, h + 0.06, pad, 0.06, size[1] * 0.76, 0.07)
    m.box((-x * 0.8, -0.03, h - 0.06), (-x * 0.7, 0.03, h + 0.25), dark)
    if rng.random() < 0.7:
        for side in (-1, 1):
            m.box((-0.02, side * (y - 0.03) - 0.02, h - 0.05), (0.03, side * (y - 0.03) + 0.02, h + 0.18), dark)
            m.box((-x * 0.5, side * (y - 0.03) - 0.03, h + 0.18), (x * 0.5, side * (y - 0.03) + 0.03, h + 0.21), dark)


def _sofa(m: MeshBuilder, size: Size, rng: np.random.Generator, seats: int) -> None:
    """Add a sofa or armchair with a number of seats."""
    look, leg = looks.upholstery(rng), looks.wood(rng)
    x, y, arm, h = size[0] / 2, size[1] / 2, rng.uniform(0.10, 0.2), rng.uniform(0.40, 0.45)
    legs(m, size, 0.10, 0.05, leg, 0.03)
    m.box((-x, -y, 0.10), (x, y, h - 0.14), look)
    m.box((-x, -y + arm, h - 0.14), (-x + 0.20, y - arm, size[2]), look)
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - arm)))
        m.cushion((-x, low, h - 0.14), (x, high, h + 0.16), look, 0.05)
    width = (size[1] - 2 * arm) / seats
    for i in range(seats):
        low = -y + arm + i * width
        m.cushion((-x + 0.22, low + 0.005, h - 0.14), (x - 0.01, low + width - 0.005, h), look, 0.05)
        m.cushion((-x + 0.20, low + 0.02, h), (-x + 0.36, low + width - 0.02, size[2] - 0.06), look, 0.05)
    if seats > 1 and rng.random() < 0.7:
        pillow = looks.fabric(rng)
        middle = rng.choice((-1, 1)) * (y - arm - 0.24)
        m.cushion((-x + 0.36, middle - 0.2, h), (-x + 0.50, middle + 0.2, min(h + 0.36, size[2])), pillow, 0.06)


@furniture("sofa", (0.82, 1.50, 0.74), (0.98, 2.20, 0.92), "wall", front_m=0.5)
def sofa(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A couch for two or three, with arms, seat and back cushions, pillows."""
    _sofa(m, size, rng, 2 if size[1] < 1.85 else 3)


@furniture("armchair", (0.72, 0.72, 0.75), (0.88, 0.88, 0.98), "corner", front_m=0.35)
def armchair(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A single upholstered seat."""
    _sofa(m, size, rng, 1)


@furniture("ottoman", (0.45, 0.45, 0.36), (0.60, 0.75, 0.44), "centre")
def ottoman(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """An upholstered footstool."""
    x, y = size[0] / 2, size[1] / 2
    legs(m, size, 0.08, 0.04, looks.wood(rng), 0.02)
    m.cushion((-x, -y, 0.08), (x, y, size[2]), looks.upholstery(rng), 0.05)


@furniture(
    "stool", (0.32, 0.32, 0.44), (0.38, 0.38, 0.72), "front", ("kitchen counter", "piano", "dresser", "breakfast table")
)
def stool(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A round seat on four legs with a ring."""
    frame, r = looks.metal(rng) if rng.random() < 0.5 else looks.wood(rng), size[0] / 2
    legs(m, (size[0] * 0.8, size[1] * 0.8, size[2]), size[2] - 0.04, 0.03, frame)
    m.box((-r * 0.7, -r * 0.7, 0.18), (r * 0.7, r * 0.7, 0.20), frame)
    m.cylinder((0, 0, size[2] - 0.05), (r, size[1] / 2), 0.05, looks.upholstery(rng), segments=14)


@furniture("bench", (0.38, 1.10, 0.42), (0.46, 1.60, 0.48), "wall")
def bench(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A seat for a corridor or the foot of a wall."""
    x, y = size[0] / 2, size[1] / 2
    legs(m, size, size[2] - 0.06, 0.05, looks.metal(rng) if rng.random() < 0.5 else looks.wood(rng), 0.03)
    m.cushion(
        (-x, -y, size[2] - 0.06),
        (x, y, size[2]),
        looks.wood(rng) if rng.random() < 0.4 else looks.upholstery(rng),
        0.02,
    )


@furniture("bed", (1.95, 1.00, 0.85), (2.10, 1.80, 1.15), "wall")
def bed(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Frame, headboard, mattress, blanket and pillows."""
    frame, cloth, cover = (
        looks.upholstery(rng) if rng.random() < 0.4 else looks.wood(rng),
        looks.linen(rng),
        looks.linen(rng),
    )
    x, y, h = size[0] / 2, size[1] / 2, rng.uniform(0.28, 0.34)
    legs(m, size, 0.14, 0.07, frame, 0.04)
    m.box((-x, -y, 0.14), (x, y, h), frame)
    m.box((-x, -y, h), (-x + 0.07, y, size[2]), frame)
    m.cushion((-x + 0.07, -y + 0.03, h), (x - 0.02, y - 0.03, h + 0.20), cloth, 0.05)
    m.cushion((-x + 0.75, -y + 0.01, h + 0.06), (x - 0.005, y - 0.01, h + 0.235), cover, 0.04)
    count = 2 if size[1] > 1.3 else 1
    width = (size[1] - 0.12) / count
    for i in range(count):
        low = -y + 0.06 + i * width
        m.cushion((-x + 0.12, low + 0.04, h + 0.20), (-x + 0.52, low + width - 0.04, h + 0.34), cloth, 0.06)


@furniture("baby bed", (1.20, 0.64, 0.85), (1.30, 0.72, 0.95), "wall")
def baby_bed(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A cot with barred sides."""
    frame, x, y = looks.wood(rng), size[0] / 2, size[1] / 2
    legs(m, size, size[2], 0.045, frame)
    m.cushion((-x + 0.05, -y + 0.05, 0.30), (x - 0.05, y - 0.05, 0.42), looks.linen(rng), 0.03)
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - 0.03)))
        m.box((-x, low, size[2] - 0.06), (x, high, size[2] - 0.01), frame)
        m.box((-x, low, 0.24), (x, high, 0.30), frame)
        for cx in np.linspace(-x + 0.15, x - 0.15, 7):
            m.box((cx - 0.01, low + 0.005, 0.30), (cx + 0.01, high - 0.005, size[2] - 0.06), frame)
        low, high = sorted((side * x, side * (x - 0.03)))
        m.box((low, -y + 0.045, 0.24), (high, y - 0.045, size[2] - 0.03), frame)


def _table(m: MeshBuilder, size: Size, rng: np.random.Generator, top: Material, base: Material) -> None:
    """Add a rectangular or oval top on four legs or on a column."""
    x, y, thickness = size[0] / 2, size[1] / 2, 0.04
    if rng.random() < 0.3 and max(size[0], size[1]) < 1.6:
        m.cylinder((0, 0, size[2] - thickness), (x, y), thickness, top, segments=20)
        m.cylinder((0, 0, 0.03), 0.05, size[2] - thickness - 0.03, base, segments=10)
        m.cylinder((0, 0, 0), (x * 0.55, y * 0.55), 0.03, base, segments=14)
    else:
        m.box((-x, -y, size[2] - thickness), (x, y, size[2]), top)
        legs(m, size, size[2] - thickness, 0.06 if size[2] > 0.6 else 0.045, base, 0.03)
        m.box((-x + 0.07, -y + 0.07, size[2] - 0.11), (x - 0.07, -y + 0.09, size[2] - thickness), base)
        m.box((-x + 0.07, y - 0.09, size[2] - 0.11), (x - 0.07, y - 0.07, size[2] - thickness), base)


def _table_looks(rng: np.random.Generator) -> tuple[Material, Material]:
    """Draw the materials of the top and the base of a table."""
    top = looks.wood(rng)
    return (top, top) if rng.random() < 0.5 else (top if rng.random() < 0.7 else looks.stone(rng), looks.metal(rng))


@furniture("dining table", (0.80, 1.20, 0.73), (1.00, 1.80, 0.78), "centre")
def dining_table(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A table for four to six."""
    _table(m, size, rng, *_table_looks(rng))


@furniture("breakfast table", (0.65, 0.65, 0.73), (0.80, 0.80, 0.78), "centre")
def breakfast_table(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A small table for two."""
    _table(m, size, rng, *_table_looks(rng))


@furniture("conference table", (1.00, 1.80, 0.73), (1.20, 2.40, 0.76), "centre")
def conference_table(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A boat-shaped top on two panels."""
    top, base, x, y = looks.board(rng), looks.metal(rng), size[0] / 2, size[1] / 2
    outline = np.array([[-x * 0.8, -y], [x * 0.8, -y], [x, 0.0], [x * 0.8, y], [-x * 0.8, y], [-x, 0.0]])
    m.loft([(outline, size[2] - 0.04), (outline, size[2])], top)
    for side in (-1, 1):
        m.box((-x * 0.5, side * y * 0.6 - 0.04, 0), (x * 0.5, side * y * 0.6 + 0.04, size[2] - 0.04), base)
    m.box((-0.03, -y * 0.6, 0.30), (0.03, y * 0.6, 0.42), base)


@furniture("coffee table", (0.50, 0.80, 0.38), (0.65, 1.15, 0.46), "front", ("sofa", "armchair"), gap_m=(0.30, 0.42))
def coffee_table(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A low table with a shelf."""
    top, base = _table_looks(rng)
    _table(m, size, rng, top, base)
    m.box((-size[0] * 0.18, -size[1] * 0.18, 0.12), (size[0] * 0.18, size[1] * 0.18, 0.14), top)


@furniture("side table", (0.40, 0.40, 0.48), (0.52, 0.52, 0.60), "beside", ("sofa", "armchair", "bench"))
def side_table(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A small table beside a seat."""
    _table(m, size, rng, *_table_looks(rng))


@furniture("desk", (0.65, 1.20, 0.72), (0.80, 1.70, 0.76), "wall", front_m=0.75)
def desk(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A worktop on legs or panels, mostly with a drawer unit."""
    top, base = looks.board(rng), looks.metal(rng)
    x, y, h = size[0] / 2, size[1] / 2, size[2] - 0.03
    m.box((-x, -y, h), (x, y, size[2]), top)
    if rng.random() < 0.5:
        legs(m, size, h, 0.05, base, 0.02)
    else:
        for side in (-1, 1):
            m.box((-x + 0.03, side * (y - 0.03) - 0.02, 0), (x - 0.05, side * (y - 0.03) + 0.02, h), top)
    m.box((-x + 0.04, -y + 0.06, h - 0.32), (-x + 0.06, y - 0.06, h), top)
    if rng.random() < 0.7:
        low = y - 0.50 if rng.random() < 0.5 else -y + 0.08
        m.box((-x + 0.1, low, 0.05), (x - 0.08, low + 0.42, h), base)
        for z in np.linspace(0.09, h - 0.2, 3):
            m.box((x - 0.08, low + 0.02, z), (x - 0.065, low + 0.40, z + 0.17), top)


@furniture("reception desk", (0.75, 1.60, 1.05), (0.90, 2.20, 1.15), "centre", front_m=0.5)
def reception_desk(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A counter with a raised ledge towards the guests."""
    body, top = looks.wood(rng), looks.stone(rng)
    x, y = size[0] / 2, size[1] / 2
    m.box((-x + 0.05, -y + 0.05, 0.08), (-x + 0.12, y - 0.05, size[2] - 0.05), body)
    for side in (-1, 1):
        low, high = sorted((side * (y - 0.05), side * (y - 0.10)))
        m.box((-x + 0.05, low, 0.0), (x, high, size[2] - 0.05), body)
    m.box((-x, -y, size[2] - 0.05), (-x + 0.35, y, size[2]), top)
    m.box((-x + 0.12, -y + 0.10, 0.72), (x, y - 0.10, 0.75), body)


@furniture("bar table", (0.58, 0.58, 1.02), (0.70, 0.70, 1.10), "centre")
def bar_table(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A high round table on a column."""
    base, r = looks.metal(rng), size[0] / 2
    m.cylinder((0, 0, 0), (r * 0.6, size[1] * 0.3), 0.03, base, segments=16)
    m.cylinder((0, 0, 0.03), 0.04, size[2] - 0.07, base, segments=8)
    m.loft([(circle(18) * (r, size[1] / 2), size[2] - 0.04), (circle(18) * (r, size[1] / 2), size[2])], looks.wood(rng))
