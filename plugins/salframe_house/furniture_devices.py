"""Screens, machines and instruments."""

from __future__ import annotations

import numpy as np

from salframe_house import looks
from salframe_house.mesh import MeshBuilder
from salframe_house.object_class import Size, furniture

TABLES = (
    "desk",
    "reception desk",
    "dining table",
    "conference table",
    "cabinet",
    "dresser",
    "file cabinet",
    "coffee table",
)
WORKTOPS = ("kitchen counter", "cabinet", "dishwasher", "washing machine", "breakfast table")


@furniture("monitor", (0.16, 0.48, 0.40), (0.22, 0.65, 0.50), "top", ("desk", "reception desk"))
def monitor(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A display on a foot."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y * 0.4, 0), (x, y * 0.4, 0.015), looks.BLACK)
    m.box((-0.02, -0.03, 0.015), (0.01, 0.03, h * 0.6), looks.BLACK)
    m.box((0.01, -y, h * 0.26), (0.04, y, h), looks.BLACK)
    m.box((0.04, -y + 0.012, h * 0.26 + 0.012), (0.042, y - 0.012, h - 0.012), looks.BLACK, front=looks.screen(rng))


@furniture("laptop", (0.32, 0.30, 0.22), (0.36, 0.36, 0.25), "top", TABLES[:5])
def laptop(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A base with keys and an open lid."""
    x, y, h, body = size[0] / 2, size[1] / 2, size[2], looks.metal(rng)
    m.box((-x + 0.09, -y, 0), (x, y, 0.018), body, top=looks.BLACK)
    lid = np.array([[-x + 0.09, -y, 0.018], [-x + 0.09, y, 0.018], [-x, y, h], [-x, -y, h]])
    m.quad(lid, looks.screen(rng))
    m.quad((lid - (0, 0, 0.006))[::-1], body)


@furniture(
    "printer", (0.36, 0.38, 0.24), (0.46, 0.50, 0.38), "top", ("cabinet", "file cabinet", "desk", "reception desk")
)
def printer(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A desktop printer with trays."""
    x, y, h, body = size[0] / 2, size[1] / 2, size[2], looks.plastic(rng)
    m.box((-x, -y, 0), (x - 0.08, y, h * 0.85), body)
    m.cushion((-x + 0.04, -y + 0.03, h * 0.85), (x - 0.12, y - 0.03, h), looks.BLACK, 0.02)
    m.box((x - 0.08, -y * 0.7, h * 0.25), (x, y * 0.7, h * 0.28), looks.PAPER)
    m.box((x - 0.079, -y * 0.9, h * 0.62), (x - 0.06, -y * 0.3, h * 0.78), looks.BLACK)


@furniture("copier", (0.60, 0.58, 1.05), (0.70, 0.72, 1.20), "wall", front_m=0.6)
def copier(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A floor-standing machine with drawers, glass and feeder."""
    x, y, h, body = size[0] / 2, size[1] / 2, size[2], looks.plastic(rng)
    m.box((-x, -y, 0.04), (x - 0.03, y, h * 0.55), looks.WHITE)
    m.box((-x + 0.03, -y + 0.03, 0), (x - 0.08, y - 0.03, 0.04), looks.BLACK)
    for z in np.linspace(0.07, h * 0.55 - 0.17, 3):
        m.box((x - 0.03, -y + 0.02, z), (x - 0.015, y - 0.02, z + 0.14), body)
        m.box((x - 0.015, -0.08, z + 0.08), (x - 0.005, 0.08, z + 0.10), looks.BLACK)
    m.box((-x, -y, h * 0.68), (x - 0.03, y, h * 0.85), looks.WHITE)
    m.box((-x, -y, h * 0.55), (-x + 0.12, y, h * 0.68), body)
    m.box((-x, y - 0.12, h * 0.55), (x - 0.03, y, h * 0.68), body)
    m.cushion((-x + 0.02, -y + 0.02, h * 0.85), (x - 0.10, y - 0.02, h), body, 0.03)
    m.box((x - 0.10, -y + 0.04, h * 0.85), (x, -y + 0.24, h * 0.90), looks.BLACK, top=looks.screen(rng))


@furniture("telephone", (0.18, 0.16, 0.08), (0.22, 0.20, 0.11), "top", TABLES[:5])
def telephone(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A desk telephone with its receiver."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0), (x, y, h * 0.55), looks.BLACK)
    m.cushion((-x + 0.01, -y + 0.01, h * 0.55), (x - 0.01, -y + 0.055, h), looks.RUBBER, 0.015)
    m.box((-x + 0.02, -y + 0.08, h * 0.55), (-x + 0.07, y - 0.02, h * 0.6), looks.STEEL)
    m.box((0.0, -y + 0.08, h * 0.55), (x - 0.02, y - 0.02, h * 0.6), looks.WHITE)


@furniture("projector", (0.24, 0.28, 0.26), (0.32, 0.36, 0.34), "ceiling")
def projector(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A projector on a ceiling mount."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.cylinder((0, 0, 0.12), 0.025, h - 0.13, looks.STEEL, segments=8)
    m.box((-0.06, -0.06, h - 0.01), (0.06, 0.06, h), looks.STEEL)
    m.cushion((-x, -y, 0), (x - 0.03, y, 0.12), looks.WHITE if rng.random() < 0.6 else looks.BLACK, 0.02)
    m.cylinder((x - 0.03, y * 0.4, 0.06), 0.04, 0.03, looks.RUBBER, axis="x", segments=12)


@furniture("tv", (0.06, 0.75, 0.45), (0.08, 1.25, 0.74), "hung", base_m=(1.0, 1.2))
def tv(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A flat screen on a wall mount."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -0.15, h * 0.3), (0.0, 0.15, h * 0.7), looks.BLACK)
    m.box((0.0, -y, 0), (x - 0.002, y, h), looks.BLACK)
    m.box((x - 0.002, -y + 0.015, 0.02), (x, y - 0.015, h - 0.015), looks.BLACK, front=looks.screen(rng))


@furniture("microwave", (0.34, 0.44, 0.26), (0.40, 0.52, 0.30), "top", WORKTOPS)
def microwave(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A housing with a dark door and a panel."""
    x, y, h, body = size[0] / 2, size[1] / 2, size[2], looks.STEEL if rng.random() < 0.5 else looks.WHITE
    m.box((-x, -y, 0), (x - 0.03, y, h), body)
    m.box((x - 0.03, -y + 0.12, 0.02), (x - 0.015, y - 0.01, h - 0.02), looks.BLACK)
    m.box((x - 0.03, -y + 0.01, 0.02), (x - 0.02, -y + 0.11, h - 0.02), looks.RUBBER)
    m.box((x - 0.015, -y + 0.13, 0.04), (x, -y + 0.145, h - 0.04), looks.CHROME)


@furniture(
    "coffee machine", (0.28, 0.24, 0.32), (0.38, 0.34, 0.45), "top", (*WORKTOPS, "conference table", "reception desk")
)
def coffee_machine(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A back with a tank, a head and a drip tray."""
    x, y, h, body = size[0] / 2, size[1] / 2, size[2], looks.plastic(rng)
    m.box((-x, -y, 0), (-x + size[0] * 0.45, y, h), body)
    m.box((-x + size[0] * 0.45, -y, h * 0.65), (x, y, h), body)
    m.box((-x + size[0] * 0.45, -y, 0), (x, y, 0.04), looks.STEEL)
    m.cylinder((x * 0.45, 0, h * 0.58), 0.02, h * 0.07, looks.CHROME, segments=8)
    m.cylinder((x * 0.45, 0, 0.04), 0.035, 0.09, looks.CERAMIC, top_radius=0.042, segments=10)


@furniture("kettle", (0.20, 0.16, 0.21), (0.24, 0.19, 0.26), "top", (*WORKTOPS, "desk"))
def kettle(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A jug with a handle."""
    r, h, body = size[1] / 2, size[2], looks.STEEL if rng.random() < 0.5 else looks.plastic(rng)
    x = size[0] / 2
    m.cylinder((-x + r, 0, 0), r, 0.02, looks.BLACK, segments=12)
    m.cylinder((-x + r, 0, 0.02), r * 0.95, h - 0.05, body, top_radius=r * 0.72, segments=12)
    m.cylinder((-x + r, 0, h - 0.03), r * 0.25, 0.03, looks.BLACK, segments=8)
    m.box((x - 0.03, -0.012, 0.05), (x, 0.012, h - 0.04), looks.BLACK)
    m.box((-x + r, -0.012, h - 0.06), (x, 0.012, h - 0.04), looks.BLACK)


@furniture("water cooler", (0.32, 0.30, 1.05), (0.38, 0.36, 1.30), "wall", front_m=0.4)
def water_cooler(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A dispenser with a bottle on it."""
    x, y, top = size[0] / 2, size[1] / 2, size[2] - 0.36
    m.box((-x, -y, 0), (x - 0.05, y, top), looks.WHITE)
    m.box((x - 0.05, -y, 0), (x - 0.03, y, top * 0.68), looks.paint(rng))
    m.box((x - 0.05, -y + 0.02, top * 0.68), (x, y - 0.02, top * 0.72), looks.BLACK)
    for side, tint in ((-0.06, (0.12, 0.20, 0.45)), (0.06, (0.45, 0.10, 0.08))):
        m.box(
            (x - 0.05, side - 0.015, top * 0.9), (x - 0.02, side + 0.015, top * 0.94), looks.Material("plastic", tint)
        )
    bottle = looks.Material("glass", (0.30, 0.45, 0.58))
    m.cylinder((-0.02, 0, top), 0.05, 0.06, bottle, top_radius=y * 0.8, segments=12)
    m.cylinder((-0.02, 0, top + 0.06), y * 0.8, 0.30, bottle, segments=12)


@furniture("vending machine", (0.70, 0.80, 1.75), (0.85, 1.00, 1.90), "wall", front_m=0.6)
def vending_machine(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A cabinet with a lit window of goods and a coin panel."""
    x, y, h, body = size[0] / 2, size[1] / 2, size[2], looks.plastic(rng)
    m.box((-x, -y, 0.05), (x - 0.02, y, h), body)
    m.box((-x + 0.05, -y + 0.05, 0), (x - 0.06, y - 0.05, 0.05), looks.BLACK)
    goods = looks.books(rng)
    for z in np.linspace(0.55, h - 0.36, 4):
        m.box((x - 0.02, -y + 0.28, z), (x - 0.008, y - 0.06, z + 0.24), goods)
    m.box((x - 0.02, -y + 0.06, 0.8), (x, -y + 0.22, 1.4), looks.BLACK, front=looks.screen(rng))
    m.box((x - 0.02, -y + 0.3, 0.2), (x - 0.005, y - 0.1, 0.42), looks.BLACK)


@furniture("piano", (0.58, 1.42, 1.10), (0.65, 1.52, 1.28), "wall", front_m=0.7)
def piano(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """An upright piano: case, keyboard, lid, pedals."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    case = looks.wood(rng) if rng.random() < 0.6 else looks.Material("laminate", (0.03, 0.03, 0.035))
    m.box((-x, -y, 0), (0.0, y, h - 0.03), case)
    m.box((-x, -y, h - 0.03), (0.02, y, h), case)
    m.box((0.0, -y, 0.62), (x, y, 0.70), case)
    m.box((0.06, -y + 0.08, 0.70), (x - 0.03, y - 0.08, 0.72), looks.PAPER)
    for cy in np.linspace(-y + 0.14, y - 0.14, 12):
        m.box((0.06, cy - 0.02, 0.72), (0.16, cy + 0.02, 0.735), looks.BLACK)
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - 0.07)))
        m.box((0.0, low, 0.70), (x, high, 0.80), case)
        m.box((x - 0.07, low, 0.0), (x, high, 0.62), case)
    for cy in (-0.08, 0.0, 0.08):
        m.box((0.0, cy - 0.015, 0.06), (0.09, cy + 0.015, 0.075), looks.CHROME)


@furniture("treadmill", (1.50, 0.70, 1.25), (1.70, 0.80, 1.40), "wall")
def treadmill(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A belt between rails and a console."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x + 0.1, -y, 0.02), (x, y, 0.16), looks.BLACK, top=looks.RUBBER)
    m.box((-x, -y, 0), (-x + 0.35, y, 0.24), looks.plastic(rng))
    for side in (-1, 1):
        low, high = sorted((side * y, side * (y - 0.05)))
        m.box((-x + 0.20, low, 0.24), (-x + 0.26, high, h - 0.06), looks.STEEL)
        m.box((-x + 0.20, low, 0.92), (x * 0.1, high, 0.97), looks.RUBBER)
    m.box((-x + 0.12, -y, h - 0.20), (-x + 0.28, y, h), looks.BLACK, front=looks.screen(rng))
