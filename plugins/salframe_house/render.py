"""Renderer of equirectangular panoramas: exact range and instances, colour with soft shadows and indirect light."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.geometry import equirectangular_rays, rays_to_pixels
from salframe.panoramas.srgb import LUMINANCE, srgb_from_linear
from salframe_house.albedo import SurfaceColor
from salframe_house.bounce import Bounce
from salframe_house.lighting import CONDITIONS, Condition, Lighting, Lights, is_hollow, lights_on
from salframe_house.scene import Scene
from salframe_house.shading import IrradianceGrid
from salframe_house.textures import texture_kind
from salframe_house.tracing import RayHits, Tracer, chunks, rows

_DIRECT_STEP, _DIRECT_SAMPLES = 2, 3
_INDIRECT_STEP, _INDIRECT_RAYS = 4, 16
_SPECULAR_DEPTH = 4  # maximum number of panes and mirrors on a line of sight
_GLASS_RGB = np.array([0.86, 0.90, 0.89], np.float32)
_SCREEN_GLOW = 0.6  # displays emit the same light at all times of day
_SHARPENING, _SHARPENING_SIGMA = 0.9, 1.2
_LUMINANCE = np.array(LUMINANCE, np.float32)


@dataclass(frozen=True, eq=False)
class Rendering:
    """A rendered panorama.

    Attributes:
        rgb: Colour, (H, 2H, 3) uint8 sRGB.
        range_m: Distance along the ray, (H, 2H) float32; NaN where the ray hits nothing.
        instance_id: Instance ids, (H, 2H) int32; 0 for structure.
    """

    rgb: np.ndarray
    range_m: np.ndarray
    instance_id: np.ndarray


class _Surfaces:
    """The part of a renderer that does not depend on the lighting.

    Textures are painted on first use of `color`, because range and instances do not need them.
    """

    def __init__(self, scene: Scene):
        for material in scene.materials:
            texture_kind(material.texture)
        self.scene = scene
        self.tracer = Tracer(scene, is_hollow(scene))
        self.look = scene.instance_id.astype(np.int64) * len(scene.materials) + scene.material_index
        texture = np.array([m.texture for m in scene.materials])[scene.material_index]
        self.mirror, self.glass = texture == "mirror", texture == "glass"

    @cached_property
    def color(self) -> SurfaceColor:
        """Albedo of the surfaces."""
        return SurfaceColor(self.scene)


class HouseRenderer:
    """Renderer of panoramas of one scene under one lighting.

    The same scene, lighting, height and pose give the same bytes.

    Args:
        scene: The scene.
        lighting: Name of the lighting condition.
        height: Height of the panoramas in pixels, a positive multiple of 4.

    Raises:
        DataError: The lighting or a texture is unknown, or the height is not a positive multiple of 4.
    """

    def __init__(self, scene: Scene, lighting: Lighting, height: int = 512, _surfaces: _Surfaces | None = None):
        if height % _INDIRECT_STEP or height <= 0:
            raise DataError(f"the panorama height is {height} pixels; expected a positive multiple of {_INDIRECT_STEP}")
        if lighting not in CONDITIONS:
            raise DataError(f"unknown lighting '{lighting}'; expected one of {', '.join(CONDITIONS)}")
        self._scene, self._condition, self._height = scene, CONDITIONS[lighting], height
        self._surfaces = _surfaces or _Surfaces(scene)
        self._tracer = self._surfaces.tracer

    def relit(self, lighting: Lighting) -> HouseRenderer:
        """Return a renderer of the same scene under another lighting. Both renderers share geometry and textures."""
        return HouseRenderer(self._scene, lighting, self._height, self._surfaces)

    @cached_property
    def _lights(self) -> Lights:
        """Lights of the scene under the lighting."""
        return Lights(self._scene, self._condition, self._tracer)

    @cached_property
    def _emission(self) -> np.ndarray:
        """Radiance emitted by each triangle, (F,) float32."""
        on = lights_on(self._scene.lights, self._condition)
        off = [
            light.instance_id
            for light, shines in zip(self._scene.lights, on, strict=True)
            if not shines and light.instance_id
        ]
        glow = [_SCREEN_GLOW if m.texture == "screen" else self._condition.glow for m in self._scene.materials]
        emission = np.array([m.emission * g for m, g in zip(self._scene.materials, glow, strict=True)], np.float32)
        return np.where(np.isin(self._scene.instance_id, off), np.float32(0), emission[self._scene.material_index])

    def geometry(self, T_world_pano: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Render range and instances with one exact ray per pixel.

        Args:
            T_world_pano: Pose of the panorama, (4, 4).

        Returns:
            range_m (H, 2H) float32, NaN where the ray hits nothing, and instance_id (H, 2H) int32.
        """
        return self._images(self._primary(T_world_pano))

    def _images(self, surface: RayHits) -> tuple[np.ndarray, np.ndarray]:
        """Convert ray hits to the images of range and instances."""
        shape = self._height, 2 * self._height
        instance_id = np.where(surface.hit, self._scene.instance_id[surface.triangle], 0).astype(np.int32)
        return surface.range_m.reshape(shape), instance_id.reshape(shape)

    def _primary(self, T_world_pano: np.ndarray) -> RayHits:
        """Trace one ray per pixel."""
        direction = equirectangular_rays(self._height).reshape(-1, 3) @ T_world_pano[:3, :3].T.astype(np.float32)
        return self._tracer.trace(T_world_pano[:3, 3], direction)

    def render(self, T_world_pano: np.ndarray) -> Rendering:
        """Render colour, range and instances of the panorama at a pose (4, 4)."""
        surface = self._primary(T_world_pano)
        range_m, instance_id = self._images(surface)
        irradiance = self._irradiance(surface, T_world_pano[:3, 3])
        row, column = _pixels(self._height)
        radiance = self._radiance(surface, row, column, irradiance, T_world_pano)
        exposure = self._exposure(radiance, surface)
        edge = self._edges(surface)
        display = _filmic(radiance, exposure)
        display[edge] = self._supersampled(edge, exposure, irradiance, T_world_pano)
        return Rendering(self._to_srgb(display, T_world_pano), range_m, instance_id)

    def _irradiance(self, surface: RayHits, camera_m: np.ndarray) -> IrradianceGrid:
        """Compute direct light at every second pixel and indirect light at every fourth."""
        coarse = IrradianceGrid(surface, self._height, _INDIRECT_STEP)
        bounce = Bounce(self._tracer, self._lights, self._surfaces.color.mean, camera_m)
        coarse.fill(bounce.irradiance(coarse.point_m, coarse.normal, coarse.sample_set, _INDIRECT_RAYS))
        fine = IrradianceGrid(surface, self._height, _DIRECT_STEP)
        fine.fill(self._lights.direct(fine.point_m, fine.normal, fine.sample_set, _DIRECT_SAMPLES))
        row, column = np.divmod(fine.index, 2 * self._height)
        fine.add(coarse.at(row.astype(np.float32), column.astype(np.float32), surface.take(fine.index)))
        return fine

    def _radiance(
        self,
        surface: RayHits,
        row: np.ndarray,
        column: np.ndarray,
        irradiance: IrradianceGrid,
        pose: np.ndarray,
        depth: int = 0,
    ) -> np.ndarray:
        """Return the radiance at the hits of rays as linear RGB, (N, 3) float64 in Fortran order.

        Args:
            surface: Hits of the rays.
            row: Pixel row of each hit in the panorama, (N,).
            column: Pixel column of each hit in the panorama, (N,).
            irradiance: Irradiance of the panorama.
            pose: Pose of the panorama, (4, 4).
            depth: Number of mirrors and panes on the path so far.
        """
        albedo = self._surfaces.color.albedo(surface, np.pi / self._height)
        radiance = albedo * irradiance.at(row, column, surface)
        radiance *= np.float32(1 / np.pi)
        emissive = np.flatnonzero((self._emission > 0).take(surface.triangle))
        triangle = surface.triangle.take(emissive)
        radiance[emissive] += (
            self._emission[triangle, None]
            * rows(albedo, emissive)
            / self._surfaces.color.mean[triangle].max(axis=1, keepdims=True)
        )
        misses = np.flatnonzero(~surface.hit)
        radiance[misses] = _sky(rows(surface.direction, misses), self._condition)
        mirror, glass = self._surfaces.mirror, self._surfaces.glass
        specular = np.flatnonzero((mirror | glass).take(surface.triangle) & surface.hit)
        if len(specular) and depth < _SPECULAR_DEPTH:
            reflector = surface.take(specular)
            mirror = mirror.take(reflector.triangle)[:, None]
            across = np.einsum("ij,ij->i", reflector.direction, reflector.normal)[:, None]
            direction = np.where(mirror, reflector.direction - 2 * across * reflector.normal, reflector.direction)
            next_surface = self._tracer.trace(reflector.point_m + direction * np.float32(1e-3), direction)
            # The footprint of a pixel grows with the length of the whole path.
            next_surface = replace(next_surface, range_m=next_surface.range_m + reflector.range_m)
            column, row = rays_to_pixels((next_surface.point_m - pose[:3, 3]) @ pose[:3, :3], self._height)
            incoming = self._radiance(
                next_surface, row.astype(np.float32) - 0.5, column.astype(np.float32) - 0.5, irradiance, pose, depth + 1
            )
            radiance[specular] = incoming * np.where(
                mirror, rows(self._surfaces.color.mean, reflector.triangle), _GLASS_RGB
            )
        return radiance

    def _edges(self, surface: RayHits) -> np.ndarray:
        """Return the indices of the pixels next to a different surface."""
        shape = self._height, 2 * self._height
        look = self._surfaces.look.take(surface.triangle).reshape(shape)
        normal = surface.normal.T.reshape(3, *shape)
        beside = np.roll(look, -1, 1) != look
        beside |= np.einsum("kij,kij->ij", normal, np.roll(normal, -1, 2)) < 0.95
        edge = beside | np.roll(beside, 1, 1)
        below = look[1:] != look[:-1]
        below |= np.einsum("kij,kij->ij", normal[:, 1:], normal[:, :-1]) < 0.95
        edge[1:] |= below
        edge[:-1] |= below
        return np.flatnonzero(edge)

    def _supersampled(
        self, pixel: np.ndarray, exposure: float, irradiance: IrradianceGrid, pose: np.ndarray
    ) -> np.ndarray:
        """Return the tone-mapped colour of pixels, each the mean of 2 x 2 rays, (N, 3)."""
        row, column = (a.astype(np.float32) for a in np.divmod(pixel, 2 * self._height))
        total = np.zeros((len(pixel), 3), np.float32)
        for down, right in ((-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25)):
            sub_row, sub_column = row + np.float32(down), column + np.float32(right)
            surface = self._tracer.trace(
                pose[:3, 3], self._rays(sub_row, sub_column) @ pose[:3, :3].T.astype(np.float32)
            )
            total += _filmic(self._radiance(surface, sub_row, sub_column, irradiance, pose), exposure)
        return total / 4

    def _rays(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the unit directions of pixel coordinates in the panorama frame, (N, 3) float32."""
        azimuth = np.pi - np.float32(np.pi / self._height) * (column + 0.5)
        elevation = np.pi / 2 - np.float32(np.pi / self._height) * (row + 0.5)
        level = np.cos(elevation)
        return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1).astype(
            np.float32
        )

    def _exposure(self, radiance: np.ndarray, surface: RayHits) -> float:
        """Return the exposure factor: surfaces get the mean brightness `Condition.key`, unless bright surfaces would be
        overexposed."""
        is_reflective = (self._emission == 0) & ~self._surfaces.glass
        pixels = np.flatnonzero(surface.hit & is_reflective.take(surface.triangle))[::7]
        luminance = radiance[pixels] @ _LUMINANCE
        weight = np.cos(np.pi * ((pixels // (2 * self._height) + 0.5) / self._height - 0.5))
        if not len(pixels) or luminance.max() <= 0:
            return 1.0
        log_mean = np.exp(np.average(np.log(luminance + 1e-3 * luminance.max()), weights=weight))
        bright = np.percentile(luminance, 97)
        return float(min(self._condition.key / log_mean, 5 * self._condition.key / bright))

    def _to_srgb(self, display: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Convert tone-mapped linear values (H * 2H, 3) in [0, 1] to (H, 2H, 3) uint8 sRGB."""
        shape = self._height, 2 * self._height, 3
        value = _sharpened(_SRGB.take((display * (len(_SRGB) - 1)).astype(np.intp)).reshape(shape))
        if self._condition.noise:
            rng = np.random.default_rng(zlib.crc32(np.ascontiguousarray(pose, np.float64).tobytes()))
            value += rng.standard_normal(shape[:2], np.float32)[..., None] * np.float32(255 * self._condition.noise)
        value += np.float32(0.5)
        return np.clip(value, 0, 255, out=value).astype(np.uint8)


@lru_cache(maxsize=1)
def _pixels(height: int) -> np.ndarray:
    """Return row and column of every pixel, (2, H * 2H) float32."""
    return np.mgrid[:height, : 2 * height].reshape(2, -1).astype(np.float32)


def _filmic(radiance: np.ndarray, exposure: float) -> np.ndarray:
    """Tone-map radiance (N, 3) to linear display values in [0, 1].

    The curve has a toe and a long shoulder (Narkowicz's fit of ACES, 2015).
    """
    a, b, c, d, e = (np.float32(x) for x in (2.51, 0.03, 2.43, 0.59, 0.14))
    display = np.empty_like(radiance)
    for part in chunks(len(radiance)):
        value = radiance[part] * exposure
        below = c * value
        below += d
        below *= value
        below += e
        above = a * value
        above += b
        above *= value
        above /= below
        np.clip(above, 0, 1, out=display[part])
    return display


def _sharpened(image: np.ndarray) -> np.ndarray:
    """Apply an unsharp mask, as cameras do, to an image (H, 2H, 3) float32.

    The image wraps around horizontally, so that there is no seam between its first and last column.
    """
    margin = 4
    around = cv2.copyMakeBorder(image, 0, 0, margin, margin, cv2.BORDER_WRAP)
    sharpened: np.ndarray = image - cv2.GaussianBlur(around, (0, 0), _SHARPENING_SIGMA)[:, margin:-margin]
    sharpened *= np.float32(_SHARPENING)
    sharpened += image
    return sharpened


def _srgb_table(size: int = 1 << 14) -> np.ndarray:
    """Return the sRGB values, 0 to 255, of `size` linear values from 0 to 1."""
    return (255 * srgb_from_linear(np.linspace(0, 1, size))).astype(np.float32)


_SRGB = _srgb_table()


def _sky(direction: np.ndarray, condition: Condition) -> np.ndarray:
    """Return the radiance outdoors, (N, 3) float32: a gradient above a skyline of hills and trees."""
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
    skyline = 0.05 + 0.03 * np.sin(5 * azimuth + 1) + 0.02 * np.sin(17 * azimuth) + 0.012 * np.sin(43 * azimuth + 2)
    height = direction[:, 2]
    zenith, horizon, ground = (
        np.array(rgb, np.float32) for rgb in (condition.zenith_rgb, condition.horizon_rgb, condition.ground_rgb)
    )
    sky = horizon + (zenith - horizon) * np.sqrt(np.clip(height, 0, 1))[:, None].astype(np.float32)
    land = ground * (1 + 0.25 * np.sin(60 * azimuth + 25 * height) * np.clip(1 + 6 * height, 0, 1))[:, None].astype(
        np.float32
    )
    # The skyline is blurred over a third of a degree.
    above = np.clip((height - skyline) * 200, 0, 1)[:, None].astype(np.float32)
    return land + (sky - land) * above
