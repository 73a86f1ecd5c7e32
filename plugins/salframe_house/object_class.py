"""Furniture classes: size, placement and mesh builder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from salframe_house.mesh import MeshBuilder

Size = tuple[float, float, float]
Build = Callable[[MeshBuilder, Size, np.random.Generator], None]


@dataclass(frozen=True)
class ObjectClass:
    """A class of objects.

    Object frame: origin in the middle of the footprint at the base, front along +x, z up.

    Attributes:
        label: Name of the class.
        low_m: Minimum size: depth along x, width along y, height.
        high_m: Maximum size.
        stand: Placement: "wall" (back to a wall), "corner", "centre" (of the free floor), "front", "around" or "beside"
            a partner, "top" (on a partner), "hung" (on a wall), "window" (hung over a window), "sill" (under a window,
            or else at a wall), "ceiling".
        build: Builder of the mesh; `build(mesh, size_m, rng)` fills exactly a box of `size_m`.
        partners: Classes of the objects that this class is placed relative to.
        base_m: Range of the height of the base, for "hung".
        front_m: Depth of the floor in front of the object that other furniture leaves free.
        gap_m: Range of the distance to a partner.
    """

    label: str
    low_m: Size
    high_m: Size
    stand: str
    build: Build
    partners: tuple[str, ...] = ()
    base_m: tuple[float, float] = (0.0, 0.0)
    front_m: float = 0.0
    gap_m: tuple[float, float] = (0.02, 0.10)

    def draw_size(self, seed: int) -> Size:
        """Return the size of the object with this seed, in metres.

        Sizes are whole centimetres; sizes below 5 cm are rounded to millimetres.
        """
        size = np.random.default_rng((seed, 1)).uniform(self.low_m, self.high_m)
        length, width, height = (round(float(side), 2 if side > 0.05 else 3) for side in size)
        return length, width, height


CLASSES: dict[str, ObjectClass] = {}


def furniture(
    label: str,
    low_m: Size,
    high_m: Size,
    stand: str,
    partners: tuple[str, ...] = (),
    base_m: tuple[float, float] = (0.0, 0.0),
    front_m: float = 0.0,
    gap_m: tuple[float, float] = (0.02, 0.10),
) -> Callable[[Build], Build]:
    """Register the decorated function as the mesh builder of a class; see `ObjectClass` for the parameters."""

    def register(build: Build) -> Build:
        CLASSES[label] = ObjectClass(label, low_m, high_m, stand, build, partners, base_m, front_m, gap_m)
        return build

    return register
