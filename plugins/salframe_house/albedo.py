"""Albedo of surfaces: the textures of a scene in one mip-mapped atlas, sampled at the footprint of a pixel."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from salframe_house.scene import Scene
from salframe_house.textures import MAX_PATTERN, TILE, texture_kind, texture_tile, wear_tile
from salframe_house.tracing import RayHits, chunks, rows

_LEVELS = 6
# Size of a slot: a tile and its smaller mip levels, each with a border of one texel.
_SLOT_ROWS, _SLOT_COLUMNS = TILE + 2, TILE + TILE // 2 + 4
_ATLAS_COLUMNS = 16
_STEP = MAX_PATTERN / 65535
_SHARPNESS = 0.5  # pixels over which a texture is averaged: sharper than 1 pixel, without visible aliasing
_WEAR_M = 4.7
_MAX_ALBEDO = 0.85


class SurfaceColor:
    """Linear albedo of the surfaces of a scene, filtered over the area that a pixel covers.

    Attributes:
        mean: Albedo of each triangle, averaged over its texture, (F, 3) float32.

    Raises:
        DataError: A material names an unknown texture.
    """

    def __init__(self, scene: Scene):
        names = sorted({(material.texture, material.variant) for material in scene.materials})
        slot_of = {name: slot for slot, name in enumerate(names)}
        self._atlas = _atlas([_texture_slot(*name) for name in names])
        # The wear is scaled to values around 0.5. Its channels are equal, so one is stored.
        self._wear = np.ascontiguousarray(_slot(np.repeat(wear_tile()[..., None] * 0.2 + 1, 3, axis=2))[..., :1])

        material = scene.material_index
        color = np.array([m.color_rgb for m in scene.materials], np.float32)[material]
        slot = np.array([slot_of[m.texture, m.variant] for m in scene.materials], np.int32)[material]
        wear_contrast = np.array([texture_kind(m.texture).wear for m in scene.materials], np.float32)[material]
        uv_m = scene.uv_m.astype(np.float32) + _anchors_m(scene)[:, None]
        extent_m = _extents_m(scene)
        is_fixed = np.array([texture_kind(m.texture).fixed for m in scene.materials])[material]
        uv_m[is_fixed] = scene.uv_m[is_fixed]
        edges_m = (uv_m[:, 1:] - uv_m[:, :1]).reshape(-1, 4)
        corner = np.stack(np.divmod(slot, _ATLAS_COLUMNS), axis=1) * [_SLOT_ROWS, _SLOT_COLUMNS]
        columns = uv_m[:, 0], edges_m, extent_m, extent_m.min(axis=1), corner, wear_contrast, color
        self._of_triangle = np.asfortranarray(np.column_stack(columns).astype(np.float32))
        self.mean = self._of_triangle[:, -3:]

    def albedo(self, surface: RayHits, pixel_rad: float) -> np.ndarray:
        """Return the albedo at ray hits, averaged over the pixel, (N, 3) float64 in Fortran order.

        Args:
            surface: Hits of the rays.
            pixel_rad: Angle between the rays of adjacent pixels.
        """
        albedo = np.empty((3, len(surface)))
        for part in chunks(len(surface)):
            # The footprint is an ellipse that is longer on slanted surfaces. The geometric mean of its axes is a
            # compromise between blur and aliasing.
            cosine = np.abs(np.einsum("ij,ij->i", surface.normal[part], surface.direction[part]))
            footprint_m = np.fmax(surface.range_m[part], 0) * np.float32(pixel_rad) / np.sqrt(np.maximum(cosine, 0.06))
            albedo[:, part] = self._albedo(
                surface.triangle[part], surface.weight_u[part], surface.weight_v[part], footprint_m
            )
        return albedo.T

    def _albedo(
        self, triangle: np.ndarray, weight_u: np.ndarray, weight_v: np.ndarray, footprint_m: np.ndarray
    ) -> np.ndarray:
        """Compute the albedo of one chunk of hits, (3, N)."""
        u, v, u1, v1, u2, v2, extent_u, extent_v, extent, top, left, wear_contrast, *color = rows(
            self._of_triangle, triangle
        ).T
        u, v = (at + along * weight_u + across * weight_v for at, along, across in ((u, u1, u2), (v, v1, v2)))
        pattern = _lookup(self._atlas, top, left, u / extent_u, v / extent_v, footprint_m / extent)
        u, v, footprint = (length_m / np.float32(_WEAR_M) for length_m in (u, v, footprint_m))
        factor = _lookup(self._wear, np.zeros_like(top), np.zeros_like(left), u, v, footprint)
        factor -= 1
        factor *= wear_contrast
        factor *= 5
        factor += 1
        pattern *= factor
        pattern *= color
        return np.minimum(pattern, np.float32(_MAX_ALBEDO), out=pattern)


def _anchors_m(scene: Scene) -> np.ndarray:
    """Return the texture shift of each triangle, (F, 2) float32, in metres.

    The shift makes surfaces whose texture coordinates all start at (0, 0) look different. The shift of furniture
    depends on its material and therefore moves with it; the shift of structure depends on the world position of its
    texture origin.
    """
    material = np.array([_hash_unit(m.variant, *(int(c * 1000) for c in m.color_rgb)) for m in scene.materials])[
        scene.material_index
    ]
    corner, uv = scene.vertices_m[scene.triangles].astype(np.float64), scene.uv_m.astype(np.float64)
    edges, uv_edges = corner[:, 1:] - corner[:, :1], uv[:, 1:] - uv[:, :1]
    singular = np.abs(np.linalg.det(uv_edges)) < 1e-12
    uv_edges[singular] = np.eye(2)
    world_per_uv = np.linalg.solve(uv_edges, edges)
    origin = corner[:, 0] - np.einsum("fi,fij->fj", uv[:, 0], world_per_uv)
    # The offset avoids the multiples of a millimetre used in buildings: all triangles of a wall round to one value.
    place = np.floor(origin * 100 + 0.2718).astype(np.int64)
    structure = _hash_unit(*place.T)
    shift = np.where(scene.instance_id == 0, structure, material)
    return np.stack([shift, shift * 7 % 1], axis=1).astype(np.float32) * np.float32(_WEAR_M)


def _hash_unit(*values: np.ndarray | int) -> np.ndarray:
    """Hash integers to a pseudo-random float64 in [0, 1)."""
    mixed: np.ndarray = np.array(0x9E3779B97F4A7C15, np.uint64)
    with np.errstate(over="ignore"):
        for value in values:
            mixed = (mixed ^ np.asarray(value, np.int64).astype(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = mixed ^ (mixed >> np.uint64(29))
    return (mixed >> np.uint64(11)).astype(np.float64) / 2.0**53


def _extents_m(scene: Scene) -> np.ndarray:
    """Return the size of a texture tile on each triangle, (F, 2) float32, in metres.

    Where a texture fills its surface, the size is the uv range of the instance and material.
    """
    # None becomes NaN.
    extent = np.array([texture_kind(m.texture).extent_m for m in scene.materials], float)[scene.material_index]
    group = scene.instance_id.astype(np.int64) * len(scene.materials) + scene.material_index
    _, group = np.unique(group, return_inverse=True)
    max_uv_m = np.zeros((group.max() + 1, 2))
    np.maximum.at(max_uv_m, group, scene.uv_m.max(axis=1))
    return np.where(np.isnan(extent), np.maximum(max_uv_m[group], 1e-3), extent).astype(np.float32)


def _atlas(slots: list[np.ndarray]) -> np.ndarray:
    """Return a uint16 image of all slots, `_ATLAS_COLUMNS` slots in a row."""
    height = -(-len(slots) // _ATLAS_COLUMNS) * _SLOT_ROWS
    atlas = np.zeros((height, min(len(slots), _ATLAS_COLUMNS) * _SLOT_COLUMNS, 4), np.uint16)
    for number, slot in enumerate(slots):
        row, column = divmod(number, _ATLAS_COLUMNS)
        atlas[row * _SLOT_ROWS :, column * _SLOT_COLUMNS :][:_SLOT_ROWS, :_SLOT_COLUMNS] = slot
    return atlas


@lru_cache(maxsize=512)
def _texture_slot(name: str, variant: int) -> np.ndarray:
    return _slot(texture_tile(name, variant))


def _slot(tile: np.ndarray) -> np.ndarray:
    """Return a tile and its mip levels as a (_SLOT_ROWS, _SLOT_COLUMNS, 4) uint16 image.

    The full tile is at the left and the smaller levels are in a column at its right. The fourth channel is empty:
    OpenCV samples four channels in half the time of three.
    """
    slot = np.zeros((_SLOT_ROWS, _SLOT_COLUMNS, 4), np.uint16)
    level = tile
    for top, left in zip(_LEVEL_ROW, _LEVEL_COLUMN, strict=True):
        side = len(level) + 2
        bordered = np.pad(level, ((1, 1), (1, 1), (0, 0)), mode="wrap")
        slot[top : top + side, left : left + side, :3] = bordered / _STEP + 0.5
        level = level.reshape(len(level) // 2, 2, len(level) // 2, 2, 3).mean(axis=(1, 3))
    return slot


_LEVEL_SIDE = TILE >> np.arange(_LEVELS)
_LEVEL_COLUMN = np.where(np.arange(_LEVELS) == 0, 0, TILE + 2)
_LEVEL_ROW = np.concatenate([[0], np.cumsum(np.concatenate([[0], _LEVEL_SIDE[1:-1] + 2]))])
# The centre of a texel lies at +0.5. The border of one texel adds 1; the integer centres of `remap` subtract 0.5.
_SIDE, _LEFT, _TOP = (a.astype(np.float32) for a in (_LEVEL_SIDE, _LEVEL_COLUMN + 0.5, _LEVEL_ROW + 0.5))


def _lookup(
    atlas: np.ndarray, top: np.ndarray, left: np.ndarray, u: np.ndarray, v: np.ndarray, footprint: np.ndarray
) -> np.ndarray:
    """Return texture patterns, blended between the two mip levels nearest to the footprint.

    Args:
        atlas: Atlas image.
        top: Atlas row of each slot, (N,).
        left: Atlas column of each slot, (N,).
        u: Texture coordinate in tiles, (N,).
        v: Texture coordinate in tiles, (N,).
        footprint: Size of the area that a pixel covers, in tiles, (N,).

    Returns:
        (3, N) float64; (1, N) for an atlas of one channel.
    """
    level = np.clip(np.log2(np.maximum(footprint * np.float32(TILE * _SHARPNESS), 1)), 0, _LEVELS - 1.001)
    fine = level.astype(np.intp)
    u, v = u - np.floor(u), v - np.floor(v)
    near, far = (_sample(atlas, top, left, u, v, at) for at in (fine, fine + 1))
    far -= near
    pattern: np.ndarray = far * (level - fine)
    pattern += near
    pattern *= np.float32(_STEP)
    return pattern


def _sample(
    atlas: np.ndarray, top: np.ndarray, left: np.ndarray, u: np.ndarray, v: np.ndarray, level: np.ndarray
) -> np.ndarray:
    """Sample one mip level per point: (3, N) float32; (1, N) for an atlas of one channel."""
    side = _SIDE.take(level)
    column, row = u * side, v * side
    column += left + _LEFT.take(level)
    row += top + _TOP.take(level)
    samples = cv2.remap(atlas, column[None], row[None], cv2.INTER_LINEAR)
    return samples.reshape(len(row), -1).T[:3].astype(np.float32, order="C")
