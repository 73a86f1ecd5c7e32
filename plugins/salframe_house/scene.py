"""Scene description between the generator and the renderer: triangles, instances, materials and lights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Material:
    """Appearance of a surface.

    Attributes:
        texture: Name of an entry of `textures.TEXTURES` (plaster, wood, fabric, tile, carpet, metal, leaf, picture,
            screen, ...), a procedural texture that repeats in metric texture coordinates.
        color_rgb: Mean linear albedo, each in [0, 1].
        variant: Seed of the pattern, so that two rugs differ.
        emission: Linear radiance emitted in addition to the reflected light (lamp shades, lit windows, screens).
    """

    texture: str
    color_rgb: tuple[float, float, float]
    variant: int = 0
    emission: float = 0.0


@dataclass(frozen=True)
class Light:
    """A rectangular area light that faces down (a lamp) or inwards (a window).

    Attributes:
        position_m: Centre in the world frame.
        edge_u_m: First edge of the rectangle, (3,).
        edge_v_m: Second edge of the rectangle, (3,).
        kind: "lamp" or "window"; a lighting condition scales the light by its kind.
        room: Id of the room of the light. Light through doorways is part of the indirect light of the renderer.
        instance_id: Instance id of the lamp; 0 for a window.
    """

    position_m: tuple[float, float, float]
    edge_u_m: tuple[float, float, float]
    edge_v_m: tuple[float, float, float]
    kind: str
    room: str
    instance_id: int = 0


@dataclass(frozen=True)
class Scene:
    """A triangle soup in the world frame (metres, z up).

    Attributes:
        vertices_m: Vertices, (V, 3) float32.
        triangles: Vertex indices, (F, 3) int32.
        uv_m: Texture coordinates at the corners in metres, (F, 3, 2) float32.
        material_index: Index into `materials`, (F,) int32.
        instance_id: Instance ids, (F,) int32; 0 for structure (walls, floor, ceiling, door frames).
        materials: Materials of the scene.
        lights: Lights of the scene.
    """

    vertices_m: np.ndarray
    triangles: np.ndarray
    uv_m: np.ndarray
    material_index: np.ndarray
    instance_id: np.ndarray
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
