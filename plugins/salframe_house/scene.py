"""What the generator hands to the renderer: triangles with instances, materials and lights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Material:
    """Surface look: a procedural texture of a kind, tinted, repeated in metric texture coordinates.

    `texture` names an entry of `textures.TEXTURES` (plaster, wood, fabric, tile, carpet, metal, leaf, picture, screen,
    ...); `color_rgb` is its mean linear albedo, each in [0, 1]; `variant` seeds the pattern, so that two rugs differ;
    `emission` is linear radiance added to what the surface reflects (lamp shades, lit windows, screens).
    """

    texture: str
    color_rgb: tuple[float, float, float]
    variant: int = 0
    emission: float = 0.0


@dataclass(frozen=True)
class Light:
    """A rectangular area light facing down (a lamp) or inwards (a window): `position_m` is its centre, world frame.

    `edge_u_m`, `edge_v_m` (3,) span it; `kind` is "lamp" or "window", by which a lighting condition scales it; `room`
    is the id of the room it stands in, since light through a doorway is left to the renderer's indirect term.
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

    vertices_m (V, 3) float32; triangles (F, 3) int32; uv_m (F, 3, 2) float32 texture coordinates in metres at the
    corners; material_index (F,) int32 into `materials`; instance_id (F,) int32, 0 for structure (walls, floor, ceiling,
    doors' frames).
    """

    vertices_m: np.ndarray
    triangles: np.ndarray
    uv_m: np.ndarray
    material_index: np.ndarray
    instance_id: np.ndarray
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
