"""Procedural surface textures: seamless tiles with mean 1 that multiply the albedo of a material.

Their details measure 2 to 10 cm, so that a keypoint detector can see them from across a room. There is no noise at the
scale of a pixel.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from salframe.framework.errors import DataError

TILE = 256
"""Texels along each side of a tile."""

MAX_PATTERN = 3.0
"""Maximum value of a pattern, as a multiple of its mean."""


@dataclass(frozen=True)
class TextureKind:
    """Painting and mapping of a texture.

    Attributes:
        paint: Painter of the tile (TILE, TILE, 3). Its rows are the texture coordinate v, which points upwards on a
            wall.
        extent_m: Size of a tile along (u, v); None if one tile fills the surface.
        wear: Contrast of stains and scuffs.
        fixed: True: the pattern is placed exactly at its texture coordinates. False: the pattern is shifted by a
            pseudo-random offset.
    """

    paint: Callable[[np.random.Generator], np.ndarray]
    extent_m: tuple[float | None, float | None]
    wear: float = 0.0
    fixed: bool = False


def texture_kind(name: str) -> TextureKind:
    """Return the texture of this name.

    Raises:
        DataError: The name is unknown.
    """
    try:
        return _IMAGES[name] if name in _IMAGES else TEXTURES[name]
    except KeyError:
        raise DataError(f"unknown texture '{name}'; expected one of {', '.join(sorted(TEXTURES))}") from None


def image_texture(rgb: np.ndarray, *, fills: bool = False) -> str:
    """Register an image (h, w, 3) uint8 sRGB as a texture and return its name.

    Row 0 of the image is at the lower edge (v = 0). The image covers one unit of u and v. If `fills` is true, it covers
    the whole surface instead.
    """
    tile = (cv2.resize(rgb, (TILE, TILE), interpolation=cv2.INTER_AREA) / 255) ** 2.2
    name = f"{'sign' if fills else 'image'} {zlib.crc32(tile.tobytes()):08x}"
    _IMAGES[name] = TextureKind(lambda rng: tile, (None, None) if fills else (1.0, 1.0), fixed=True)
    return name


_IMAGES: dict[str, TextureKind] = {}


def texture_tile(name: str, variant: int) -> np.ndarray:
    """Return the pattern of a texture, (TILE, TILE, 3) float32 in [0, MAX_PATTERN], with mean 1 per channel.

    Raises:
        DataError: The name is unknown.
    """
    kind = texture_kind(name)
    rng = np.random.default_rng((zlib.crc32(name.encode()), variant))
    pattern = np.clip(kind.paint(rng), 0.02, None).astype(np.float32)
    return np.clip(pattern / pattern.mean(axis=(0, 1)), 0, MAX_PATTERN)


@lru_cache(maxsize=1)
def wear_tile() -> np.ndarray:
    """Return stains and scuffs, (TILE, TILE) float32, with mean 0 and a contrast of about 1.

    They make parts of a plain surface distinguishable.
    """
    rng = np.random.default_rng(zlib.crc32(b"wear"))
    wear = _blobs(rng, 700, (1.2, 2.8), aspect=2.0) + 0.25 * _blobs(rng, 60, (3.0, 9.0)) + 0.1 * _noise(rng, 2, 12)
    return (wear - wear.mean()).astype(np.float32)


# Primitives. All are periodic, so that a tile has no seam. Frequencies are in cycles per tile.

_FREQUENCY = np.fft.fftfreq(TILE, 1 / TILE)
_V, _U = np.meshgrid((np.arange(TILE) + 0.5) / TILE, (np.arange(TILE) + 0.5) / TILE, indexing="ij")


def _noise(rng: np.random.Generator, low: float, high: float, stretch: tuple[float, float] = (1.0, 1.0)) -> np.ndarray:
    """Return band-pass noise of unit standard deviation; `stretch` (u, v) lengthens its features along an axis."""
    radius_sq = (_FREQUENCY[None, :] * stretch[0]) ** 2 + (_FREQUENCY[:, None] * stretch[1]) ** 2
    gain = np.exp(-radius_sq / high**2) - np.exp(-radius_sq / low**2)
    noise = np.fft.ifft2(np.fft.fft2(rng.standard_normal((TILE, TILE))) * gain).real
    return noise / noise.std()


def _blobs(rng: np.random.Generator, count: int, radius: tuple[float, float], aspect: float = 1.0) -> np.ndarray:
    """Return the sum of `count` soft ellipses of random sign and angle, with radii in texels and aspect ratios up to
    `aspect`.
    """
    samples = np.array([(*rng.random(5), rng.integers(2), rng.random()) for _ in range(count)])
    low, high = np.array([[radius[0], 1, 0, 0, 0, -1, 0.4], [radius[1], aspect, np.pi, TILE, TILE, 1, 1]])
    r, ratio, angle, v, u, sign, strength = (low + (high - low) * samples).T
    # Texels of the bounding square of each ellipse, concatenated.
    reach = np.ceil(r * ratio + 2).astype(int)
    side = 2 * reach + 1
    number = np.arange(np.sum(side**2)) - np.repeat(np.cumsum(side**2) - side**2, side**2)
    down, right = np.divmod(number, np.repeat(side, side**2))
    top, left = v.astype(int) - reach, u.astype(int) - reach
    cos, sin = np.cos(angle), np.sin(angle)
    whole, part = np.array([top, left]), np.array([r, ratio, v, u, cos, sin, sign * strength])
    (top, left), (r, ratio, v, u, cos, sin, tone) = (np.repeat(a, side**2, axis=1) for a in (whole, part))
    row, column = top + down, left + right
    dv, du = row + 0.5 - v, column + 0.5 - u
    along, across = du * cos + dv * sin, dv * cos - du * sin
    inside = np.clip(r + 0.5 - np.hypot(along / ratio, across), 0, 1)
    image = np.bincount(row % TILE * TILE + column % TILE, tone * inside, TILE**2)
    return image.reshape(TILE, TILE)


def _joints(count_u: int, count_v: int, width: float) -> np.ndarray:
    """Return 1 on the joints of a grid of count_u x count_v cells and 0 inside the cells; width in texels."""
    distance = [np.abs(t * n - np.round(t * n)) / n * TILE for t, n in ((_U, count_u), (_V, count_v))]
    return np.clip(width / 2 + 0.5 - np.minimum(*distance), 0, 1)


def _cell_tones(rng: np.random.Generator, count_u: int, count_v: int, spread: float) -> np.ndarray:
    """Return one random tone per cell of a grid, with mean 0."""
    tones = rng.normal(0, spread, (count_v, count_u))
    return tones[(_V * count_v).astype(int), (_U * count_u).astype(int)]


def _tinted(pattern: np.ndarray, tint: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """Return the pattern in three channels. `tint` shifts the hue in proportion to the pattern's deviation from 1."""
    return pattern[..., None] + (pattern - 1)[..., None] * np.asarray(tint)


