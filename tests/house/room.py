"""A small scene for the renderer's tests, made here from boxes so that it depends on nothing of the generator."""

from __future__ import annotations

import numpy as np
from salframe_house.scene import Light, Material, Scene

ROOM_M = np.array([6.0, 5.0, 2.7])
TABLE = 1

_FACES = (  # axis of the normal, side, axes of u and v
    (0, 1, 1, 2),
    (0, 0, 1, 2),
    (1, 1, 0, 2),
    (1, 0, 0, 2),
    (2, 1, 0, 1),
    (2, 0, 0, 1),
)


class SceneBuilder:
    """Collects boxes and lights into a Scene."""

    def __init__(self) -> None:
        self._quads: list[tuple[np.ndarray, np.ndarray, Material, int]] = []
        self.lights: list[Light] = []

    def box(self, low, high, material: Material, instance: int = 0, **faces: Material | None) -> None:
        """An axis-aligned box; `x1`, `x0`, `y1`, `y0`, `z1`, `z0` give a face another look, None leaves it out."""
        low, high = np.asarray(low, float), np.asarray(high, float)
        for (_, side, u, v), name in zip(_FACES, ("x1", "x0", "y1", "y0", "z1", "z0"), strict=True):
            look = faces.get(name, material)
            if look is None:
                continue
            corners = np.tile(high if side else low, (4, 1))
            uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float) * (high - low)[[u, v]]
            for axis_uv, values in ((u, uv[:, 0]), (v, uv[:, 1])):
                corners[:, axis_uv] = low[axis_uv] + values
            self._quads.append((corners, uv, look, instance))

    def scene(self) -> Scene:
        materials = tuple(dict.fromkeys(look for _, _, look, _ in self._quads))
        triangles = np.array([[0, 1, 2], [0, 2, 3]])
        return Scene(
            vertices_m=np.concatenate([corners for corners, *_ in self._quads]).astype(np.float32),
            triangles=np.concatenate([triangles + 4 * i for i in range(len(self._quads))]).astype(np.int32),
            uv_m=np.concatenate([uv[triangles] for _, uv, _, _ in self._quads]).astype(np.float32),
            material_index=np.repeat([materials.index(look) for _, _, look, _ in self._quads], 2).astype(np.int32),
            instance_id=np.repeat([instance for *_, instance in self._quads], 2).astype(np.int32),
            materials=materials,
            lights=tuple(self.lights),
        )


def box_room() -> Scene:
    """A bare room with its lowest corner at the origin, and one lamp at the middle of its ceiling."""
    build = SceneBuilder()
    ceiling, floor = Material("ceiling", (0.7, 0.7, 0.7)), Material("parquet", (0.42, 0.30, 0.19))
    build.box((0, 0, 0), ROOM_M, Material("plaster", (0.6, 0.6, 0.58)), z1=ceiling, z0=floor)
    build.lights.append(Light((3.0, 2.5, 2.65), (0.6, 0, 0), (0, 0.6, 0), "lamp", "room"))
    return build.scene()


def furnished_room() -> Scene:
    """The box room with a table (instance 1), a shelf that shades a corner, pictures, a window, a mirror and a lamp
    with a housing."""
    build = SceneBuilder()
    wall, wood = Material("plaster", (0.62, 0.60, 0.55), 1), Material("wood", (0.42, 0.27, 0.15), 1)
    width, depth, height = ROOM_M
    build.box(
        (0, 0, 0),
        ROOM_M,
        wall,
        y0=None,
        z1=Material("ceiling", (0.7, 0.7, 0.7)),
        z0=Material("parquet", (0.42, 0.30, 0.19)),
    )
    for low, high in (
        ((0, 0), (2, height)),
        ((4, 0), (width, height)),
        ((2, 0), (4, 0.9)),
        ((2, 2.2), (4, height)),
    ):  # wall around a window
        build.box((low[0], -0.2, low[1]), (high[0], 0, high[1]), wall)
    build.box((2, -0.15, 0.9), (4, -0.14, 2.2), Material("glass", (0.5, 0.55, 0.55)))
    build.lights.append(Light((3, -0.05, 1.55), (2, 0, 0), (0, 0, 1.3), "window", "room"))

    build.box((2.3, 2.0, 0.70), (3.7, 2.9, 0.74), wood, TABLE)
    for x in (2.35, 3.60):
        for y in (2.05, 2.80):
            build.box((x, y, 0), (x + 0.05, y + 0.05, 0.70), wood, TABLE)
    build.box((0.01, 0.6, 0), (0.4, 1.8, 2.0), Material("laminate", (0.5, 0.45, 0.38)), 2)
    for level in range(4):
        build.box(
            (0.40, 0.65, 0.1 + 0.48 * level),
            (0.42, 1.75, 0.5 + 0.48 * level),
            Material("books", (0.36, 0.30, 0.26), 3 + level),
            3 + level,
        )
    build.box((4.6, 3.9, 0.0), (5.95, 4.95, 0.45), Material("fabric", (0.30, 0.36, 0.30), 2), 7)
    build.box((1.6, 1.6, 0.001), (4.4, 3.4, 0.012), Material("rug", (0.42, 0.24, 0.20), 5), 8)
    for i, (x, y) in enumerate(((1.2, depth), (3.2, depth), (4.6, depth))):
        build.box(
            (x, y - 0.03, 1.3), (x + 0.8, y - 0.001, 1.9), wood, 9 + i, y0=Material("picture", (0.40, 0.38, 0.35), i)
        )
    build.box((width - 0.02, 1.5, 0.9), (width - 0.001, 2.5, 1.9), Material("mirror", (0.7, 0.72, 0.72)), 12)
    build.box((5.2, 0.3, 0.0), (5.7, 1.3, 0.72), Material("plastic", (0.6, 0.6, 0.6)), 13)
    build.box(
        (5.65, 0.5, 0.85),
        (5.68, 1.1, 1.25),
        Material("plastic", (0.04, 0.04, 0.045)),
        14,
        x0=Material("screen", (0.10, 0.11, 0.13), 2, 0.25),
    )
    build.box((2.7, 2.2, 2.60), (3.3, 2.8, 2.69), Material("fabric", (0.7, 0.69, 0.66), 0, 1.0), 15)
    build.lights.append(Light((3.0, 2.5, 2.59), (0.6, 0, 0), (0, 0.6, 0), "lamp", "room", 15))
    build.box((0.15, 4.4, 0.0), (0.20, 4.45, 1.5), Material("metal", (0.5, 0.5, 0.5)), 16)
    build.box((0.05, 4.3, 1.4), (0.30, 4.55, 1.7), Material("fabric", (0.68, 0.60, 0.46), 1, 1.0), 16)
    build.lights.append(Light((0.175, 4.425, 1.4), (0.2, 0, 0), (0, 0.2, 0), "lamp", "room", 16))
    return build.scene()
