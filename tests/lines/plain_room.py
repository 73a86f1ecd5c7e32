"""A room of plain walls with rectangles on them, ray-cast in closed form, with known edges, poses and ranges."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama

SIZE_M = np.array([5.0, 4.0, 2.6])
"""Corner of the room opposite the origin."""
EYE_M = 1.5


class PlainRoom:
    """A room whose doors, windows and pictures depend on a seed.

    A rectangle is (axis of its wall's normal, low or high wall, low_m, high_m, colour).
    """

    def __init__(self, seed: int, rectangles: int = 12) -> None:
        rng = np.random.default_rng((seed, 7))
        self.rectangles = []
        for number in range(rectangles):
            axis = number % 3
            size_m = np.delete(SIZE_M, axis)
            low_m = rng.uniform(0.1, 0.55, 2) * size_m
            self.rectangles.append(
                (axis, number // 3 % 2, low_m, low_m + rng.uniform(0.15, 0.4, 2) * size_m, rng.uniform(20, 240, 3))
            )
        self._walls = rng.permutation(np.linspace(60, 220, 6))

    def panorama(self, name: str, T_world_pano: np.ndarray, height: int = 256, with_range: bool = True) -> Panorama:
        """Render the panorama at a pose in the room. Each pixel is the mean of four rays."""
        rgb, range_m = self._cast(T_world_pano, equirectangular_rays(2 * height).astype(np.float64))
        rgb = rgb.reshape(height, 2, 2 * height, 2, 3).mean((1, 3)).round().astype(np.uint8)
        if with_range:
            range_m = self._cast(T_world_pano, equirectangular_rays(height).astype(np.float64))[1].astype(np.float32)
        return Panorama(name, rgb, range_m if with_range else None)

    def _cast(self, T_world_pano, rays):
        rays, eye = rays @ T_world_pano[:3, :3].T, T_world_pano[:3, 3]
        with np.errstate(divide="ignore"):
            distance_m = (np.where(rays > 0, SIZE_M, 0) - eye) / rays
        axis, range_m = distance_m.argmin(-1), distance_m.min(-1)
        hit = eye + rays * range_m[..., None]
        high = np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0
        rgb = np.repeat(self._walls[2 * axis + high][..., None], 3, axis=-1)
        for normal, side, low_m, high_m, colour in self.rectangles:
            on_wall = np.delete(hit, normal, axis=-1)
            rgb[(axis == normal) & (high == side) & ((on_wall > low_m) & (on_wall < high_m)).all(-1)] = colour
        return rgb, range_m

    def reference_frame(self, name: str, T_world_pano: np.ndarray, place: str, **options) -> ReferenceFrame:
        panorama = self.panorama(name, T_world_pano, **options)
        return ReferenceFrame(name, place, T_world_pano, load=lambda: panorama)
