"""Panoramas of a mesh: range by one exact ray a pixel centre, colour by four rays a pixel."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe_mesh.mesh_file import MeshSurface

_NOTHING = np.float32(1e30)  # embree's range where a ray hits nothing is 1e37
_SUPERSAMPLING = 2


class MeshRenderer:
    """Renders panoramas of one mesh as it is: its colours are taken to hold the light. The same pose gives the same
    bytes."""

    def __init__(self, surface: MeshSurface):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._surface = surface
        self._scene = EmbreeScene(robust=True)  # without it, rays slip between triangles that share an edge
        TriangleMesh(self._scene, surface.vertices_m, surface.triangles)

    def trace(self, origin_m: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Along unit directions (N, 3) from one origin (3,) or N: range_m (N,) float32, NaN where nothing is hit, the
        triangle (N,) int32, 0 where nothing is, and the weights (N, 3) float32 of its corners."""
        direction = np.ascontiguousarray(direction, np.float32)
        origin_m = np.ascontiguousarray(np.broadcast_to(np.asarray(origin_m, np.float32), direction.shape))
        found = self._scene.run(origin_m, direction, query="INTERSECT", output=True)
        range_m = np.where(found["tfar"] < _NOTHING, found["tfar"], np.float32(np.nan))
        u, v = found["u"], found["v"]
        return range_m, np.maximum(found["primID"], 0), np.stack([1 - u - v, u, v], 1)

    def render(self, T_world_pano: np.ndarray, height: int, id: str) -> Panorama:
        """The panorama (height, 2 height) at a pose (4, 4): rgb, black where nothing is, and range_m, NaN there."""
        shape = height, 2 * height
        range_m, _, _ = self.trace(T_world_pano[:3, 3], _rays(T_world_pano, height))
        fine = _SUPERSAMPLING * height
        far_m, triangle, weights = self.trace(T_world_pano[:3, 3], _rays(T_world_pano, fine))
        rgb = np.where(np.isnan(far_m)[:, None], 0, self._color(triangle, weights))
        rgb = rgb.reshape(height, _SUPERSAMPLING, 2 * height, _SUPERSAMPLING, 3).mean((1, 3))
        range_m = range_m.reshape(shape)
        return Panorama(id, np.round(rgb).astype(np.uint8), range_m, ~np.isnan(range_m))

    def _color(self, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(N, 3) float32 colour of points of triangles."""
        surface = self._surface
        shade = np.einsum("nk,nkc->nc", weights, surface.colors[surface.triangles[triangle]]) / 255
        uv = np.einsum("nk,nkc->nc", weights, surface.uv[triangle])
        paint = surface.paint[triangle]
        color = np.empty((len(triangle), 3), np.float32)
        for number in np.unique(paint):
            inside = paint == number
            color[inside] = _sampled(surface.textures[number], uv[inside])
        return color * shade


def _rays(T_world_pano: np.ndarray, height: int) -> np.ndarray:
    return equirectangular_rays(height).reshape(-1, 3) @ T_world_pano[:3, :3].T.astype(np.float32)


def _sampled(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N, 3) float32 of a texture at (N, 2) coordinates, between the four pixels around; it repeats beyond them."""
    height, width = texture.shape[:2]
    column, row = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(column).astype(np.int64), np.floor(row).astype(np.int64)
    right_share, lower_share = (column - left)[:, None], (row - top)[:, None]
    left, right, top, lower = left % width, (left + 1) % width, top % height, (top + 1) % height
    above = texture[top, left] * (1 - right_share) + texture[top, right] * right_share
    below = texture[lower, left] * (1 - right_share) + texture[lower, right] * right_share
    return (above * (1 - lower_share) + below * lower_share).astype(np.float32)
