"""Panoramas for training and evaluation: random buildings, poses and lighting. They are rendered once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from salframe_house.assets import Catalogue, Part
from salframe_house.building import generate_building
from salframe_house.lighting import CONDITIONS
from salframe_house.render import HouseRenderer

from salframe.framework.engines.process_pool import ProcessPool
from salframe.framework.files.reading import read_json
from salframe.framework.files.writing import write_json
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.images import read_color, read_ids, read_range, write_color, write_ids, write_range

STYLES = ("home", "office", "hotel")
ROOMS = (8, 16)
"""Minimum and maximum number of rooms of a building."""
EYE_M = (1.1, 1.7)
"""Minimum and maximum height of the camera above the floor."""
CLEARANCE_M = 0.3
WORKERS = 2


@dataclass(frozen=True, eq=False)
class LabelledPanorama:
    """A rendered panorama with ground truth.

    Attributes:
        rgb: (H, 2H, 3) uint8.
        range_m: (H, 2H) float32.
        instance_id: (H, 2H) int32.
        labels: Label of each instance id.
        centre_m: (3,) float64 centre of the complete object's box in the panorama frame, by instance id.
    """

    rgb: np.ndarray
    range_m: np.ndarray
    instance_id: np.ndarray
    labels: dict[int, str]
    centre_m: dict[int, np.ndarray]


def render_panoramas(
    root: Path,
    seeds: Sequence[int],
    count: int,
    height: int,
    assets: Path | None,
    part: Part | None,
    progress: Callable[[int, int], None],
) -> list[Path]:
    """Render `count` panoramas of one building per seed into `root`, unless they exist.

    Args:
        root: Output folder.
        seeds: Seeds of the buildings.
        count: Number of panoramas per building.
        height: Height of a panorama in pixels.
        assets: Folder with furniture models, None for boxes.
        part: Part of the models to use.
        progress: Called as progress(done, total) with numbers of buildings.

    Returns:
        One path per panorama, without suffix, for `read_panorama`.
    """
    todo = [seed for seed in seeds if not (root / f"{seed}.json").exists()]
    done = len(seeds) - len(todo)
    progress(done, len(seeds))
    root.mkdir(parents=True, exist_ok=True)
    with ProcessPool(WORKERS) as pool:
        for future in as_completed(
            [pool.submit(_render_building, root, seed, count, height, assets, part) for seed in todo]
        ):
            future.result()
            done += 1
            progress(done, len(seeds))
    return [root / f"{seed}-{number}" for seed in seeds for number in range(count)]


def _render_building(root: Path, seed: int, count: int, height: int, assets: Path | None, part: Part | None) -> None:
    """Render the panoramas of one building. Its JSON file is written last and marks the building as complete."""
    rng = np.random.default_rng((seed, 11))
    building = generate_building(STYLES[seed % len(STYLES)], int(rng.integers(ROOMS[0], ROOMS[1] + 1)), seed)
    scene = building.scene(Catalogue(assets, part) if assets else None)
    renderer = HouseRenderer(scene, "day", height)
    renderers = {lighting: renderer.relit(lighting) for lighting in CONDITIONS}
    free = {room: points for room, points in building.free_space(CLEARANCE_M).items() if len(points)}
    poses = []
    for number in range(count):
        points = free[list(free)[rng.integers(len(free))]]
        x, y = points[rng.integers(len(points))]
        pose = pose_2d(x, y, rng.uniform(-np.pi, np.pi), rng.uniform(*EYE_M))
        rendering = renderers[list(CONDITIONS)[rng.integers(len(CONDITIONS))]].render(pose)
        write_color(root / f"{seed}-{number}.jpg", rendering.rgb)
        write_range(root / f"{seed}-{number}.range.png", rendering.range_m)
        write_ids(root / f"{seed}-{number}.instances.png", rendering.instance_id)
        poses.append(pose.tolist())
    objects = {
        str(placed.instance_id): [placed.label, *placed.bounds_m.mean(0).tolist()] for placed in building.objects
    }
    write_json(root / f"{seed}.json", {"poses": poses, "objects": objects})


def read_panorama(path: Path) -> LabelledPanorama:
    """Read a panorama by its path from `render_panoramas`."""
    building, number = _building(path)
    T_world_pano = np.array(building["poses"][number])
    centre_m = {
        int(key): (np.array(value[1:]) - T_world_pano[:3, 3]) @ T_world_pano[:3, :3]
        for key, value in building["objects"].items()
    }
    rgb, range_m = read_color(path.with_name(path.name + ".jpg")), read_range(path.with_name(path.name + ".range.png"))
    return LabelledPanorama(rgb, range_m, *_instances(path, building), centre_m)


def read_instances(path: Path) -> tuple[np.ndarray, dict[int, str]]:
    """Read only instance_id (H, 2H) int32 and labels of a panorama."""
    return _instances(path, _building(path)[0])


def _building(path: Path) -> tuple[dict[str, Any], int]:
    """Read the JSON file of a panorama's building. Return its content and the number of the panorama."""
    seed, _, number = path.name.rpartition("-")
    return read_json(path.with_name(f"{seed}.json")), int(number)


def _instances(path: Path, building: dict[str, Any]) -> tuple[np.ndarray, dict[int, str]]:
    return read_ids(path.with_name(path.name + ".instances.png")), {
        int(key): value[0] for key, value in building["objects"].items()
    }
