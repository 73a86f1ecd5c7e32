"""Light that arrives by way of other surfaces: a final gather over a coarse radiosity solution."""

from __future__ import annotations

import numpy as np

from salframe_house.lighting import INTERLEAVED, Lights
from salframe_house.tracing import Surface, Tracer

_PATCH_M = np.array([0.4, 0.4, 0.3], np.float32)
_PATCHES = np.array([80, 80, 14])  # around the camera
_BOUNCES = 4
_OFFSET_M = np.float32(0.004)


def gather_directions(normal: np.ndarray, sample_set: np.ndarray, count: int) -> np.ndarray:
    """(N, count, 3) float32 unit directions about normals (N, 3), cosine-distributed; the sets of samples together are
    stratified."""
    order = np.arange(count * INTERLEAVED)
    radius = np.sqrt((order + 0.5) / len(order))
    angle = (
        order * np.pi * (3 - np.sqrt(5))
    )  # a sunflower: even over the disc, and so over the hemisphere under a cosine
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

    The surfaces that the gathered rays hit are grouped into patches by place and facing; each patch is lit directly at
    one of its points and exchanges light with the others, so that a ray that ends on a patch knows what it sends back.
    """

    def __init__(self, tracer: Tracer, lights: Lights, albedo: np.ndarray, centre_m: np.ndarray):
        self._tracer, self._lights, self._albedo = tracer, lights, albedo
        self._corner_m = (np.floor(centre_m / _PATCH_M - _PATCHES / 2) * _PATCH_M).astype(np.float32)

    def irradiance(self, point_m: np.ndarray, normal: np.ndarray, sample_set: np.ndarray, rays: int) -> np.ndarray:
        """(N, 3) float32 irradiance at points (N, 3) from `rays` rays each."""
        surface = self._gathered(point_m, normal, sample_set, rays)
        hit = np.flatnonzero(surface.hit)
        key = self._patch_key(surface)[hit]
        patch_of = np.full(_PATCHES.prod() * 6, -1, np.int32)
        patch_of[key] = hit
        members = np.flatnonzero(patch_of >= 0)
        sent = self._radiosity(surface.take(patch_of[members]), members)
        patch_of[members] = np.arange(len(members), dtype=np.int32)
        reflected = np.zeros((len(surface), 3), np.float32)
        reflected[hit] = self._albedo[surface.triangle[hit]] * sent[patch_of[key]]
        return reflected.reshape(len(point_m), rays, 3).mean(axis=1)

    def _gathered(self, point_m: np.ndarray, normal: np.ndarray, sample_set: np.ndarray, rays: int) -> Surface:
        direction = gather_directions(normal, sample_set, rays).reshape(-1, 3)
        return self._tracer.trace(np.repeat(point_m + normal * _OFFSET_M, rays, axis=0), direction)

    def _patch_key(self, surface: Surface) -> np.ndarray:
        cell = np.clip(((surface.point_m - self._corner_m) / _PATCH_M).astype(np.int32), 0, _PATCHES - 1)
        axis = np.abs(surface.normal).argmax(axis=1)
        facing = 2 * axis + (surface.normal[np.arange(len(axis)), axis] > 0)
        return ((cell[:, 0] * _PATCHES[1] + cell[:, 1]) * _PATCHES[2] + cell[:, 2]) * 6 + facing

    def _radiosity(self, patch: Surface, key: np.ndarray) -> np.ndarray:
        """(P, 3) float32 irradiance of the patches after a few bounces among them."""
        rays = INTERLEAVED
        sample_set = np.arange(len(patch)) % INTERLEAVED
        direct = self._lights.direct(patch.point_m, patch.normal, sample_set, samples=8)
        seen = self._gathered(patch.point_m, patch.normal, sample_set, rays)
        position = np.minimum(np.searchsorted(key, self._patch_key(seen)), len(key) - 1)
        known = seen.hit & (key[position] == self._patch_key(seen))
        albedo = self._albedo[seen.triangle] * seen.hit[:, None]
        total = direct
        for _ in range(_BOUNCES):
            # A ray that ends on no patch of the table gets what patches get on average.
            incoming = np.where(known[:, None], total[position], total.mean(axis=0))
            total = direct + (albedo * incoming).reshape(-1, rays, 3).mean(axis=1)
        return total
