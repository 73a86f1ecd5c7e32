"""Material palettes of furniture: muted colours of real interiors, in linear albedo."""

from __future__ import annotations

import numpy as np

from salframe_house.scene import Material

_WOODS = (
    (0.42, 0.27, 0.15),
    (0.30, 0.18, 0.10),
    (0.55, 0.40, 0.25),
    (0.62, 0.49, 0.33),
    (0.20, 0.12, 0.08),
    (0.48, 0.33, 0.22),
)
_FABRICS = (
    (0.35, 0.35, 0.37),
    (0.20, 0.24, 0.32),
    (0.45, 0.38, 0.30),
    (0.30, 0.36, 0.30),
    (0.42, 0.24, 0.20),
    (0.55, 0.52, 0.46),
    (0.16, 0.17, 0.19),
    (0.25, 0.35, 0.40),
    (0.48, 0.40, 0.22),
)
_LEATHERS = ((0.08, 0.07, 0.07), (0.25, 0.14, 0.08), (0.35, 0.24, 0.15), (0.45, 0.42, 0.38))
_METALS = ((0.50, 0.50, 0.51), (0.25, 0.25, 0.26), (0.08, 0.08, 0.09), (0.60, 0.58, 0.54))
_PLASTICS = (
    (0.06, 0.06, 0.07),
    (0.60, 0.60, 0.60),
    (0.30, 0.31, 0.33),
    (0.65, 0.62, 0.56),
    (0.20, 0.28, 0.38),
    (0.45, 0.22, 0.18),
)
_PAINTS = (
    (0.68, 0.68, 0.66),
    (0.55, 0.56, 0.56),
    (0.40, 0.42, 0.44),
    (0.58, 0.53, 0.44),
    (0.32, 0.40, 0.42),
    (0.42, 0.45, 0.38),
)
_LINENS = ((0.70, 0.69, 0.67), (0.62, 0.60, 0.55), (0.45, 0.50, 0.56), (0.56, 0.47, 0.42), (0.42, 0.46, 0.42))
_STONES = ((0.60, 0.59, 0.57), (0.20, 0.20, 0.21), (0.45, 0.42, 0.38), (0.35, 0.36, 0.37))
_LEAVES = ((0.10, 0.22, 0.07), (0.14, 0.28, 0.10), (0.08, 0.18, 0.08), (0.20, 0.28, 0.12))

VARIANTS = 6  # patterns per texture in a building: enough for variety, few enough for the texture cache
UNIQUE_VARIANTS = 24  # patterns of pictures, rugs, books and screens, which differ only by their pattern

CERAMIC = Material("plastic", (0.74, 0.74, 0.73))
CHROME = Material("metal", (0.62, 0.62, 0.63))
STEEL = Material("metal", (0.46, 0.46, 0.47), 1)
BLACK = Material("plastic", (0.04, 0.04, 0.045))
WHITE = Material("plastic", (0.68, 0.68, 0.67))
RUBBER = Material("plastic", (0.09, 0.09, 0.09), 2)
MIRROR = Material("mirror", (0.70, 0.72, 0.72))
GLASS = Material("glass", (0.50, 0.55, 0.55))
PAPER = Material("paper", (0.72, 0.71, 0.68))


def _draw(rng: np.random.Generator, texture: str, palette, variants: int = VARIANTS, emission: float = 0.0) -> Material:
    """Draw a material: a colour of the palette, varied in brightness and hue, and a pattern variant."""
    base = np.array(palette[rng.integers(len(palette))])
    tone = base * rng.uniform(0.85, 1.15) * rng.uniform(0.95, 1.05, 3)
    red, green, blue = tone.clip(0.02, 0.8).round(3).tolist()
    return Material(texture, (red, green, blue), int(rng.integers(variants)), emission)


def wood(rng: np.random.Generator) -> Material:
    """Return solid or veneered wood."""
    return _draw(rng, "wood", _WOODS)


def board(rng: np.random.Generator) -> Material:
    """Return a random material for the boards of cabinets and office furniture: wood or paint."""
    return wood(rng) if rng.random() < 0.6 else _draw(rng, "laminate", _PAINTS)


def fabric(rng: np.random.Generator) -> Material:
    """Return upholstery cloth."""
    return _draw(rng, "fabric", _FABRICS)


def upholstery(rng: np.random.Generator) -> Material:
    """Return cloth or leather."""
    return fabric(rng) if rng.random() < 0.7 else _draw(rng, "leather", _LEATHERS)


def linen(rng: np.random.Generator) -> Material:
    """Return a random cloth for bedding, towels and curtains."""
    return _draw(rng, "fabric", _LINENS)


def metal(rng: np.random.Generator) -> Material:
    """Return a random metal for frames and legs."""
    return _draw(rng, "metal", _METALS)


def plastic(rng: np.random.Generator) -> Material:
    """Return the plastic of device housings and bins."""
    return _draw(rng, "plastic", _PLASTICS)


def paint(rng: np.random.Generator) -> Material:
    """Return painted fronts or sheet metal."""
    return _draw(rng, "plastic", _PAINTS)


def stone(rng: np.random.Generator) -> Material:
    """Return the stone of worktops."""
    return _draw(rng, "marble", _STONES)


def leaf(rng: np.random.Generator) -> Material:
    """Return the leaves of a plant."""
    return _draw(rng, "leaf", _LEAVES)


def rug(rng: np.random.Generator) -> Material:
    """Return a patterned rug."""
    return _draw(rng, "rug", _FABRICS, UNIQUE_VARIANTS)


def books(rng: np.random.Generator) -> Material:
    """Return the spines of a row of books or folders."""
    return _draw(rng, "books", ((0.36, 0.30, 0.26), (0.30, 0.32, 0.36), (0.42, 0.40, 0.36)), UNIQUE_VARIANTS)


def picture(rng: np.random.Generator) -> Material:
    """Return the material of a random picture on a wall (a painting or an art print)."""
    return _draw(rng, "picture", ((0.40, 0.38, 0.35), (0.34, 0.36, 0.40), (0.46, 0.42, 0.36)), UNIQUE_VARIANTS)


def screen(rng: np.random.Generator) -> Material:
    """Return a display that is switched on."""
    return _draw(rng, "screen", ((0.10, 0.11, 0.13),), UNIQUE_VARIANTS, emission=0.25)


def shade(rng: np.random.Generator, emission: float) -> Material:
    """Return a translucent lamp shade."""
    return _draw(rng, "fabric", ((0.70, 0.66, 0.56), (0.68, 0.60, 0.46), (0.70, 0.69, 0.66)), emission=emission)
