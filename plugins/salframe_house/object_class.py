"""What a class of furniture is: its size, where it stands, and how its mesh is built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from salframe_house.mesh import MeshBuilder

Size = tuple[float, float, float]
Build = Callable[[MeshBuilder, Size, np.random.Generator], None]


@dataclass(frozen=True)
class ObjectClass:
    """A class of objects. Frame of an object: origin in the middle of its footprint at its base, front along +x, z up.

    `low_m`, `high_m`: range of (depth along x, width along y, height). `build(mesh, size_m, rng)` fills exactly that
    box. `stand` is where it goes: "wall" (its back to one), "corner", "centre" (of the free floor), "front", "around"
    or "beside" one of its `partners`, "top" (on one of them), "hung" (on a wall, base between `base_m`), "window" (hung
    over one), "sill" (under a window, else a wall), "ceiling". `front_m` is the depth of floor in front that other
    furniture leaves free, `gap_m` the range of distances to a partner.
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
        """The size_m of the object with this seed, whole centimetres (rounded to millimetres below 5 cm)."""
        drawn = np.random.default_rng((seed, 1)).uniform(self.low_m, self.high_m)
        length, width, height = (round(float(side), 2 if side > 0.05 else 3) for side in drawn)
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
    """Register the decorated function as the builder of a class."""

    def register(build: Build) -> Build:
        CLASSES[label] = ObjectClass(label, low_m, high_m, stand, build, partners, base_m, front_m, gap_m)
        return build

    return register