def _grain(rng: np.random.Generator) -> np.ndarray:
    """Return wood grain along u, with mean 0: fine fibres, and broad wavy rings."""
    drift = 0.8 * _noise(rng, 0.5, 3, stretch=(3, 1))
    rings = np.sin(2 * np.pi * (7 * _V + drift)) * 0.06
    fibres = 0.045 * _noise(rng, 6, 40, stretch=(10, 1)) + 0.04 * _noise(rng, 2, 14, stretch=(5, 1))
    return rings + fibres


def _planks(rng: np.random.Generator, rows: int, boards: int, spread: float) -> np.ndarray:
    """Boards along u in staggered rows, each cut from another place of the grain, with dark joints."""
    grain, tone = _grain(rng), np.empty((TILE, TILE))
    width = TILE // boards
    for row in range(rows):
        top, bottom = TILE * row // rows, TILE * (row + 1) // rows
        start = rng.integers(width)
        for board in range(boards):
            columns = (start + board * width + np.arange(width)) % TILE
            cut = np.roll(grain, tuple(rng.integers(0, TILE, 2)), axis=(0, 1))[top:bottom, :width]
            cut = 1 + rng.normal(0, spread) + cut
            cut[:, :1] *= 0.6
            cut[:1] *= 0.7
            tone[top:bottom, columns] = cut
    return tone


