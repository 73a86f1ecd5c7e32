"""Colour of surfaces: the scene's textures in one mip-mapped atlas, looked up at the pixel's footprint."""

from __future__ import annotations

import cv2
import numpy as np

from salframe_house.scene import Scene
from salframe_house.textures import MAX_PATTERN, TILE, texture_kind, texture_tile, wear_tile
from salframe_house.tracing import Surface, chunks

_LEVELS = 6
_SLOT_ROWS, _SLOT_COLUMNS = (
    TILE + 2,
    TILE + TILE // 2 + 4,
)  # a tile and its smaller levels, each with a border of one texel
_ATLAS_COLUMNS = 16
_STEP = MAX_PATTERN / 65535
_SHARPNESS = 0.5  # pixels over which a texture is averaged: sharper than 1, short of visible aliasing
_WEAR_M = 4.7
_LARGEST_ALBEDO = 0.85
_REMAP_WIDTH = 1024  # cv2.remap takes images with sides below 32768


class SurfaceColor:
    """Linear albedo of a scene's surfaces, filtered over what a pixel covers. Raises DataError on unknown textures."""

    def __init__(self, scene: Scene):
        names = sorted({(material.texture, material.variant) for material in scene.materials})
        slot_of = {name: slot for slot, name in enumerate(names)}
        self._atlas = _atlas([texture_tile(*name) for name in names])
        # The wear is kept around 0.5, in three channels only for the sake of one lookup routine.
        self._wear = _atlas([np.repeat(wear_tile()[..., None] * 0.2 + 1, 3, axis=2)])

        material = scene.material_index
        self._color = np.array([m.color_rgb for m in scene.materials], np.float32)[material]
        self._slot = np.array([slot_of[m.texture, m.variant] for m in scene.materials], np.int32)[material]
        self._wear_contrast = np.array([texture_kind(m.texture).wear for m in scene.materials], np.float32)[material]
        self._uv_m = scene.uv_m.astype(np.float32) + _anchors_m(scene)[:, None]
        self._extent_m = _extents_m(scene)
        fixed = np.array([texture_kind(m.texture).fixed for m in scene.materials])[material]
        self._uv_m[fixed] = scene.uv_m[fixed]
        self.mean = self._color
        """(F, 3) float32 albedo of each triangle, averaged over its texture."""

    def albedo(self, surface: Surface, pixel_rad: float) -> np.ndarray:
        """(N, 3) float64 linear albedo where rays `pixel_rad` apart hit, averaged over the pixel."""
        albedo = np.empty((len(surface), 3))
        for part in chunks(len(surface)):
            albedo[part] = self._albedo(surface.take(part), pixel_rad)
        return albedo

    def _albedo(self, surface: Surface, pixel_rad: float) -> np.ndarray:
        triangle = surface.triangle
        corner = self._uv_m[triangle]
        uv_m = corner[:, 0] + (corner[:, 1] - corner[:, 0]) * surface.weight_u[:, None]
        uv_m += (corner[:, 2] - corner[:, 0]) * surface.weight_v[:, None]
        # The footprint is an ellipse, longer where the surface is slanted; its geometric mean is between blur and
        # aliasing.
        cosine = np.maximum(np.abs(np.einsum("ij,ij->i", surface.normal, surface.direction)), 0.06)
        footprint_m = np.nan_to_num(surface.range_m) * np.float32(pixel_rad) / np.sqrt(cosine)
        extent_m = self._extent_m[triangle]
        pattern = _lookup(self._atlas, self._slot[triangle], uv_m / extent_m, footprint_m / extent_m.min(axis=1))
        wear = _lookup(
            self._wear, np.zeros(len(triangle), np.int32), uv_m / np.float32(_WEAR_M), footprint_m / np.float32(_WEAR_M)
        )[:, :1]
        pattern *= 1 + self._wear_contrast[triangle, None] * (wear - 1) * np.float32(5)
        return np.minimum(pattern * self._color[triangle], np.float32(_LARGEST_ALBEDO))


