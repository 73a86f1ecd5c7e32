"""What a building's data set shows: its frames, their panoramas, and the table of its objects."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from salframe.panoramas.geometry import pose_yaw
from salframe.panoramas.panorama import Annotations, Panorama
from salframe_house.assets import Catalogue
from salframe_house.building import (
    CHANGE_KINDS,
    Building,
    ChangeKind,
    Changes,
    Style,
    change_building,
    generate_building,
)
from salframe_house.frames import HouseFrame, choose_frames
from salframe_house.lighting import Lighting
from salframe_house.render import HouseRenderer
from salframe_house.settings import HouseConfig


@cache
def buildings(
    style: Style,
    rooms: int,
    seed: int,
    changed_fraction: float,
    changes: Changes = "uniform",
    kinds: tuple[ChangeKind, ...] = CHANGE_KINDS,
) -> tuple[Building, Building]:
    """The building that is mapped, and what has become of it when the queries are taken."""
    building = generate_building(style, rooms, seed)
    return building, change_building(building, changed_fraction, seed, changes, kinds)


def buildings_of(config: HouseConfig) -> tuple[Building, Building]:
    """`buildings` of a data set."""
    return buildings(
        config.style, config.rooms, config.seed, config.changed_fraction, config.changes, config.change_kinds
    )


def frames_of(config: HouseConfig) -> tuple[HouseFrame, ...]:
    """`choose_frames` of a data set, its queries in one light where there is one for all."""
    frames = choose_frames(
        *buildings_of(config),
        config.seed,
        config.queries_per_room,
        config.query_yaw,
        config.query_shift_m,
        config.frames_per_room,
    )
    if config.lighting == "other":
        return frames
    return tuple(replace(frame, lighting=config.lighting) if frame.is_query else frame for frame in frames)


def object_table(building: Building, changed: Building) -> dict[str, Sequence[Any]]:
    """The columns of the table of objects: those of the mapped building, then those that it has later only."""
    mapped = {placed.instance_id for placed in building.objects}
    objects = [*building.objects, *(placed for placed in changed.objects if placed.instance_id not in mapped)]
    centre = np.array([placed.bounds_m.mean(axis=0) for placed in objects])
    size = np.array([placed.size_m for placed in objects])
    return {
        "instance_id": [placed.instance_id for placed in objects],
        "label": [placed.label for placed in objects],
        "room": [placed.room for placed in objects],
        **dict(zip(("x_m", "y_m", "z_m"), centre.T, strict=True)),
        **dict(zip(("length_m", "width_m", "height_m"), size.T, strict=True)),
        "yaw_rad": [placed.yaw_rad for placed in objects],
    }


def render_frame(config: HouseConfig, frame: HouseFrame) -> Panorama:
    """The panorama of a frame: queries see the changed building."""
    return _render(config, frame.pose, frame.is_query, frame.lighting, frame.id)


def render_pose(config: HouseConfig, T_world_pano: np.ndarray) -> Panorama:
    """A panorama of the changed building at a pose (4, 4), in the queries' light; where that is not one for all, in the
    evening's."""
    x, y, z = T_world_pano[:3, 3]
    id = f"at {x:.4f} {y:.4f} {z:.4f} {np.degrees(pose_yaw(T_world_pano)):.3f}"
    return _render(config, T_world_pano, True, "evening" if config.lighting == "other" else config.lighting, id)


def _render(config: HouseConfig, T_world_pano: np.ndarray, changed: bool, lighting: Lighting, id: str) -> Panorama:
    renderer = _renderer(config, changed, lighting)
    before, after = buildings_of(config)
    labels = {**before.labels, **after.labels}
    if config.rgb:
        rendering = renderer.render(T_world_pano)
        rgb, range_m, instance_id = rendering.rgb, rendering.range_m, rendering.instance_id
    else:
        rgb, (range_m, instance_id) = None, renderer.geometry(T_world_pano)
    annotations = Annotations(instance_id, labels, rendered=True)
    return Panorama(id, rgb, _query_range(config, range_m, id) if changed else range_m, annotations=annotations)


def _query_range(config: HouseConfig, range_m: np.ndarray, id: str) -> np.ndarray | None:
    """The range that a query comes with: none, or off by its factor."""
    if not config.query_range:
        return None
    factor = 1 + config.query_scale_share * np.random.default_rng((config.seed, zlib.crc32(id.encode()))).normal()
    return range_m * np.float32(max(factor, 0.1))


@cache
def _renderer(config: HouseConfig, changed: bool, lighting: Lighting) -> HouseRenderer:
    """Renderers of one process; the lightings of one building share its geometry and textures."""
    if lighting != "day":
        return _renderer(config, changed, "day").relit(lighting)
    catalogue = Catalogue(config.models, config.models_part) if config.models else None
    return HouseRenderer(buildings_of(config)[changed].scene(catalogue), "day", config.height)