# Painters of `TEXTURES`. Each returns (TILE, TILE, 3).


def _plaster(rng):
    strokes = _blobs(rng, 700, (1.5, 3.5), aspect=4)
    return _tinted(1 + 0.02 * _noise(rng, 10, 45) + 0.12 * strokes)


def _wallpaper(rng):
    count = int(rng.integers(5, 9))
    waves = zip(rng.integers(0, 4, (3, 2)), rng.uniform(0, 2 * np.pi, 3), strict=True)
    motif = sum(np.cos(2 * np.pi * (fu * _U + fv * _V) + phase) for (fu, fv), phase in waves)
    figure = np.clip(3 * np.cos(2 * np.pi * count * _U + motif) * np.cos(2 * np.pi * count * _V + motif), -1, 1)
    return _tinted(1 + 0.16 * figure + 0.12 * _blobs(rng, 250, (2, 4), aspect=2), tuple(rng.uniform(-0.4, 0.4, 3)))


def _concrete(rng):
    pores = np.minimum(_blobs(rng, 400, (1.5, 4), aspect=1.5), 0)
    return _tinted(1 + 0.07 * _noise(rng, 2, 12) + 0.05 * _noise(rng, 8, 40) + 0.5 * pores)


def _wood(rng):
    knots = np.minimum(_blobs(rng, 40, (3, 8), aspect=2), 0)
    return _tinted(1 + 3 * _grain(rng).T + 0.5 * knots, (-0.15, 0.0, 0.15))


def _parquet(rng):
    return _tinted(_planks(rng, rows=16, boards=4, spread=0.25), (-0.15, 0.0, 0.15))


def _laminate(rng):
    knots = np.minimum(_blobs(rng, 90, (3, 7), aspect=2.5), 0)
    return _tinted(_planks(rng, rows=8, boards=2, spread=0.17) + 0.4 * knots, (-0.1, 0.0, 0.1))


def _fabric(rng):
    weave = 0.06 * _noise(rng, 8, 30, stretch=(4, 1)) + 0.06 * _noise(rng, 8, 30, stretch=(1, 4))
    repeat = rng.integers(4, 9)
    stripes, checks = (np.clip(3 * np.sin(2 * np.pi * repeat * t), -1, 1) for t in (_U, _V))
    pattern = (0 * stripes, 0.12 * stripes, 0.12 * stripes + 0.12 * checks, 0.18 * stripes * checks)[rng.integers(4)]
    return _tinted(1 + weave + pattern + 0.3 * _blobs(rng, 120, (4, 9), aspect=2))


def _leather(rng):
    creases = np.exp(-((_noise(rng, 3, 14) / 0.15) ** 2))
    return _tinted(1 - 0.3 * creases + 0.25 * _blobs(rng, 80, (4, 10), aspect=2))


def _carpet(rng):
    flecks = _blobs(rng, 1300, (1.5, 3.2), aspect=2)
    return _tinted(1 + 0.45 * flecks, tuple(rng.uniform(-0.12, 0.12, 3)))


def _rug(rng):
    to_edge = np.minimum(np.minimum(_U, 1 - _U), np.minimum(_V, 1 - _V))
    bands = sum(rng.choice((-0.4, 0.4)) * ((to_edge > edge) & (to_edge < edge + 0.04)) for edge in (0.02, 0.07, 0.12))
    repeat = rng.integers(3, 7, 2)
    figure = np.sign(np.cos(2 * np.pi * repeat[0] * _U) * np.cos(2 * np.pi * repeat[1] * _V) + rng.uniform(-0.3, 0.3))
    field = (to_edge > 0.16) * 0.25 * figure
    return _tinted(
        1 + bands + field + 0.05 * _noise(rng, 6, 40) + 0.25 * _blobs(rng, 300, (2, 5)),
        tuple(rng.uniform(-0.15, 0.15, 3)),
    )