def _anchors_m(scene: Scene) -> np.ndarray:
    """(F, 2) float32 shift of each triangle's texture, so that surfaces that start at (0, 0) alike do not look alike.

    Furniture is shifted by its material, which it keeps when it is moved; structure by where its texture's origin lies
    in the world.
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
    # Off the multiples of a millimetre that buildings are made of, so that the triangles of a wall round alike.
    place = np.floor(origin * 100 + 0.2718).astype(np.int64)
    structure = _hash_unit(*place.T)
    shift = np.where(scene.instance_id == 0, structure, material)
    return np.stack([shift, shift * 7 % 1], axis=1).astype(np.float32) * np.float32(_WEAR_M)


def _hash_unit(*values: np.ndarray | int) -> np.ndarray:
    """Integers mixed to one float64 in [0, 1) that looks random."""
    mixed: np.ndarray = np.array(0x9E3779B97F4A7C15, np.uint64)
    with np.errstate(over="ignore"):
        for value in values:
            mixed = (mixed ^ np.asarray(value, np.int64).astype(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = mixed ^ (mixed >> np.uint64(29))
    return (mixed >> np.uint64(11)).astype(np.float64) / 2.0**53


def _extents_m(scene: Scene) -> np.ndarray:
    """(F, 2) float32 size of a tile on each triangle; where a texture fills its surface, the uv range of its instance
    and material."""
    extent = np.array([texture_kind(m.texture).extent_m for m in scene.materials], float)[
        scene.material_index
    ]  # None becomes NaN
    group = scene.instance_id.astype(np.int64) * len(scene.materials) + scene.material_index
    _, group = np.unique(group, return_inverse=True)
    largest = np.zeros((group.max() + 1, 2))
    np.maximum.at(largest, group, scene.uv_m.max(axis=1))
    return np.where(np.isnan(extent), np.maximum(largest[group], 1e-3), extent).astype(np.float32)


def _atlas(tiles: list[np.ndarray]) -> np.ndarray:
    """uint16 image of all tiles, each in a slot with its levels: the full one at the left, the smaller ones in a column
    at its right."""
    rows = -(-len(tiles) // _ATLAS_COLUMNS)
    atlas = np.zeros((rows * _SLOT_ROWS, min(len(tiles), _ATLAS_COLUMNS) * _SLOT_COLUMNS, 3), np.uint16)
    for slot, tile in enumerate(tiles):
        row, column = divmod(slot, _ATLAS_COLUMNS)
        level = tile
        for down, right in zip(_LEVEL_ROW, _LEVEL_COLUMN, strict=True):
            side = len(level) + 2
            top, left = row * _SLOT_ROWS + down, column * _SLOT_COLUMNS + right
            atlas[top : top + side, left : left + side] = (
                np.pad(level, ((1, 1), (1, 1), (0, 0)), mode="wrap") / _STEP + 0.5
            )
            level = level.reshape(len(level) // 2, 2, len(level) // 2, 2, 3).mean(axis=(1, 3))
    return atlas


_LEVEL_SIDE = TILE >> np.arange(_LEVELS)
_LEVEL_COLUMN = np.where(np.arange(_LEVELS) == 0, 0, TILE + 2)
_LEVEL_ROW = np.concatenate([[0], np.cumsum(np.concatenate([[0], _LEVEL_SIDE[1:-1] + 2]))])


def _lookup(atlas: np.ndarray, slot: np.ndarray, uv: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """(N, 3) float64 patterns at uv (N, 2) in tiles, blended between the two levels nearest to the footprint (N,) in
    tiles."""
    level = np.clip(np.log2(np.maximum(footprint * np.float32(TILE * _SHARPNESS), 1)), 0, _LEVELS - 1.001).astype(
        np.float32
    )
    fine = level.astype(np.int32)
    blend = (level - fine)[:, None]
    row, column = np.divmod(slot, _ATLAS_COLUMNS)
    top, left = row * _SLOT_ROWS, column * _SLOT_COLUMNS
    uv = uv - np.floor(uv)
    near, far = (_sample(atlas, top, left, uv, at) for at in (fine, fine + 1))
    return (near + (far - near) * blend) * np.float32(_STEP)


def _sample(atlas: np.ndarray, top: np.ndarray, left: np.ndarray, uv: np.ndarray, level: np.ndarray) -> np.ndarray:
    side = _LEVEL_SIDE.astype(np.float32)[level]
    # A texel's centre lies at +0.5; the border of one texel adds 1, remap's integer centres take 0.5 off.
    column = left + _LEVEL_COLUMN.astype(np.float32)[level] + uv[:, 0] * side + np.float32(0.5)
    row = top + _LEVEL_ROW.astype(np.float32)[level] + uv[:, 1] * side + np.float32(0.5)
    count = len(row)
    padding = (0, -count % _REMAP_WIDTH)
    column, row = (np.pad(a.astype(np.float32), padding).reshape(-1, _REMAP_WIDTH) for a in (column, row))
    return cv2.remap(atlas, column, row, cv2.INTER_LINEAR).reshape(-1, 3)[:count].astype(np.float32)
