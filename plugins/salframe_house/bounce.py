"""Indirect light: a final gather over a coarse radiosity solution."""

from __future__ import annotations

import math

import numpy as np

from salframe_house.lighting import INTERLEAVED, Lights
from salframe_house.tracing import RayHits, Tracer, chunks, rows

_PATCH_M = np.array([0.4, 0.4, 0.3], np.float32)
_PATCHES = (80, 80, 14)  # number of patches around the camera along x, y, z
_BOUNCES = 4
_OFFSET_M = np.float32(0.004)


def gather_directions(normal: np.ndarray, sample_set: np.ndarray, count: int) -> np.ndarray:
    """Return cosine-distributed unit directions about normals, (N, count, 3) float32.

    The directions of all sample sets together are evenly spaced.

    Args:
        normal: Unit normals, (N, 3).
        sample_set: Sample set of each point, (N,) int in [0, INTERLEAVED).
        count: Number of directions per normal.
    """
    order = np.arange(count * INTERLEAVED)
    radius = np.sqrt((order + 0.5) / len(order))
    # Sunflower pattern: uniform over the disc, hence cosine-distributed over the hemisphere.
    angle = order * np.pi * (3 - np.sqrt(5))
    disc = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1).astype(np.float32)
    local = disc.reshape(count, INTERLEAVED, 3).transpose(1, 0, 2)[sample_set]
    # Orthonormal basis without branches (Duff et al. 2017).
    sign = np.where(normal[:, 2] >= 0, np.float32(1), np.float32(-1))
    a = -1 / (sign + normal[:, 2])
    b = normal[:, 0] * normal[:, 1] * a
    tangent = np.stack([1 + sign * normal[:, 0] ** 2 * a, sign * b, -sign * normal[:, 0]], axis=1)
    bitangent = np.stack([b, sign + normal[:, 1] ** 2 * a, -normal[:, 1]], axis=1)
    return np.matmul(local, np.stack([tangent, bitangent, normal], axis=1))


class Bounce:
    """Indirect irradiance around one camera position.

    The surfaces that the gather rays hit are grouped into patches by position and orientation. Each patch is lit
    directly at one of its points and exchanges light with the others. A ray that ends on a patch returns the light of
    that patch.

    Args:
        tracer: Tracer of the scene.
        lights: Lights of the scene.
        albedo: Mean albedo of each triangle, (F, 3).
        centre_m: Camera position, (3,).
    """

    def __init__(self, tracer: Tracer, lights: Lights, albedo: np.ndarray, centre_m: np.ndarray):
        self._tracer, self._lights, self._albedo = tracer, lights, albedo
        self._corner_m = (np.floor(centre_m / _PATCH_M - np.divide(_PATCHES, 2)) * _PATCH_M).astype(np.float32)

    def irradiance(self, point_m: np.ndarray, normal: np.ndarray, sample_set: np.ndarray, rays: int) -> np.ndarray:
        """Return the irradiance (N, 3) float32, in Fortran order, at points.

        Args:
            point_m: The points (N, 3).
            normal: The unit normals (N, 3) of the surface at the points.
            sample_set: (N,) int in [0, INTERLEAVED). The set of ray directions of each point.
            rays: Number of rays per point.
        """
        surface = self._gather(point_m, normal, sample_set, rays)
        key, hit = self._patch_key(surface), surface.hit
        patch_of = np.full(math.prod(_PATCHES) * 6, -1)
        patch_of[key[hit]] = np.flatnonzero(hit)
        members = np.flatnonzero(patch_of >= 0)
        emitted = self._radiosity(surface.take(patch_of.take(members)), members)
        patch_of[members] = np.arange(len(members))
        # A ray without a hit ends on the last patch, which is dark.
        patch = np.where(hit, patch_of.take(key), len(emitted))
        incoming = rows(self._albedo, surface.triangle)
        incoming *= rows(np.pad(emitted, ((0, 1), (0, 0))), patch)
        return _mean_of_rays(incoming, rays)

    def _gather(self, point_m: np.ndarray, normal: np.ndarray, sample_set: np.ndarray, rays: int) -> RayHits:
        """Trace the gather rays of points; the rays of a point are consecutive."""
        direction = gather_directions(normal, sample_set, rays).reshape(-1, 3)
        return self._tracer.trace(np.repeat((point_m + normal * _OFFSET_M).T, rays, axis=1).T, direction)

    def _patch_key(self, surface: RayHits) -> np.ndarray:
        """Return the key of the patch that each ray hits, from position and orientation, (N,) int32."""
        key = np.zeros(len(surface), np.int32)
        for part in chunks(len(surface)):
            point_m, normal = surface.point_m[part].T, surface.normal[part].T
            for point, corner, size, count in zip(point_m, self._corner_m, _PATCH_M, _PATCHES, strict=True):
                key[part] *= count
                key[part] += np.clip(((point - corner) / size).astype(np.int32), 0, count - 1)
            x, y, z = np.abs(normal)
            axis = np.where(x >= np.maximum(y, z), np.int8(0), np.where(y >= z, np.int8(1), np.int8(2)))
            key[part] *= 6
            key[part] += 2 * axis + np.choose(axis, normal > 0)
        return key

    def _radiosity(self, patch: RayHits, key: np.ndarray) -> np.ndarray:
        """Return the irradiance of the patches after `_BOUNCES` light bounces, (P, 3) float32 in Fortran order."""
        rays = INTERLEAVED
        sample_set = np.arange(len(patch)) % INTERLEAVED
        direct = self._lights.direct(patch.point_m, patch.normal, sample_set, samples=8)
        hits = self._gather(patch.point_m, patch.normal, sample_set, rays)
        hit_key = self._patch_key(hits)
        position = np.minimum(np.searchsorted(key, hit_key), len(key) - 1)
        has_patch = (hits.hit & (key.take(position) == hit_key))[:, None]
        albedo = rows(self._albedo, hits.triangle) * hits.hit[:, None]
        total = direct
        for _ in range(_BOUNCES):
            # A ray that ends outside the patches receives their average, summed patch by patch.
            average = np.ascontiguousarray(total).mean(axis=0)
            incoming = np.where(has_patch, rows(total, position), average)
            total = direct + _mean_of_rays(albedo * incoming, rays)
        return total


def _mean_of_rays(values: np.ndarray, rays: int) -> np.ndarray:
    """Average the values of the rays of each point: (N * rays, 3) to (N, 3), both in Fortran order.

    The values are summed in the order of the rays.
    """
    of_ray = values.T.reshape(3, -1, rays).transpose(2, 0, 1)
    return np.ascontiguousarray(of_ray).mean(axis=0).T