def _tile(rng):
    stone = 1 + _cell_tones(rng, 4, 4, 0.08) + 0.05 * _noise(rng, 3, 20) + 0.17 * _blobs(rng, 240, (3, 7), aspect=3)
    return _tinted(np.where(_joints(4, 4, 3) > 0.5, 0.65, stone))


def _marble(rng):
    warp = _noise(rng, 1, 7)
    veins = np.exp(-((np.sin(2 * np.pi * (_U + _V) + 1.6 * warp) / 0.15) ** 2)) + 0.6 * np.exp(
        -((_noise(rng, 2, 8) / 0.08) ** 2)
    )
    return _tinted(
        1 - 0.4 * veins + 0.05 * _noise(rng, 2, 10) + 0.25 * _blobs(rng, 150, (2, 6), aspect=2), (0.05, 0.0, -0.05)
    )


def _metal(rng):
    return _tinted(
        1
        + 0.06 * _noise(rng, 4, 30, stretch=(8, 1))
        + 0.05 * _noise(rng, 1, 6)
        + 0.35 * _blobs(rng, 70, (3, 7), aspect=4)
    )


def _plastic(rng):
    return _tinted(1 + 0.03 * _noise(rng, 2, 16) + 0.12 * _blobs(rng, 70, (4, 9), aspect=3))


