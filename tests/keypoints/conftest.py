"""A textured box room, ray-cast in closed form, with known poses and ranges."""

from __future__ import annotations

import numpy as np
import pytest
from conformance import runnable
from salframe_keypoints.feature_matcher import FeatureMatcher
from salframe_keypoints.localizer import Keypoints
from scipy.ndimage import map_coordinates, zoom

from salframe.framework.components.registry import registry
from salframe.framework.validation import validate
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama

ROOM_M = np.array([[-3.0, -2.5, -1.5], [3.5, 2.0, 1.3]])
TEXELS_PER_M = 60


class BoxRoom:
    """An empty box with a random texture on each wall, which depends on a seed."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng((seed, 360))
        coarse = [zoom(rng.uniform(0, 255, (8 * n, 8 * n, 3)), (60 // n, 60 // n, 1), order=1) for n in (2, 4, 10)]
        self._texture = [sum(np.roll(layer, rng.integers(0, 480, 2), (0, 1)) for layer in coarse) / 3 for _ in range(6)]

    def panorama(self, name: str, T_world_pano: np.ndarray, height: int = 512, with_range: bool = True) -> Panorama:
        """Render the panorama at a pose inside the room."""
        rays = equirectangular_rays(height).astype(np.float64) @ T_world_pano[:3, :3].T
        centre = T_world_pano[:3, 3]
        with np.errstate(divide="ignore"):
            distance = (np.where(rays > 0, ROOM_M[1], ROOM_M[0]) - centre) / rays
        axis = distance.argmin(-1)
        range_m = distance.min(-1)
        hit = centre + rays * range_m[..., None]
        wall = 2 * axis + (np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0)
        rgb = np.zeros((*wall.shape, 3), np.uint8)
        for i in range(6):
            on = wall == i
            uv = np.delete(hit[on], i // 2, axis=1) * TEXELS_PER_M
            for channel in range(3):
                rgb[on, channel] = map_coordinates(
                    self._texture[i][..., channel], uv.T, order=1, mode="grid-wrap"
                ).clip(0, 255)
        return Panorama(name, rgb, range_m.astype(np.float32) if with_range else None)

    def reference_frame(self, name: str, T_world_pano: np.ndarray, place: str, **options) -> ReferenceFrame:
        panorama = self.panorama(name, T_world_pano, **options)
        return ReferenceFrame(name, place, T_world_pano, load=lambda: panorama)

    def query(self, T_world_pano: np.ndarray, **options) -> QueryFrame:
        panorama = self.panorama("query", T_world_pano, **options)
        return QueryFrame("query", lambda: panorama)


@pytest.fixture(scope="session")
def rooms() -> list[BoxRoom]:
    return [BoxRoom(seed) for seed in range(3)]


@pytest.fixture(scope="session")
def configure():
    """Returns a config of the localizer with a matcher. Skips the test if its packages or weights are not installed."""

    def make(kind: str = "sift", features: dict | None = None, **settings) -> Keypoints.Config:
        chosen = {"features": {"kind": kind, **(features or {})}, **settings}
        return runnable(validate(Keypoints.Config, chosen, "keypoints"))

    return make


@pytest.fixture(scope="session")
def make_matcher():
    """Returns a prepared matcher by name. Skips the test if its packages or weights are not installed."""

    def make(kind: str, size_px: tuple[int, int] = (480, 352), **settings) -> FeatureMatcher:
        config = runnable(registry().get("feature-matcher", kind).Config(**settings))
        matcher = registry().build("feature-matcher", config)
        matcher.prepare(*size_px)
        return matcher

    return make
