"""Rays against a scene's triangles: nearest surfaces and shadows, on embree."""

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

_NOTHING = np.float32(1e30)  # embree's range where a ray hits nothing is 1e37
_THREADS = 2  # embreex lets go of the interpreter while it traces
_CHUNK = 1 << 14  # cv2.remap takes images with sides below 32768


@dataclass(frozen=True, eq=False)
class RayHits:
    """What N rays hit: flat arrays, one entry a ray, world frame. Vectors are held column by column, in Fortran order,
    so that arithmetic over many rays runs through contiguous memory.

    direction (N, 3) float32 unit, of the rays; range_m (N,) float32, NaN where nothing was hit; triangle (N,) int32
    into the scene, 0 where nothing was hit; weight_u, weight_v (N,) float32 barycentric weights of its second and third
    corner; normal (N, 3) float32 unit, turned towards the ray; point_m (N, 3) float32 where it hit, its origin where
    nothing was hit.
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
        """(N,) bool: the ray hit something."""
        return ~np.isnan(self.range_m)

    def __len__(self) -> int:
        return len(self.range_m)

    def take(self, index: np.ndarray) -> RayHits:
        """The entries at these positions."""
        return RayHits(*(rows(getattr(self, name), index) for name in self.__dataclass_fields__))


def rows(table: np.ndarray, index: np.ndarray) -> np.ndarray:
    """table[index] of a table (F,) or one (F, C) in Fortran order, in which the result is too."""
    return table.T.take(index, axis=-1).T


def chunks(count: int) -> Iterator[slice]:
    """Runs of this many rays, each so short that temporaries stay in the processor's cache."""
    for start in range(0, count, _CHUNK):
        yield slice(start, start + _CHUNK)


class Tracer:
    """The triangles of a scene, ready for rays. One tracer serves every lighting of the scene.

    `hollow` (F,) bool marks triangles that cast no shadow: what shines, the lamps around the lights, and window panes.
    A shadow ray ends at the light inside of them, and would otherwise strike them.
    """

    def __init__(self, scene: Scene, hollow: np.ndarray):
        self._surfaces = _embree_scene(scene.vertices_m, scene.triangles)
        self._occluders = _embree_scene(scene.vertices_m, scene.triangles[~hollow])
        corners = scene.vertices_m[scene.triangles].astype(np.float32)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normal = np.asfortranarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12))
        self._pool = ThreadPoolExecutor(min(_THREADS, threads_allowed() or _THREADS))

    def trace(self, origin_m: np.ndarray, direction: np.ndarray) -> RayHits:
        """The nearest surfaces along unit directions (N, 3) float32 from one origin (3,) or N origins (N, 3)."""
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
        """Fill in a part of what rays hit."""
        start_m, direction = origin_m[part], surface.direction[part]
        found = self._surfaces.run(start_m, direction, query="INTERSECT", output=True)
        range_m = found["tfar"]
        missed = range_m > _NOTHING
        surface.triangle[part] = triangle = np.maximum(found["primID"], 0)
        surface.weight_u[part], surface.weight_v[part] = found["u"], found["v"]
        normal = rows(self._normal, triangle)
        # Triangles are seen from either side: a normal is turned towards the ray.
        away = np.einsum("ij,ij->i", normal, direction) > 0
        np.multiply(normal, np.where(away, np.float32(-1), np.float32(1))[:, None], out=surface.normal[part])
        range_m[missed] = 0
        np.add(start_m, direction * range_m[:, None], out=surface.point_m[part])
        range_m[missed] = np.nan
        surface.range_m[part] = range_m

    def blocked(self, start_m: np.ndarray, end_m: np.ndarray) -> np.ndarray:
        """(N,) bool: something that casts shadows lies between the points (N, 3); within 2 cm of the end does not
        count."""
        blocked = np.empty(len(start_m), bool)
        list(self._pool.map(partial(self._block, start_m, end_m, blocked), chunks(len(start_m))))
        return blocked

    def _block(self, start_m: np.ndarray, end_m: np.ndarray, blocked: np.ndarray, part: slice) -> None:
        """Fill in a part of what is blocked."""
        way = end_m[part] - start_m[part]
        length_m = np.sqrt(np.einsum("ij,ij->i", way, way))
        way /= np.maximum(length_m, 1e-6)[:, None]
        reach_m = np.maximum(length_m - np.float32(0.02), 0)
        blocked[part] = self._occluders.run(start_m[part], way, query="OCCLUDED", dists=reach_m) >= 0


def _embree_scene(vertices_m: np.ndarray, triangles: np.ndarray) -> EmbreeScene:
    scene = EmbreeScene(robust=True)  # without it, rays slip between triangles that share an edge
    TriangleMesh(scene, vertices_m.astype(np.float32), triangles.astype(np.int32))
    up = np.array([[0, 0, 1]], np.float32)
    scene.run(up, up)  # builds the hierarchy now: two threads must not both do so at their first ray
    return scene
