"""Rendering of panoramas of a mesh: range with one exact ray per pixel centre, colour with four rays per pixel."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe_mesh.mesh_file import MeshSurface

_NO_HIT_M = np.float32(1e30)  # embree returns a range of 1e37 for a ray without a hit
_SUPERSAMPLING = 2
"""Number of rays per pixel along each image axis, for colour."""


class MeshRenderer:
    """Renders panoramas of one mesh without shading, because the colours of the mesh are assumed to include the light.

    The same pose gives identical bytes.
    """

    def __init__(self, surface: MeshSurface):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._surface = surface
        self._scene = EmbreeScene(robust=True)  # otherwise rays slip between triangles that share an edge
        TriangleMesh(self._scene, surface.vertices_m, surface.triangles)

    def trace(self, origin_m: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Trace rays to their first hit.

        Args:
            origin_m: Origin (3,) of all rays, or origins (N, 3), in metres.
            direction: Unit directions (N, 3).

        Returns:
            range_m (N,) float32, NaN without a hit; index (N,) int32 of the triangle that is hit, 0 without a hit; and
            barycentric weights (N, 3) float32 of the triangle's corners.
        """
        direction = np.ascontiguousarray(direction, np.float32)
        origin_m = np.ascontiguousarray(np.broadcast_to(np.asarray(origin_m, np.float32), direction.shape))
        hits = self._scene.run(origin_m, direction, query="INTERSECT", output=True)
        range_m = np.where(hits["tfar"] < _NO_HIT_M, hits["tfar"], np.float32(np.nan))
        u, v = hits["u"], hits["v"]
        return range_m, np.maximum(hits["primID"], 0), np.stack([1 - u - v, u, v], 1)

    def render(self, T_world_pano: np.ndarray, height: int, id: str) -> Panorama:
        """Render a panorama. A pixel whose ray hits nothing is black and not valid, and its range is NaN.

        Args:
            T_world_pano: (4, 4) pose of the panorama.
            height: Height of the panorama in pixels. The width is twice the height.
            id: Id of the panorama.
        """
        shape = height, 2 * height
        range_m, _, _ = self.trace(T_world_pano[:3, 3], _rays(T_world_pano, height))
        fine = _SUPERSAMPLING * height
        far_m, triangle, weights = self.trace(T_world_pano[:3, 3], _rays(T_world_pano, fine))
        rgb = np.where(np.isnan(far_m)[:, None], 0, self._color(triangle, weights))
        rgb = rgb.reshape(height, _SUPERSAMPLING, 2 * height, _SUPERSAMPLING, 3).mean((1, 3))
        range_m = range_m.reshape(shape)
        return Panorama(id, np.round(rgb).astype(np.uint8), range_m, ~np.isnan(range_m))

    def _color(self, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return the colours (N, 3) float32 of points on triangles."""
        surface = self._surface
        shade = np.einsum("nk,nkc->nc", weights, surface.colors[surface.triangles[triangle]]) / 255
        uv = np.einsum("nk,nkc->nc", weights, surface.uv[triangle])
        paint = surface.paint[triangle]
        color = np.empty((len(triangle), 3), np.float32)
        for number in np.unique(paint):
            inside = paint == number
            color[inside] = _sample(surface.textures[number], uv[inside])
        return color * shade


def _rays(T_world_pano: np.ndarray, height: int) -> np.ndarray:
    return equirectangular_rays(height).reshape(-1, 3) @ T_world_pano[:3, :3].T.astype(np.float32)


def _sample(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Sample a repeating texture at coordinates (N, 2) by bilinear interpolation: (N, 3) float32."""
    height, width = texture.shape[:2]
    column, row = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(column).astype(np.int64), np.floor(row).astype(np.int64)
    right_share, lower_share = (column - left)[:, None], (row - top)[:, None]
    left, right, top, lower = left % width, (left + 1) % width, top % height, (top + 1) % height
    above = texture[top, left] * (1 - right_share) + texture[top, right] * right_share
    below = texture[lower, left] * (1 - right_share) + texture[lower, right] * right_share
    return (above * (1 - lower_share) + below * lower_share).astype(np.float32)
