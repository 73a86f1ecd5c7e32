"""Direct light from lamps and windows: lighting conditions, the relevant lights at a point, soft shadows."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage

from salframe_house.scene import Light, Scene
from salframe_house.tracing import Tracer, chunks, rows

Lighting = Literal["day", "evening", "dim"]


@dataclass(frozen=True)
class Condition:
    """Lighting at a time of day. Intensities are relative: the exposure adapts to the picture.

    Attributes:
        window: Radiance of the area of a window.
        window_rgb: Colour of windows.
        lamp: Radiance of a lamp of 0.36 m^2.
        lamp_rgb: Colour of lamps.
        lamps_on: Fraction of lamps that are switched on. The first lamp of a room is always on.
        glow: Scale of the emission of materials.
        zenith_rgb: Radiance of the sky at the zenith.
        horizon_rgb: Radiance of the sky at the horizon.
        ground_rgb: Radiance of the ground outdoors.
        key: Target brightness of the exposure.
        noise: Standard deviation of the sensor noise, relative to white.
    """

    window: float
    window_rgb: tuple[float, float, float]
    lamp: float
    lamp_rgb: tuple[float, float, float]
    lamps_on: float
    glow: float
    zenith_rgb: tuple[float, float, float]
    horizon_rgb: tuple[float, float, float]
    ground_rgb: tuple[float, float, float]
    key: float
    noise: float = 0.0


CONDITIONS: dict[Lighting, Condition] = {
    "day": Condition(
        window=6.0,
        window_rgb=(0.93, 1.0, 1.09),
        lamp=7.0,
        lamp_rgb=(1.06, 1.0, 0.88),
        lamps_on=1.0,
        glow=1.5,
        zenith_rgb=(1.5, 2.2, 3.4),
        horizon_rgb=(3.2, 3.6, 4.0),
        ground_rgb=(0.9, 1.0, 0.8),
        key=0.17,
    ),
    "evening": Condition(
        window=0.12,
        window_rgb=(0.6, 0.9, 1.6),
        lamp=14.0,
        lamp_rgb=(1.12, 0.99, 0.78),
        lamps_on=1.0,
        glow=2.0,
        zenith_rgb=(0.02, 0.035, 0.09),
        horizon_rgb=(0.09, 0.10, 0.16),
        ground_rgb=(0.015, 0.018, 0.025),
        key=0.14,
    ),
    "dim": Condition(
        window=0.35,
        window_rgb=(0.8, 0.97, 1.25),
        lamp=8.0,
        lamp_rgb=(1.11, 0.99, 0.80),
        lamps_on=0.4,
        glow=1.5,
        zenith_rgb=(0.06, 0.09, 0.17),
        horizon_rgb=(0.20, 0.22, 0.27),
        ground_rgb=(0.04, 0.045, 0.05),
        key=0.08,
        noise=0.008,
    ),
}

INTERLEAVED = 16
"""Number of sample sets. Each point is shaded with one sample set. All sets together are evenly spaced, so that
averaging 4 x 4 points with different sets removes noise."""

_CELL_M = 0.5
_CANDIDATES = 12
_REACH_M = 14.0
_OFFSET_M = np.float32(0.004)
_GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])  # steps of the R2 low-discrepancy sequence


def is_hollow(scene: Scene) -> np.ndarray:
    """Mark the triangles that cast no shadow: lamps, emissive surfaces and glass, (F,) bool."""
    shines = np.array([m.emission > 0 or m.texture == "glass" for m in scene.materials])[scene.material_index]
    lamps = {light.instance_id for light in scene.lights} - {0}
    return shines | np.isin(scene.instance_id, list(lamps))


def lights_on(lights: tuple[Light, ...], condition: Condition) -> np.ndarray:
    """Mark the lights that are switched on, (L,) bool.

    All windows and the first lamp of each room are on. For each other lamp, a hash of its position decides.
    """
    first_lamp: dict[str, int] = {}
    for index, light in enumerate(lights):
        if light.kind == "lamp":
            first_lamp.setdefault(light.room, index)
    sampled = [zlib.crc32(np.array(light.position_m).tobytes()) < condition.lamps_on * 2**32 for light in lights]
    always_on = [light.kind == "window" or first_lamp[light.room] == index for index, light in enumerate(lights)]
    return np.array(sampled, bool) | np.array(always_on, bool)


class Lights:
    """The lights of a building under one condition, and a lookup of the visible lights by floor cells of 0.5 m.

    The lookup bounds the cost of a point, independently of the number of rooms.

    Args:
        scene: The scene.
        condition: The lighting condition.
        tracer: Tracer of the scene.
    """

    def __init__(self, scene: Scene, condition: Condition, tracer: Tracer):
        self._tracer = tracer
        on = [light for light, shines in zip(scene.lights, lights_on(scene.lights, condition), strict=True) if shines]
        # The last light is dark: it pads the list of cells that see fewer lights.
        self._centre_m = np.array([light.position_m for light in on] + [(0, 0, -1e3)], np.float32, order="F")
        self._edges_m = np.array(
            [(light.edge_u_m, light.edge_v_m) for light in on] + [np.eye(3)[:2] * 1e-3], np.float32
        )
        normal = np.cross(self._edges_m[:, 0], self._edges_m[:, 1])
        area_m2 = np.linalg.norm(normal, axis=1)
        normal /= area_m2[:, None]
        lamp = np.array([light.kind == "lamp" for light in on] + [False])
        normal[lamp & (normal[:, 2] > 0)] *= -1
        self._normal = np.asfortranarray(normal)
        # Factor for a negative cosine, at points behind the light: windows emit to both sides, lamps do not.
        self._behind = np.where(lamp, 0, -1).astype(np.float32)
        # Larger lamps are brighter, but not in proportion to their area.
        intensity = np.where(lamp, condition.lamp * np.sqrt(0.36 * area_m2), condition.window * area_m2)
        intensity[-1] = 0
        self._intensity = intensity.astype(np.float32)
        self._radius_sq_m2 = (area_m2 / np.pi).astype(np.float32)
        self._color = np.where(lamp[:, None], condition.lamp_rgb, condition.window_rgb).astype(np.float32, order="F")
        self._low_m = scene.vertices_m.min(axis=0).astype(np.float64)
        self._candidates = self._visible_lights(scene.vertices_m.max(axis=0) - self._low_m)

    def _visible_lights(self, size_m: np.ndarray) -> np.ndarray:
        """Return the lights visible from some point in or beside each cell, (_CANDIDATES, C), strongest first.

        The cells are in row-major order.
        """
        self._shape = down, across = tuple(np.ceil(size_m[1::-1] / _CELL_M).astype(int) + 1)
        # Sample points over the cell and 80 % of the height, each paired with another part of the light.
        spread = np.arange(1, 13)[:, None] * np.append(_GOLDEN, 0.438) % 1
        offset = (spread * [1, 1, 0.8] + [0, 0, 0.1]) * [_CELL_M, _CELL_M, size_m[2]]
        part = (np.arange(1, 13)[:, None] * [0.382, 0.236] % 1 - 0.5).astype(np.float32)
        row, column = np.mgrid[:down, :across]
        corner = np.stack([column.ravel(), row.ravel(), np.zeros(down * across)], axis=1) * _CELL_M + self._low_m
        strength = np.zeros((down * across, len(self._centre_m)), np.float32)
        for light in range(len(self._centre_m) - 1):
            cells = np.flatnonzero(np.linalg.norm(corner[:, :2] - self._centre_m[light, :2], axis=1) < _REACH_M)
            points = (corner[cells, None] + offset).reshape(-1, 3).astype(np.float32)
            visible = ~self._tracer.blocked(
                points, np.tile(self._centre_m[light] + part @ self._edges_m[light], (len(cells), 1))
            )
            distance_sq = np.sum((points - self._centre_m[light]) ** 2, axis=1)
            irradiance = self._intensity[light] * visible / (distance_sq + self._radius_sq_m2[light])
            strength[cells, light] = irradiance.reshape(len(cells), -1).max(axis=1)
        # A light that becomes visible between these sample points is visible from the adjacent cell.
        strength = ndimage.maximum_filter(strength.reshape(down, across, -1), size=(3, 3, 1)).reshape(strength.shape)
        count = min(_CANDIDATES, strength.shape[1])
        best = np.argsort(-strength, axis=1, kind="stable")[:, :count]
        best[np.take_along_axis(strength, best, axis=1) <= 0] = len(self._centre_m) - 1
        return np.ascontiguousarray(best.T)

    def direct(self, point_m: np.ndarray, normal: np.ndarray, sample_set: np.ndarray, samples: int) -> np.ndarray:
        """Return the direct irradiance with soft shadows, (N, 3) float32 in Fortran order.

        The unshadowed irradiance of each light has a closed form. The number of shadow rays to a light is proportional
        to its unshadowed irradiance.

        Args:
            point_m: Points, (N, 3).
            normal: Unit normals, (N, 3).
            sample_set: Sample set of each point, (N,) int in [0, INTERLEAVED).
            samples: Number of shadow rays per point.
        """
        irradiance = np.empty((3, len(point_m)), np.float32)
        targets_m = self._targets_m(samples * INTERLEAVED)
        for part in chunks(len(point_m)):
            irradiance[:, part] = self._direct(point_m[part], normal[part], sample_set[part], samples, targets_m).T
        return irradiance.T

    def _targets_m(self, orders: int) -> np.ndarray:
        """Return the ends of shadow rays: `orders` points spread over each of the L lights, (L * orders, 3) float32 in
        Fortran order."""
        across = (np.arange(orders)[:, None] * _GOLDEN % 1 - 0.5).astype(np.float32)
        along_u, along_v = (self._edges_m[:, None, i] * across[:, i : i + 1] for i in range(2))
        return np.asfortranarray((self._centre_m[:, None] + along_u + along_v).reshape(-1, 3))

    def _direct(
        self, point_m: np.ndarray, normal: np.ndarray, sample_set: np.ndarray, samples: int, targets_m: np.ndarray
    ) -> np.ndarray:
        """Compute `direct` for one chunk of points."""
        cell = (point_m[:, 1::-1] - self._low_m[1::-1].astype(np.float32)) / np.float32(_CELL_M)
        row, column = np.clip(cell.astype(np.int32), 0, np.array(self._shape) - 1).T
        light = self._candidates.take(row * self._shape[1] + column, axis=1)
        share = self._unshadowed(point_m, normal, light)
        for k in range(1, len(share)):
            share[k] += share[k - 1]
        total = share[-1]
        start_m = point_m + normal * _OFFSET_M
        orders = samples * INTERLEAVED
        thresholds = (np.arange(orders) + 0.5).astype(np.float32) / np.float32(orders)
        irradiance = np.zeros_like(start_m)
        for sample in range(samples):
            order = sample * INTERLEAVED + sample_set
            below = share <= thresholds.take(order) * total
            light_index = np.minimum(below.view(np.uint8).sum(axis=0, dtype=np.uint8), len(light) - 1)
            light_index = np.take_along_axis(light, light_index[None], axis=0)[0]
            end_m = rows(targets_m, light_index * orders + order)
            faces = np.einsum("ij,ij->i", end_m - start_m, normal) > 0
            candidates = np.flatnonzero(faces & (total > 0))
            visible = np.zeros(len(point_m), bool)
            visible[candidates] = ~self._tracer.blocked(rows(start_m, candidates), rows(end_m, candidates))
            irradiance += rows(self._color, light_index) * visible[:, None]
        irradiance *= (total / np.float32(samples))[:, None]
        return irradiance

    def _unshadowed(self, point_m: np.ndarray, normal: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return the irradiance from the candidate lights (K, N) of each point, (K, N) float32.

        Each light is approximated by a disc of equal area.
        """
        irradiance = np.empty(light.shape, np.float32)
        for k, light_index in enumerate(light):
            centre_m, light_normal = rows(self._centre_m, light_index), rows(self._normal, light_index)
            radius_sq = self._radius_sq_m2.take(light_index)
            to_light = centre_m - point_m
            distance_sq = np.einsum("ij,ij->i", to_light, to_light)
            distance = np.sqrt(distance_sq)
            cos_emission = np.einsum("ij,ij->i", to_light, light_normal)
            cos_emission /= -distance
            np.maximum(cos_emission, cos_emission * self._behind.take(light_index), out=cos_emission)
            cos_incidence = np.einsum("ij,ij->i", to_light, normal)
            cos_incidence /= distance
            distance_sq += radius_sq
            # A light that is partly below the horizon of the surface fades out; it does not stop at its centre.
            softness = np.sqrt(radius_sq / distance_sq)
            factor = np.maximum(cos_incidence + softness, 0)
            factor *= factor
            factor /= 4 * softness
            np.copyto(factor, cos_incidence, where=cos_incidence > softness)
            factor *= self._intensity.take(light_index)
            factor *= cos_emission
            np.divide(factor, distance_sq, out=irradiance[k])
        return irradiance
