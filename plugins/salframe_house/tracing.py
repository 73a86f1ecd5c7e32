"""Ray tracing against the triangles of a scene: nearest surfaces and shadows, with Embree."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from salframe.framework.engines.worker import threads_allowed
from salframe_house.scene import Scene

_MISS_RANGE_M = np.float32(1e30)  # threshold of a miss: Embree returns a range of 1e37
_THREADS = 2  # embreex releases the GIL while it traces
_CHUNK = 1 << 14  # rays per chunk; cv2.remap requires image sides below 32768


@dataclass(frozen=True, eq=False)
class RayHits:
    """Hits of N rays, in the world frame. Arrays of vectors are in Fortran order, so that arithmetic is contiguous.

    Attributes:
        direction: Unit directions of the rays, (N, 3) float32.
        range_m: Distance along the ray, (N,) float32; NaN for a miss.
        triangle: Index of the triangle, (N,) int32; 0 for a miss.
        weight_u: Barycentric weight of the second corner, (N,) float32.
        weight_v: Barycentric weight of the third corner, (N,) float32.
        normal: Unit normal, oriented towards the ray origin, (N, 3) float32.
        point_m: Hit point, (N, 3) float32; the origin of the ray for a miss.
    """

    direction: np.ndarray
    range_m: np.ndarray
    triangle: np.ndarray
    weight_u: np.ndarray
    weight_v: np.ndarray
    normal: np.ndarray
    point_m: np.ndarray

    @property
    def hit(self) -> np.ndarray:
        """Whether each ray hit something, (N,) bool."""
        return ~np.isnan(self.range_m)

    def __len__(self) -> int:
        return len(self.range_m)

    def take(self, index: np.ndarray) -> RayHits:
        """Return the entries at these indices."""
        return RayHits(*(rows(getattr(self, name), index) for name in self.__dataclass_fields__))


def rows(table: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return table[index] for a table (F,) or (F, C) in Fortran order; the result is in Fortran order too."""
    return table.T.take(index, axis=-1).T


def chunks(count: int) -> Iterator[slice]:
    """Generate slices of `count` rays, short enough that temporary arrays fit into the CPU cache."""
    for start in range(0, count, _CHUNK):
        yield slice(start, start + _CHUNK)


class Tracer:
    """Acceleration structures of the triangles of a scene. One tracer serves every lighting of the scene.

    Args:
        scene: The scene.
        hollow: Triangles that cast no shadow, (F,) bool: emissive surfaces, lamps and window panes. The shadow rays end
            at the light inside them and would otherwise hit them.
    """

    def __init__(self, scene: Scene, hollow: np.ndarray):
        self._surfaces = _embree_scene(scene.vertices_m, scene.triangles)
        self._occluders = _embree_scene(scene.vertices_m, scene.triangles[~hollow])
        corners = scene.vertices_m[scene.triangles].astype(np.float32)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normal = np.asfortranarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12))
        self._pool = ThreadPoolExecutor(min(_THREADS, threads_allowed() or _THREADS))

    def trace(self, origin_m: np.ndarray, direction: np.ndarray) -> RayHits:
        """Return the nearest surfaces along rays.

        Args:
            origin_m: One origin (3,) or N origins (N, 3).
            direction: Unit directions, (N, 3) float32.
        """
        direction = np.asfortranarray(direction)
        origin_m = np.broadcast_to(np.asarray(origin_m, np.float32), direction.shape)
        count = len(direction)
        range_m, weight_u, weight_v = np.empty((3, count), np.float32)
        triangle = np.empty(count, np.int32)
        normal, point_m = np.empty((2, 3, count), np.float32).transpose(0, 2, 1)
        surface = RayHits(direction, range_m, triangle, weight_u, weight_v, normal, point_m)
        list(self._pool.map(partial(self._trace, origin_m, surface), chunks(count)))
        return surface

    def _trace(self, origin_m: np.ndarray, surface: RayHits, part: slice) -> None:
        """Trace a slice of the rays and write the hits to `surface`."""
        start_m, direction = origin_m[part], surface.direction[part]
        hits = self._surfaces.run(start_m, direction, query="INTERSECT", output=True)
        range_m = hits["tfar"]
        missed = range_m > _MISS_RANGE_M
        surface.triangle[part] = triangle = np.maximum(hits["primID"], 0)
        surface.weight_u[part], surface.weight_v[part] = hits["u"], hits["v"]
        normal = rows(self._normal, triangle)
        # Triangles are visible from both sides: the normal is oriented towards the ray origin.
        away = np.einsum("ij,ij->i", normal, direction) > 0
        np.multiply(normal, np.where(away, np.float32(-1), np.float32(1))[:, None], out=surface.normal[part])
        range_m[missed] = 0
        np.add(start_m, direction * range_m[:, None], out=surface.point_m[part])
        range_m[missed] = np.nan
        surface.range_m[part] = range_m

    def blocked(self, start_m: np.ndarray, end_m: np.ndarray) -> np.ndarray:
        """Return whether a shadow caster lies between two points, (N,) bool.

        Surfaces within 2 cm of the end point are ignored.

        Args:
            start_m: Start points, (N, 3).
            end_m: End points, (N, 3).
        """
        blocked = np.empty(len(start_m), bool)
        list(self._pool.map(partial(self._block, start_m, end_m, blocked), chunks(len(start_m))))
        return blocked

    def _block(self, start_m: np.ndarray, end_m: np.ndarray, blocked: np.ndarray, part: slice) -> None:
        """Trace a slice of the shadow rays and write the result to `blocked`."""
        way = end_m[part] - start_m[part]
        length_m = np.sqrt(np.einsum("ij,ij->i", way, way))
        way /= np.maximum(length_m, 1e-6)[:, None]
        reach_m = np.maximum(length_m - np.float32(0.02), 0)
        blocked[part] = self._occluders.run(start_m[part], way, query="OCCLUDED", dists=reach_m) >= 0


def _embree_scene(vertices_m: np.ndarray, triangles: np.ndarray) -> EmbreeScene:
    """Build the acceleration structure of triangles."""
    scene = EmbreeScene(robust=True)  # otherwise rays can pass between triangles that share an edge
    TriangleMesh(scene, vertices_m.astype(np.float32), triangles.astype(np.int32))
    up = np.array([[0, 0, 1]], np.float32)
    scene.run(up, up)  # build the hierarchy now: two threads must not build it at their first ray
    return scene
