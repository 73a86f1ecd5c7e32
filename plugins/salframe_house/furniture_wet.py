"""Kitchens, bathrooms and laundries."""

from __future__ import annotations

import numpy as np

from salframe_house import looks
from salframe_house.furniture_seating import legs
from salframe_house.furniture_storage import carcass, fronts
from salframe_house.mesh import MeshBuilder, circle
from salframe_house.object_class import Size, furniture
from salframe_house.scene import Material


def _basin(
    m: MeshBuilder,
    low: tuple[float, float],
    high: tuple[float, float],
    top: float,
    depth: float,
    look: Material,
    rim: float = 0.03,
) -> None:
    """Add a rectangular basin: four walls and a bottom, open at the top."""
    (x0, y0), (x1, y1), bottom = low, high, top - depth
    m.box((x0, y0, bottom), (x1, y1, bottom + 0.03), look)
    m.box((x0, y0, bottom + 0.03), (x0 + rim, y1, top), look)
    m.box((x1 - rim, y0, bottom + 0.03), (x1, y1, top), look)
    m.box((x0 + rim, y0, bottom + 0.03), (x1 - rim, y0 + rim, top), look)
    m.box((x0 + rim, y1 - rim, bottom + 0.03), (x1 - rim, y1, top), look)


def _tap(m: MeshBuilder, x: float, y: float, z: float, height: float, reach: float) -> None:
    """Add a tap: a column and a spout along +x."""
    m.cylinder((x, y, z), 0.014, height, looks.CHROME, segments=8)
    m.cylinder((x, y, z + height - 0.014), 0.011, reach, looks.CHROME, axis="x", segments=8)