def _paper(rng):
    page = np.ones((TILE, TILE))
    for row in range(20, TILE - 30, 24):
        end = int(rng.uniform(0.5, 0.92) * TILE)
        words = np.repeat(rng.random(TILE // 16 + 1) < 0.8, 16)[:TILE]
        page[row : row + 10] = np.where(words & (np.arange(TILE) > 20) & (np.arange(TILE) < end), 0.5, 1)
    return _tinted(page + 0.02 * _noise(rng, 3, 20))[::-1]


def _leaf(rng):
    veins = np.abs(((_U * 6 + 3 * np.abs(_V - 0.5)) % 1) - 0.5) < 0.06
    return _tinted(
        1 + 0.12 * _noise(rng, 2, 14) + 0.3 * veins + 0.25 * _blobs(rng, 120, (5, 12), aspect=2.5), (0.3, 0.0, 0.1)
    )


def _palette(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return muted colours around a common hue, (count, 3)."""
    hue = rng.uniform(0, 2 * np.pi) + rng.normal(0, 0.9, count)
    chroma = rng.uniform(0.05, 0.3, count)[:, None] * np.cos(hue[:, None] + np.array([0, 2.1, 4.2]))
    return rng.uniform(0.25, 1.0, count)[:, None] * (1 + chroma)


def _picture(rng):
    paint = np.ones((TILE, TILE, 3)) * _palette(rng, 1)
    if rng.random() < 0.5:  # hills under a sky
        sky = _palette(rng, 2)
        paint = sky[0] + (sky[1] - sky[0]) * _V[..., None]
        for level, color in zip(np.linspace(0.4, 0.85, 4), _palette(rng, 4), strict=True):
            ridge = level + 0.06 * _noise(rng, 0.5, 5)[:1]
            paint = np.where((ridge < _V)[..., None], color, paint)
    for color in _palette(rng, int(rng.integers(6, 16))):  # shapes
        centre, size, angle = rng.random(2), rng.uniform(0.03, 0.2, 2), rng.uniform(0, np.pi)
        du, dv = _U - centre[0], _V - centre[1]
        along, across = (
            (du * np.cos(angle) + dv * np.sin(angle)) / size[0],
            (dv * np.cos(angle) - du * np.sin(angle)) / size[1],
        )
        round_shape = np.hypot(along, across) < 1
        shape = round_shape if rng.random() < 0.5 else np.maximum(np.abs(along), np.abs(across)) < 1
        paint = np.where(shape[..., None], color, paint)
    paint = paint * (1 + 0.05 * _noise(rng, 6, 40))[..., None]
    if rng.random() < 0.4:  # a mount around it
        mount = np.maximum(np.abs(_U - 0.5), np.abs(_V - 0.5)) > rng.uniform(0.36, 0.44)
        paint = np.where(mount[..., None], 0.95, paint)
    return paint[::-1]


def _screen(rng):
    paint = np.ones((TILE, TILE, 3)) * rng.uniform(0.1, 0.25)
    for color in _palette(rng, int(rng.integers(2, 5))):  # windows with a title bar and lines of text
        left, top = rng.integers(4, TILE // 2, 2)
        right, bottom = left + rng.integers(60, 130), top + rng.integers(60, 120)
        paint[top:bottom, left:right] = 0.8 * (0.5 + 0.5 * color)
        paint[top : top + 10, left:right] = 0.5 * color
        for row in range(top + 18, min(bottom, TILE) - 6, 10):
            paint[row : row + 4, left + 6 : left + 6 + rng.integers(20, 50)] *= 0.4
    return paint[::-1]


def _books(rng):
    paint, left = np.empty((TILE, TILE, 3)), 0
    while left < TILE:
        right = min(left + int(rng.integers(4, 13)), TILE)
        color, height = _palette(rng, 1)[0], rng.uniform(0.72, 0.97)
        spine = np.where((_V[:, :1] > 1 - height)[..., None], color, 0.08) * np.ones((1, right - left, 1))
        for band in rng.uniform(1 - height + 0.05, 0.95, int(rng.integers(1, 4))):
            spine[int(band * TILE) : int(band * TILE) + 8] *= rng.choice((0.5, 1.5))
        spine[:, 0] *= 0.4
        paint[:, left:right] = spine
        left = right
    return paint[::-1]


def _ceiling(rng):
    fissures = np.minimum(_blobs(rng, 1200, (0.8, 1.6), aspect=3), 0)
    panels = 1 + _cell_tones(rng, 4, 4, 0.04) + 0.45 * fissures
    return _tinted(panels * (1 - 0.5 * _joints(4, 4, 3.0)))


def _plain(rng):
    return np.ones((TILE, TILE, 3))


TEXTURES: dict[str, TextureKind] = {
    "plaster": TextureKind(_plaster, (2.3, 2.3), wear=0.09),
    "wallpaper": TextureKind(_wallpaper, (1.6, 1.6), wear=0.1),
    "concrete": TextureKind(_concrete, (2.5, 2.5), wear=0.10),
    "wood": TextureKind(_wood, (1.1, 1.1), wear=0.10),
    "parquet": TextureKind(_parquet, (1.6, 1.6), wear=0.10),
    "laminate": TextureKind(_laminate, (1.3, 1.3), wear=0.10),
    "fabric": TextureKind(_fabric, (0.9, 0.9), wear=0.10),
    "leather": TextureKind(_leather, (0.8, 0.8), wear=0.10),
    "carpet": TextureKind(_carpet, (1.9, 1.9), wear=0.10),
    "rug": TextureKind(_rug, (None, None), wear=0.06, fixed=True),
    "tile": TextureKind(_tile, (1.2, 1.2), wear=0.05),
    "marble": TextureKind(_marble, (1.7, 1.7), wear=0.04),
    "metal": TextureKind(_metal, (0.9, 0.9), wear=0.10),
    "plastic": TextureKind(_plastic, (0.9, 0.9), wear=0.04),
    "paper": TextureKind(_paper, (0.3, 0.3)),
    "leaf": TextureKind(_leaf, (0.5, 0.5)),
    "picture": TextureKind(_picture, (None, None), fixed=True),
    "screen": TextureKind(_screen, (None, None), fixed=True),
    "books": TextureKind(_books, (1.3, None), fixed=True),
    "glass": TextureKind(_plain, (1.0, 1.0)),
    "mirror": TextureKind(_plain, (1.0, 1.0)),
    "ceiling": TextureKind(_ceiling, (2.4, 2.4), wear=0.03),
}
