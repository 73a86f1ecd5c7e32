"""Lamps, plants, wall decoration and small objects."""

from __future__ import annotations

import numpy as np

from salframe_house import looks
from salframe_house.mesh import MeshBuilder, circle
from salframe_house.object_class import Size, furniture
from salframe_house.scene import Material

LAMP_EMISSION = 3.0
SHADE_EMISSION = 0.8


@furniture("ceiling lamp", (0.30, 0.30, 0.05), (0.60, 1.20, 0.12), "ceiling")
def ceiling_lamp(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A housing at the ceiling with a bright underside: a long panel, or a round dish."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    glow = Material("plastic", (0.70, 0.70, 0.68), 0, LAMP_EMISSION)
    if size[1] < 0.6:
        m.cylinder((0, 0, h * 0.5), (x, y), h * 0.5, looks.WHITE, segments=18)
        m.cylinder((0, 0, 0), (x * 0.8, y * 0.8), h * 0.5, glow, top_radius=(x * 0.95, y * 0.95), segments=18)
    else:
        m.box((-x, -y, 0.01), (x, y, h), looks.WHITE)
        m.box((-x + 0.02, -y + 0.02, 0), (x - 0.02, y - 0.02, 0.01), looks.WHITE, bottom=glow)


@furniture(
    "lamp",
    (0.22, 0.22, 0.38),
    (0.34, 0.34, 0.58),
    "top",
    ("nightstand", "side table", "desk", "dresser", "cabinet", "file cabinet", "tv stand", "reception desk"),
)
def lamp(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A table lamp with a shade."""
    r, h, foot = size[0] / 2, size[2], looks.metal(rng) if rng.random() < 0.5 else looks.CERAMIC
    m.cylinder((0, 0, 0), r * 0.55, 0.03, foot, segments=12)
    m.cylinder((0, 0, 0.03), r * 0.18, h * 0.55 - 0.03, foot, segments=8)
    m.cylinder(
        (0, 0, h * 0.55), (r, size[1] / 2), h * 0.45, looks.shade(rng, SHADE_EMISSION), top_radius=r * 0.6, segments=14
    )


@furniture("floor lamp", (0.34, 0.34, 1.45), (0.46, 0.46, 1.75), "corner")
def floor_lamp(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A pole with a shade."""
    r, h, foot = size[0] / 2, size[2], looks.metal(rng)
    m.cylinder((0, 0, 0), (r * 0.75, size[1] * 0.37), 0.03, foot, segments=14)
    m.cylinder((0, 0, 0.03), 0.015, h - 0.33, foot, segments=8)
    m.cylinder(
        (0, 0, h - 0.34), (r, size[1] / 2), 0.34, looks.shade(rng, SHADE_EMISSION), top_radius=r * 0.7, segments=16
    )


@furniture("wall lamp", (0.14, 0.14, 0.22), (0.20, 0.22, 0.34), "hung", base_m=(1.65, 1.8))
def wall_lamp(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A sconce."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y * 0.5, h * 0.2), (-x + 0.02, y * 0.5, h * 0.8), looks.metal(rng))
    m.box((-x + 0.02, -0.01, h * 0.45), (0.0, 0.01, h * 0.5), looks.CHROME)
    m.cylinder(
        (x * 0.15, 0, 0), (x * 0.6, y * 0.7), h, looks.shade(rng, SHADE_EMISSION), top_radius=(x * 0.85, y), segments=12
    )


def _foliage(
    m: MeshBuilder, rng: np.random.Generator, radius: tuple[float, float], low: float, high: float, count: int
) -> None:
    """Add bent leaves that spread from the stem, each of two quads, within an elliptic cylinder."""
    look = looks.leaf(rng)
    for angle in 2 * np.pi * (np.arange(count) + rng.random(count) * 0.7) / count:
        reach, rise, width = rng.uniform(0.6, 1.0), rng.uniform(0.45, 1.0), rng.uniform(0.10, 0.2)
        out = np.array([np.cos(angle) * radius[0], np.sin(angle) * radius[1], 0.0]) * (0.95 - width / 3)
        side = np.array([-np.sin(angle) * radius[0], np.cos(angle) * radius[1], 0.0]) * width
        base, top = np.array([0, 0, low]), low + (high - low) * rise
        knee = out * reach * 0.55 + (0, 0, top)
        tip = out * reach + (0, 0, low + (top - low) * rng.uniform(0.5, 0.95))
        m.quad(np.array([base - side * 0.15, base + side * 0.15, knee + side, knee - side]), look)
        m.quad(np.array([knee - side, knee + side, tip + side * 0.2, tip - side * 0.2]), look)


@furniture("plant", (0.40, 0.40, 0.80), (0.65, 0.65, 1.50), "corner")
def plant(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A pot plant on the floor."""
    pot, r, h = looks.plastic(rng) if rng.random() < 0.6 else looks.CERAMIC, size[0] / 2, size[2]
    m.cylinder(
        (0, 0, 0), r * 0.42, 0.30, pot, top_radius=r * 0.55, segments=14, cap=Material("fabric", (0.08, 0.05, 0.03))
    )
    m.cylinder((0, 0, 0.30), 0.02, h * 0.25, looks.wood(rng), segments=6)
    _foliage(m, rng, (r, size[1] / 2), 0.30 + h * 0.1, h, int(rng.integers(14, 22)))
    _foliage(m, rng, (r * 0.7, size[1] * 0.35), 0.30 + h * 0.2, h, 7)


@furniture(
    "flowers",
    (0.20, 0.20, 0.30),
    (0.30, 0.30, 0.45),
    "top",
    (
        "dining table",
        "conference table",
        "breakfast table",
        "coffee table",
        "cabinet",
        "dresser",
        "side table",
        "reception desk",
        "bar table",
    ),
)
def flowers(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A vase with a bunch of flowers."""
    r, h = size[0] / 2, size[2]
    m.loft(
        [(circle(10) * r * 0.35, 0.0), (circle(10) * r * 0.5, h * 0.25), (circle(10) * r * 0.3, h * 0.5)], looks.CERAMIC
    )
    _foliage(m, rng, (r * 0.9, size[1] * 0.45), h * 0.45, h * 0.9, 8)
    red, green, blue = rng.uniform((0.35, 0.15, 0.15), (0.6, 0.45, 0.4)).round(3).tolist()
    petal = Material("fabric", (red, green, blue))
    for angle in 2 * np.pi * (np.arange(6) + rng.random(6)) / 6:
        cx, cy = rng.uniform(0.3, 0.75) * r * np.cos(angle), rng.uniform(0.3, 0.75) * r * np.sin(angle)
        m.cylinder((cx, cy, h * rng.uniform(0.75, 0.9)), r * 0.08, h * 0.1, petal, top_radius=r * 0.22, segments=6)


@furniture("rug", (1.10, 1.50, 0.008), (1.70, 2.30, 0.012), "centre")
def rug(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A woven rug with a border."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0), (x, y, h * 0.8), looks.fabric(rng))
    m.box((-x + 0.08, -y + 0.08, h * 0.8), (x - 0.08, y - 0.08, h), looks.rug(rng))


@furniture("picture", (0.02, 0.40, 0.35), (0.035, 1.00, 0.80), "hung", base_m=(1.2, 1.4))
def picture(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A framed painting, sometimes with a border of cardboard between painting and frame."""
    x, y, h, frame, rim = size[0] / 2, size[1] / 2, size[2], looks.wood(rng), 0.03
    m.box((-x, -y, 0), (x * 0.4, y, h), frame)
    for low, high in (
        ((-y, 0), (y, rim)),
        ((-y, h - rim), (y, h)),
        ((-y, rim), (-y + rim, h - rim)),
        ((y - rim, rim), (y, h - rim)),
    ):
        m.box((x * 0.4, *low), (x, *high), frame)
    inset = rim
    if rng.random() < 0.4:
        m.box((x * 0.4, -y + rim, rim), (x * 0.5, y - rim, h - rim), looks.PAPER)
        inset = rim + 0.06
    m.box((x * 0.4, -y + inset, inset), (x * 0.6, y - inset, h - inset), frame, front=looks.picture(rng))


@furniture("mirror", (0.02, 0.45, 0.60), (0.035, 0.90, 1.00), "hung", base_m=(1.1, 1.2))
def mirror(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A framed mirror."""
    x, y, h, frame = size[0] / 2, size[1] / 2, size[2], looks.metal(rng) if rng.random() < 0.5 else looks.wood(rng)
    m.box((-x, -y, 0), (x * 0.8, y, h), frame)
    m.box((x * 0.8, -y + 0.025, 0.025), (x, y - 0.025, h - 0.025), frame, front=looks.MIRROR)


@furniture("clock", (0.04, 0.26, 0.26), (0.06, 0.38, 0.38), "hung", base_m=(1.8, 1.95))
def clock(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A round wall clock."""
    x, rim, radius = size[0] / 2, looks.metal(rng), (size[1] / 2, size[2] / 2)
    m.cylinder((-x, 0, radius[1]), radius, size[0] * 0.8, rim, axis="x", segments=20, cap=looks.PAPER)
    hour = rng.uniform(0, 2 * np.pi)
    for angle, length, width in ((hour, 0.5, 0.012), (12 * hour, 0.75, 0.008)):
        along, across = (
            np.array([0, np.cos(angle), np.sin(angle)]),
            np.array([0, -np.sin(angle), np.cos(angle)]) * width,
        )
        centre, end = np.array([x * 0.9, 0, radius[1]]), along * radius[0] * length
        m.quad(np.array([centre - across, centre + end - across, centre + end + across, centre + across]), looks.BLACK)
    m.cylinder((x * 0.6, 0, radius[1]), 0.015, x * 0.4, looks.BLACK, axis="x", segments=8)


@furniture("whiteboard", (0.03, 1.20, 0.85), (0.05, 2.00, 1.10), "hung", base_m=(0.95, 1.05))
def whiteboard(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A board in an aluminium frame with a pen tray and a few lines of writing."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0.03), (-x + 0.015, y, h), looks.STEEL)
    m.box((-x + 0.015, -y + 0.02, 0.05), (-x + 0.017, y - 0.02, h - 0.02), looks.WHITE)
    m.box((-x + 0.015, -y * 0.5, 0.0), (x, y * 0.5, 0.03), looks.STEEL)
    red, green, blue = rng.uniform(0.02, 0.3, 3).round(3).tolist()
    ink = Material("plastic", (red, green, blue))
    for z in np.linspace(h * 0.5, h - 0.15, 3):
        start, length = rng.uniform(-0.8, 0.2) * y, rng.uniform(0.3, 0.7) * y
        m.box((-x + 0.017, start, z), (-x + 0.0175, start + length, z + 0.02), ink)


@furniture("notice board", (0.02, 0.80, 0.60), (0.03, 1.40, 0.95), "hung", base_m=(1.15, 1.3))
def notice_board(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A cork board with pinned sheets."""
    x, y, h, frame = size[0] / 2, size[1] / 2, size[2], looks.wood(rng)
    m.box((-x, -y, 0), (x * 0.6, y, h), frame)
    m.box((x * 0.6, -y + 0.03, 0.03), (x * 0.7, y - 0.03, h - 0.03), Material("fabric", (0.42, 0.30, 0.18)))
    for cy in np.arange(-y + 0.10, y - 0.28, 0.26):
        if rng.random() < 0.7:
            z = rng.uniform(0.08, max(0.09, h - 0.40))
            look = looks.picture(rng) if rng.random() < 0.4 else looks.PAPER
            m.box((x * 0.7, cy, z), (x, cy + 0.20, z + 0.28), look)


@furniture("curtain", (0.10, 1.40, 1.45), (0.14, 1.40, 1.55), "window")
def curtain(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """Two drawn-back curtains in folds on a rod; the width is the window's."""
    x, y, h, cloth = size[0] / 2, size[1] / 2, size[2], looks.linen(rng) if rng.random() < 0.6 else looks.fabric(rng)
    m.cylinder((0, -y, h - 0.03), 0.014, size[1], looks.metal(rng), axis="y", segments=8)
    panel, folds = min(0.42, size[1] * 0.24), 6
    for side in (-1, 1):
        edge = side * (y - 0.02) - (panel if side > 0 else 0.0)
        ys = edge + panel * np.arange(folds + 1) / folds
        xs = np.where(np.arange(folds + 1) % 2 == 0, -x * 0.98, x * 0.98)
        for i in range(folds):
            low, high = (xs[i], ys[i]), (xs[i + 1], ys[i + 1])
            step = np.hypot(high[0] - low[0], high[1] - low[1])
            uv = np.array([[i * step, 0], [(i + 1) * step, 0], [(i + 1) * step, h - 0.04], [i * step, h - 0.04]])
            m.quad(np.array([(*low, 0), (*high, 0), (*high, h - 0.04), (*low, h - 0.04)]), cloth, uv)


@furniture("radiator", (0.10, 0.60, 0.50), (0.14, 1.20, 0.65), "sill")
def radiator(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A ribbed panel radiator on feet."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0.12), (0.0, y, h), looks.WHITE)
    for cy in np.arange(-y + 0.02, y - 0.05, 0.08):
        m.box((0.0, cy, 0.14), (x, cy + 0.05, h - 0.02), looks.WHITE)
    for side in (-1, 1):
        m.box((-x, side * y * 0.8 - 0.02, 0), (0.0, side * y * 0.8 + 0.02, 0.12), looks.STEEL)


@furniture("fireplace", (0.35, 1.10, 1.05), (0.45, 1.40, 1.20), "wall", front_m=0.6)
def fireplace(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A surround with a mantelpiece, a dark opening and logs."""
    x, y, h, stone = size[0] / 2, size[1] / 2, size[2], looks.stone(rng)
    m.box((-x, -y, h - 0.07), (x, y, h), stone)
    for side in (-1, 1):
        low, high = sorted((side * (y - 0.04), side * (y - 0.28)))
        m.box((-x, low, 0), (x - 0.05, high, h - 0.07), stone)
    m.box((-x, -y + 0.28, h - 0.35), (x - 0.05, y - 0.28, h - 0.07), stone)
    m.box((-x, -y + 0.28, 0), (-x + 0.03, y - 0.28, h - 0.35), Material("concrete", (0.05, 0.045, 0.04)))
    m.box((-x + 0.03, -y + 0.28, 0), (x - 0.05, y - 0.28, 0.04), Material("concrete", (0.10, 0.09, 0.08)))
    for cx in (-0.06, 0.03):
        m.cylinder((cx, -0.18, 0.09), 0.045, 0.36, looks.wood(rng), axis="y", segments=8)


@furniture("trash can", (0.24, 0.24, 0.30), (0.34, 0.34, 0.60), "corner")
def trash_can(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A bin, wider at the top."""
    r, look = size[0] / 2, looks.metal(rng) if rng.random() < 0.5 else looks.plastic(rng)
    m.cylinder(
        (0, 0, 0), r * 0.78, size[2] - 0.02, look, top_radius=(r * 0.97, size[1] * 0.485), segments=14, cap=looks.BLACK
    )
    m.cylinder((0, 0, size[2] - 0.02), (r, size[1] / 2), 0.02, look, segments=14, cap=looks.BLACK)


@furniture("recycling bin", (0.32, 0.42, 0.65), (0.40, 0.55, 0.85), "wall")
def recycling_bin(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A sorted-waste bin with slots."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    m.box((-x, -y, 0), (x, y, h - 0.06), looks.paint(rng))
    for side, tint in ((-1, (0.10, 0.18, 0.38)), (1, (0.12, 0.28, 0.14))):
        low, high = sorted((0.005 * side, side * y))
        m.cushion((-x, low, h - 0.06), (x, high, h), Material("plastic", tint), 0.02)


@furniture("fire extinguisher", (0.17, 0.17, 0.48), (0.21, 0.21, 0.60), "hung", base_m=(0.75, 0.95))
def fire_extinguisher(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A red cylinder on a bracket."""
    r, h, red = size[1] / 2 * 0.82, size[2], Material("plastic", (0.42, 0.03, 0.03))
    m.box((-size[0] / 2, -0.05, h * 0.3), (-r, 0.05, h * 0.5), looks.STEEL)
    m.cylinder((0.01, 0, 0), r, h * 0.72, red, segments=14)
    m.cylinder((0.01, 0, h * 0.72), r, h * 0.12, red, top_radius=r * 0.35, segments=14)
    m.box((-0.03, -size[1] / 2, h * 0.84), (size[0] / 2, 0.02, h), looks.BLACK)
    m.box((r * 0.9, -r * 0.4, h * 0.25), (r + 0.011, r * 0.4, h * 0.5), looks.PAPER)


@furniture("umbrella stand", (0.22, 0.22, 0.70), (0.28, 0.28, 0.88), "corner")
def umbrella_stand(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A tube with two umbrellas."""
    r = size[0] / 2
    m.cylinder((0, 0, 0), (r, size[1] / 2), 0.48, looks.metal(rng), segments=14, cap=looks.BLACK)
    for shift in (-0.35, 0.4):
        m.cylinder(
            (shift * r, shift * r * 0.5, 0.48), 0.03, size[2] - 0.62, looks.fabric(rng), top_radius=0.015, segments=6
        )
        m.cylinder((shift * r, shift * r * 0.5, size[2] - 0.14), 0.012, 0.14, looks.wood(rng), segments=6)


@furniture("flip chart", (0.58, 0.66, 1.65), (0.66, 0.74, 1.85), "corner")
def flip_chart(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A tripod with a pad of paper."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    leg = np.array([[-0.015, -0.015], [0.015, -0.015], [0.015, 0.015], [-0.015, 0.015]])
    for foot in ((x - 0.02, -y + 0.02), (x - 0.02, y - 0.02), (-x + 0.02, 0.0)):
        m.loft([(leg + foot, 0.0), (leg + np.array([0.0, foot[1] * 0.3]), h - 0.05)], looks.STEEL)
    low, high = 0.75, h - 0.02
    lower, upper = (0.06 + (x - 0.06) * (h - z) / h for z in (low, high))  # the pad leans back along the front legs
    pad = np.array([[lower, -y, low], [lower, y, low], [upper, y, high], [upper, -y, high]])
    m.quad(pad, looks.PAPER)
    m.quad((pad - (0.02, 0, 0))[::-1], looks.WHITE)
    m.box((0.0, -y, h - 0.02), (0.09, y, h), looks.STEEL)


@furniture("brochure stand", (0.35, 0.45, 1.10), (0.42, 0.60, 1.40), "corner")
def brochure_stand(m: MeshBuilder, size: Size, rng: np.random.Generator) -> None:
    """A stand with rows of brochures."""
    x, y, h, frame = size[0] / 2, size[1] / 2, size[2], looks.metal(rng)
    m.box((-x, -y, 0), (x, y, 0.03), frame)
    m.box((-x, -y, 0.03), (-x + 0.03, y, h), frame)
    for step, z in enumerate(np.linspace(0.25, h - 0.30, 3)):
        depth = 0.20 - 0.05 * step
        m.box((-x + 0.03, -y + 0.02, z), (-x + 0.03 + depth, y - 0.02, z + 0.02), frame)
        m.box(
            (-x + 0.03 + depth - 0.03, -y + 0.04, z + 0.02), (-x + 0.03 + depth, y - 0.04, z + 0.24), looks.books(rng)
        )
