"""Panoramas for training: rooms of generated buildings from several positions, by day, and in different light after
changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.engines.process_pool import ProcessPool
from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import digest
from salframe.framework.files.reading import read_arrays
from salframe.framework.files.writing import write_arrays
from salframe.panoramas.geometry import pose_2d
from training.loftr_compact.settings import Panoramas

STYLES = ("home", "office", "hotel")
ROOM_PANORAMAS = ((0, "day"), (1, "day"), (0, "evening"), (2, "evening"), (3, "dim"))
"""Index of the position, and lighting, of each panorama of a room. Panoramas with another lighting than "day" show the
building after objects were removed, moved or added."""

NEAR_M, FAR_M = 0.3, 2.0
"""Minimum and maximum distance between the first position in a room and the others."""

CLEARANCE_M = 0.3
WORKERS = 2


@dataclass(frozen=True, eq=False)
class GrayPanorama:
    """A panorama: `gray` (H, 2H) uint8, `range_m` (H, 2H) float16, NaN where unknown, and `T_world_pano` (4, 4)."""

    gray: np.ndarray
    range_m: np.ndarray
    T_world_pano: np.ndarray


def folder(config: Panoramas) -> Path:
    """Return the folder in which the panoramas of these settings and this generator are stored."""
    from salframe_house.dataset import House

    return cache_home() / "loftr-training" / digest({"house": House.version, **config.model_dump()})[:16]


def render(config: Panoramas, seeds: Sequence[int], progress: Callable[[int, int], None]) -> None:
    """Render the panoramas that do not exist yet, two buildings at a time. progress(done, total) counts buildings."""
    progress(0, len(seeds))
    with ProcessPool(WORKERS) as pool:
        for done, future in enumerate(as_completed([pool.submit(_render_building, config, seed) for seed in seeds]), 1):
            future.result()
            progress(done, len(seeds))


def read_rooms(config: Panoramas, seeds: Sequence[int]) -> list[tuple[GrayPanorama, ...]]:
    """Return the panoramas of each room of the buildings, in a fixed order."""
    rooms: dict[str, list[GrayPanorama]] = {}
    for path in sorted(path for seed in seeds for path in folder(config).glob(f"{seed}-*.npz")):
        rooms.setdefault(path.stem.rpartition("-")[0], []).append(GrayPanorama(**read_arrays(path)))
    return [tuple(panoramas) for panoramas in rooms.values()]


def _render_building(config: Panoramas, seed: int) -> None:
    from salframe_house.building import change_building, generate_building
    from salframe_house.render import HouseRenderer

    building = generate_building(STYLES[seed % len(STYLES)], config.rooms, seed)
    changed = change_building(building, config.changed_fraction, seed)
    rng = np.random.default_rng((seed, 8))
    day, later = (
        HouseRenderer(building.scene(), "day", config.height),
        HouseRenderer(changed.scene(), "evening", config.height),
    )
    renderers = {"day": day, "evening": later, "dim": later.relit("dim")}
    free, free_later = building.free_space(CLEARANCE_M), changed.free_space(CLEARANCE_M)
    for room in building.rooms:
        both = np.array(sorted(set(map(tuple, free[room.id])) & set(map(tuple, free_later[room.id]))))
        if not len(both):
            continue
        places = _places(both, rng)
        for number, (place, light) in enumerate(ROOM_PANORAMAS):
            path = folder(config) / f"{seed}-{room.id}-{number}.npz"
            if not path.exists():
                rendering = renderers[light].render(places[place])
                write_arrays(
                    path,
                    {
                        "gray": _gray(rendering.rgb),
                        "range_m": rendering.range_m.astype(np.float16),
                        "T_world_pano": places[place],
                    },
                )


def _places(free_m: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Return random (4, 4) poses in the free space (N, 2) of a room, near the first pose if there is space near it."""
    first = free_m[rng.integers(len(free_m))]
    away = np.linalg.norm(free_m - first, axis=1)
    near = free_m[(away >= NEAR_M) & (away <= FAR_M)]
    near = near if len(near) else free_m
    others = near[rng.integers(len(near), size=max(place for place, _ in ROOM_PANORAMAS))]
    return [pose_2d(*point, rng.uniform(-np.pi, np.pi), 1.5 + rng.uniform(-0.05, 0.05)) for point in (first, *others)]


def _gray(rgb: np.ndarray) -> np.ndarray:
    import cv2

    return cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
