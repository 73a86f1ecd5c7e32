"""Pictures of two fisheye circles are refused, and no panorama is taken for one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas import images
from salframe.panoramas.fisheye import is_dual_fisheye
from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels
from salframe.panoramas.shot import open_panorama, read_panorama

HEIGHT = 256


def room(seed: int, brightness: float = 1.0) -> np.ndarray:
    """A panorama of smooth random colours, from the ceiling to the floor."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(30, 256, (9, 18, 3)).astype(np.float32) * brightness
    return cv2.resize(coarse, (2 * HEIGHT, HEIGHT), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def two_circles(panorama: np.ndarray, radius: float = 0.49, shift: float = 0.0, noise: int = 4) -> np.ndarray:
    """What two lenses with a field of view of 190 deg see, side by side, `radius` relative to the height."""
    offset = (np.arange(HEIGHT) + 0.5) / HEIGHT - 0.5
    y, x = np.meshgrid(offset - shift, offset + shift, indexing="ij")
    r = np.hypot(x, y)
    angle = r / radius * np.radians(95)
    front = np.stack([np.cos(angle), -np.sin(angle) * x / r, -np.sin(angle) * y / r], -1)
    halves = []
    for side in (1, -1):
        columns, rows = rays_to_pixels(front * [side, side, 1], HEIGHT)
        half = panorama[np.minimum(rows.astype(int), HEIGHT - 1), columns.astype(int) % (2 * HEIGHT)]
        halves.append(np.where((r <= radius)[..., None], half, 0))
    picture = np.concatenate(halves, axis=1).astype(int)
    return (picture + np.random.default_rng(0).integers(0, noise + 1, picture.shape)).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("radius", [0.46, 0.5, 0.53])
@pytest.mark.parametrize("shift", [0.0, 0.01])
@pytest.mark.parametrize("brightness", [1.0, 0.4])
def test_two_circles_are_recognized(radius, shift, brightness):
    assert all(is_dual_fisheye(two_circles(room(seed, brightness), radius, shift)) for seed in range(10))


def with_caps(panorama: np.ndarray, share: float) -> np.ndarray:
    capped, rows = panorama.copy(), round(share * HEIGHT)
    capped[:rows] = capped[HEIGHT - rows :] = 0
    return capped


def partial(panorama: np.ndarray, fov_deg: float) -> np.ndarray:
    """The part within a cone around the front, and around the back."""
    forward = np.abs(equirectangular_rays(HEIGHT)[..., 0])
    return np.where((forward > np.cos(np.radians(fov_deg / 2)))[..., None], panorama, np.uint8(0))


OTHERS = {
    "whole": lambda p: p,
    "dark": lambda p: (p * 0.05).astype(np.uint8),
    "black": lambda p: p * np.uint8(0),
    **{f"caps of {share}": lambda p, share=share: with_caps(p, share) for share in (0.03, 0.06, 0.1, 0.13, 0.17, 0.25)},
    **{f"cones of {fov}": lambda p, fov=fov: partial(p, fov) for fov in (60, 90, 120, 150, 170, 178)},
    "front only": lambda p: np.where(equirectangular_rays(HEIGHT)[..., :1] > 0.5, p, np.uint8(0)),
}


@pytest.mark.parametrize("change", OTHERS.values(), ids=OTHERS)
def test_panoramas_are_not_taken_for_circles(change):
    assert not any(is_dual_fisheye(change(room(seed))) for seed in range(20))


@pytest.mark.parametrize("read", [read_panorama, open_panorama])
def test_circles_are_refused_with_advice(tmp_path, read):
    images.write_color(tmp_path / "a.jpg", two_circles(room(1)))
    with pytest.raises(DataError, match=r"a\.jpg shows two fisheye circles side by side, .*stitch it first"):
        read(tmp_path / "a.jpg")