@furniture("kitchen counter", (0.60, 1.20, 0.88), (0.64, 2.40, 0.92), "wall", front_m=0.7)
def kitchen_counter(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Base units with fronts under a worktop."""
    body, top = looks.board(rng), looks.stone(rng) if rng.random() < 0.6 else looks.wood(rng)
    x, y, h = size[0] / 2, size[1] / 2, size[2] - 0.04
    m.box((-x + 0.02, -y + 0.01, 0), (x - 0.08, y - 0.01, 0.10), looks.BLACK)
    carcass(m, size, 0.10, h, body)
    m.box((-x, -y, h), (x, y, size[2]), top)
    columns = max(2, round(size[1] / 0.6))
    fronts(m, size, 0.10, h - 0.18, columns, 1, body, looks.STEEL)
    fronts(m, size, h - 0.17, h, columns, 1, body, looks.STEEL)


@furniture("kitchen cabinet", (0.32, 0.80, 0.60), (0.38, 1.80, 0.75), "hung", base_m=(1.45, 1.5))
def kitchen_cabinet(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Wall units."""
    body = looks.board(rng)
    carcass(m, size, 0.0, size[2], body)
    fronts(m, size, 0.0, size[2], max(2, round(size[1] / 0.5)), 1, body, looks.STEEL)


@furniture("kitchen sink", (0.60, 0.80, 1.10), (0.64, 1.00, 1.20), "wall", front_m=0.6)
def kitchen_sink(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A sink unit: cupboard, steel basin with a drainer, tap."""
    body, x, y, top = looks.board(rng), size[0] / 2, size[1] / 2, 0.90
    carcass(m, size, 0.10, top - 0.18, body)
    m.box((-x, -y, 0.0), (x - 0.08, y, 0.10), looks.BLACK)
    fronts(m, size, 0.10, top - 0.04, 2, 1, body, looks.STEEL)
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - 0.02)))
        m.box((-x, low, 0.10), (x - 0.03, high, top - 0.04), body)
    m.box((-x, 0.02, top - 0.03), (x, y, top), looks.STEEL)
    _basin(m, (-x, -y), (x, 0.02), top, 0.18, looks.STEEL, 0.06)
    _tap(m, -x + 0.03, -y / 2, top, size[2] - top, 0.20)


@furniture("refrigerator", (0.60, 0.55, 1.40), (0.70, 0.75, 1.90), "wall", front_m=0.6)
def refrigerator(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A fridge over or under its freezer."""
    body = looks.paint(rng) if rng.random() < 0.6 else looks.STEEL
    x, y = size[0] / 2, size[1] / 2
    m.box((-x, -y, 0.03), (x - 0.06, y, size[2]), body)
    m.box((-x + 0.03, -y + 0.03, 0), (x - 0.09, y - 0.03, 0.03), looks.BLACK)
    split = size[2] * (0.35 if rng.random() < 0.5 else 0.68)
    for low, high in ((0.04, split - 0.005), (split + 0.005, size[2])):
        m.box((x - 0.055, -y, low), (x - 0.02, y, high), body)
        m.box((x - 0.02, -y + 0.05, (low + high) / 2 - 0.15), (x, -y + 0.07, (low + high) / 2 + 0.15), looks.CHROME)


@furniture("oven", (0.58, 0.58, 0.86), (0.62, 0.62, 0.92), "wall", front_m=0.6)
def oven(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A free-standing cooker with a hob of four rings."""
    body, x, y, h = looks.STEEL if rng.random() < 0.5 else looks.WHITE, size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0.04), (x - 0.03, y, h - 0.02), body)
    m.box((-x + 0.03, -y + 0.03, 0), (x - 0.09, y - 0.03, 0.04), looks.BLACK)
    m.box((-x, -y, h - 0.02), (x - 0.03, y, h - 0.006), looks.BLACK)
    for sx in (-0.5, 0.4):
        for sy in (-0.5, 0.5):
            m.cylinder((sx * x, sy * y, h - 0.006), 0.08, 0.006, looks.STEEL, segments=12)
    m.box((x - 0.03, -y + 0.02, 0.20), (x - 0.015, y - 0.02, h - 0.16), looks.BLACK)
    m.box((x - 0.015, -y + 0.06, h - 0.22), (x, y - 0.06, h - 0.20), looks.CHROME)
    for sy in np.linspace(-0.7, 0.7, 5):
        m.cylinder((x - 0.03, sy * y, h - 0.09), 0.02, 0.025, looks.BLACK, axis="x", segments=8)


def _front_loader(m: MeshBuilder, size: Size, body: Material) -> None:
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0.02), (x - 0.04, y, h), body)
    m.box((-x + 0.03, -y + 0.03, 0), (x - 0.09, y - 0.03, 0.02), looks.BLACK)
    m.box((x - 0.04, -y, h - 0.14), (x - 0.03, y, h), looks.WHITE)
    m.box((x - 0.03, -y + 0.22, h - 0.11), (x - 0.026, -y + 0.36, h - 0.04), looks.BLACK)
    m.cylinder((x - 0.04, y - 0.10, h - 0.07), 0.03, 0.03, looks.CHROME, axis="x", segments=10)


@furniture("washing machine", (0.56, 0.58, 0.84), (0.62, 0.62, 0.88), "wall", front_m=0.5)
def washing_machine(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A front loader with a round glass door."""
    _front_loader(m, size, looks.WHITE if rng.random() < 0.7 else looks.paint(rng))
    x, h = size[0] / 2, size[2]
    m.cylinder((x - 0.04, 0, h * 0.45), 0.19, 0.03, looks.CHROME, axis="x", segments=18, cap=looks.CHROME)
    m.cylinder((x - 0.01, 0, h * 0.45), 0.14, 0.01, looks.BLACK, axis="x", segments=18)


@furniture("dishwasher", (0.56, 0.58, 0.82), (0.62, 0.62, 0.88), "wall", front_m=0.5)
def dishwasher(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A flat front with a long handle."""
    _front_loader(m, size, looks.STEEL if rng.random() < 0.5 else looks.WHITE)
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((x - 0.04, -y + 0.01, 0.10), (x - 0.02, y - 0.01, h - 0.15), looks.STEEL)
    m.box((x - 0.02, -y + 0.05, h - 0.22), (x, y - 0.05, h - 0.20), looks.CHROME)


@furniture("bathtub", (0.70, 1.45, 0.54), (0.80, 1.70, 0.60), "wall", front_m=0.5)
def bathtub(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A tub behind a panel, with taps."""
    x, y = size[0] / 2, size[1] / 2
    panel = (
        looks.CERAMIC if rng.random() < 0.5 else Material("tile", (0.55, 0.56, 0.56), int(rng.integers(looks.VARIANTS)))
    )
    m.box((-x, -y, 0), (x, y, 0.12), panel)
    _basin(m, (-x, -y), (x, y), size[2] - 0.06, size[2] - 0.18, looks.CERAMIC, 0.07)
    _tap(m, -x + 0.03, y * 0.1, size[2] - 0.06, 0.06, 0.12)


@furniture("shower", (0.80, 0.80, 1.95), (0.90, 0.95, 2.05), "corner", front_m=0.5)
def shower(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A tray, framed half-high screens, a rail with a head."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    _basin(m, (-x, -y), (x, y), 0.12, 0.12, looks.CERAMIC, 0.04)
    wall = Material("tile", (0.56, 0.58, 0.58), int(rng.integers(looks.VARIANTS)))
    m.box((-x, -y, 0.12), (-x + 0.02, y, h), wall)
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - 0.02)))
        m.box((-x + 0.02, low, 0.12), (x - 0.03, high, h * 0.55), looks.GLASS)
        m.box((x - 0.03, low, 0.12), (x, high, h), looks.CHROME)
    m.cylinder((-x + 0.06, 0, 0.9), 0.012, h - 0.95, looks.CHROME, segments=8)
    m.cylinder((-x + 0.16, 0, h - 0.10), 0.09, 0.03, looks.CHROME, segments=14)
    m.box((-x + 0.05, -0.012, h - 0.08), (-x + 0.16, 0.012, h - 0.06), looks.CHROME)


@furniture("toilet", (0.62, 0.36, 0.74), (0.70, 0.40, 0.82), "wall", front_m=0.45)
def toilet(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Bowl, seat and cistern."""
    x, y, h, ring = size[0] / 2, size[1] / 2, 0.40, circle(14)
    reach = (size[0] - 0.18) / 2
    centre = x - reach
    m.loft(
        [
            (ring * (reach * 0.55, y * 0.6) + (centre - 0.06, 0), 0.0),
            (ring * (reach * 0.6, y * 0.65) + (centre - 0.05, 0), 0.20),
            (ring * (reach, y) + (centre, 0), h - 0.03),
            (ring * (reach, y) + (centre, 0), h),
        ],
        looks.CERAMIC,
    )
    lid = looks.WHITE if rng.random() < 0.8 else looks.wood(rng)
    m.loft(
        [(ring * (reach * 0.98, y * 0.98) + (centre, 0), h), (ring * (reach * 0.98, y * 0.98) + (centre, 0), h + 0.03)],
        lid,
    )
    m.box((-x, -y, h - 0.04), (-x + 0.18, y, size[2] - 0.03), looks.CERAMIC)
    m.box((-x, -y, size[2] - 0.03), (-x + 0.19, y, size[2] - 0.01), looks.CERAMIC)
    m.cylinder((-x + 0.09, 0, size[2] - 0.01), 0.025, 0.01, looks.CHROME, segments=10)


@furniture("urinal", (0.32, 0.32, 0.60), (0.38, 0.38, 0.68), "hung", base_m=(0.55, 0.62), front_m=0.4)
def urinal(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A wall-hung bowl with a flush pipe."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0.10), (-x + 0.06, y, h - 0.12), looks.CERAMIC)
    half = np.array(
        [[-x + 0.06, -y], [x * 0.5, -y * 0.9], [x, -y * 0.4], [x, y * 0.4], [x * 0.5, y * 0.9], [-x + 0.06, y]]
    )
    m.loft([(half * (0.5, 0.5) + (-x / 2 + 0.03, 0), 0.0), (half, 0.18), (half, 0.26)], looks.CERAMIC)
    m.cylinder((-x + 0.03, 0, h - 0.12), 0.015, 0.12, looks.CHROME, segments=8)


@furniture("sink", (0.42, 0.50, 1.00), (0.50, 0.65, 1.08), "wall", front_m=0.5)
def sink(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A washbasin on a pedestal."""
    x, y, top = size[0] / 2, size[1] / 2, 0.86
    m.cylinder((-x * 0.4, 0, 0), (0.09, 0.09), top - 0.16, looks.CERAMIC, top_radius=(0.11, 0.13), segments=12)
    _basin(m, (-x, -y), (x, y), top, 0.16, looks.CERAMIC, 0.045)
    _tap(m, -x + 0.025, 0, top, size[2] - top, 0.13)


@furniture("bathroom vanity", (0.45, 0.70, 0.98), (0.55, 1.20, 1.06), "wall", front_m=0.5)
def bathroom_vanity(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A basin in a cupboard with a stone top."""
    body, top, x, y, h = looks.board(rng), looks.stone(rng), size[0] / 2, size[1] / 2, 0.84
    carcass(m, size, 0.12, h - 0.12, body)
    legs(m, size, 0.12, 0.05, body, 0.02)
    fronts(m, size, 0.12, h - 0.02, 2, 1, body, looks.CHROME)
    m.box((-x, -y, h - 0.03), (x, y, h), top)
    _basin(m, (-x + 0.08, -0.24), (x - 0.05, 0.24), h + 0.05, 0.05, looks.CERAMIC, 0.02)
    _tap(m, -x + 0.04, 0, h, size[2] - h, 0.15)


@furniture("towel", (0.08, 0.40, 0.50), (0.10, 0.65, 0.75), "hung", base_m=(0.75, 0.95))
def towel(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A towel over a rail."""
    x, y, h, cloth = size[0] / 2, size[1] / 2, size[2], looks.linen(rng)
    m.cylinder((0.01, -y, h - 0.03), 0.010, size[1], looks.CHROME, axis="y", segments=8)
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - 0.02)))
        m.box((-x, low, h - 0.04), (0.0, high, h - 0.02), looks.CHROME)
    m.cushion((0.02, -y + 0.04, 0.0), (x, y - 0.04, h), cloth, 0.015)
    m.box((-x + 0.01, -y + 0.04, h * 0.3), (-0.002, y - 0.04, h - 0.01), cloth)


@furniture("toilet paper", (0.11, 0.13, 0.14), (0.13, 0.15, 0.17), "hung", base_m=(0.60, 0.72))
def toilet_paper(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A roll in its holder."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, h - 0.02), (x, y, h), looks.CHROME)
    m.cylinder((0, -y + 0.01, (h - 0.02) / 2), ((h - 0.02) / 2, x), size[1] - 0.02, looks.PAPER, axis="y", segments=14)


@furniture("hand dryer", (0.18, 0.26, 0.28), (0.22, 0.32, 0.36), "hung", base_m=(1.05, 1.15))
def hand_dryer(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A steel or white housing with a nozzle."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.cushion((-x, -y, 0.05), (x, y, h), looks.STEEL if rng.random() < 0.5 else looks.WHITE, 0.05)
    m.box((-x * 0.2, -y * 0.4, 0.0), (x * 0.6, y * 0.4, 0.05), looks.BLACK)


@furniture("ironing board", (0.34, 1.15, 0.84), (0.40, 1.35, 0.92), "wall")
def ironing_board(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A padded board on crossed legs."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    outline = np.array([[-x, -y], [x, -y], [x, y * 0.5], [x * 0.3, y], [-x * 0.3, y], [-x, y * 0.5]])
    m.loft([(outline, h - 0.04), (outline, h)], looks.linen(rng))
    for side in (-1, 1):
        leg = np.array([[-0.015, -0.02], [0.015, -0.02], [0.015, 0.02], [-0.015, 0.02]])
        foot, head = np.array([0.05 * side, -side * y * 0.7]), np.array([0.05 * side, side * y * 0.6])
        m.loft([(leg + foot, 0.0), (leg + head, h - 0.04)], looks.STEEL)


@furniture("drying rack", (0.50, 0.90, 0.95), (0.58, 1.20, 1.10), "centre")
def drying_rack(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Bars with laundry on two frames."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    legs(m, size, h, 0.02, looks.WHITE)
    for cx in np.linspace(-x + 0.01, x - 0.01, 5):
        m.box((cx - 0.008, -y + 0.02, h - 0.03), (cx + 0.008, y - 0.02, h - 0.014), looks.WHITE)
    for cx in np.linspace(-x + 0.01, x - 0.01, 5)[1:-1]:
        start, length = rng.uniform(-y + 0.05, 0.0), rng.uniform(0.3, y)
        m.box(
            (cx - 0.012, start, h - rng.uniform(0.4, 0.6)),
            (cx + 0.012, min(start + length, y - 0.03), h - 0.01),
            looks.linen(rng),
        )
