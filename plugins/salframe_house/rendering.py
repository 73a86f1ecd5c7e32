"""Content of the dataset `house`: frames, panoramas and the table of objects."""

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
from salframe_house.driving import drive_all
from salframe_house.frames import HouseFrame, choose_frames, move_queries
from salframe_house.lighting import Lighting
from salframe_house.render import HouseRenderer
from salframe_house.settings import HouseConfig
from salframe_house.signs import change_signs, place_signs


@cache
def buildings(
    style: Style,
    rooms: int,
    seed: int,
    changed_fraction: float,
    changes: Changes = "uniform",
    kinds: tuple[ChangeKind, ...] = CHANGE_KINDS,
    signs: bool = False,
    signs_unreadable: float = 0.0,
    signs_wrong: float = 0.0,
) -> tuple[Building, Building]:
    """Return the building at the time of mapping and at the time of the queries."""
    building = generate_building(style, rooms, seed)
    if signs:
        building = replace(building, signs=place_signs(building.layout, building.objects, seed))
    changed = change_building(building, changed_fraction, seed, changes, kinds)
    return building, replace(changed, signs=change_signs(building.signs, signs_unreadable, signs_wrong, seed))


def buildings_of(config: HouseConfig) -> tuple[Building, Building]:
    """Return the `buildings` of a dataset."""
    return buildings(
        config.style,
        config.rooms,
        config.seed,
        config.changed_fraction,
        config.changes,
        config.change_kinds,
        config.signs,
        config.signs_unreadable,
        config.signs_wrong,
    )


@cache
def frames_of(config: HouseConfig) -> tuple[HouseFrame, ...]:
    """Return the frames of a dataset (see `choose_frames`), with the lighting of its settings. Earlier views of driven
    queries come before their query."""
    frames = choose_frames(
        *buildings_of(config),
        config.seed,
        config.queries_per_room,
        config.query_yaw,
        config.query_shift_m,
        config.frames_per_room,
        config.frames_per_position,
        config.map_spacing_m,
    )
    frames = move_queries(frames, config.seed, config.query_tilt_deg, config.query_height_m)
    if config.lighting != "other":
        frames = tuple(replace(frame, lighting=config.lighting) if frame.is_query else frame for frame in frames)
    if not is_driven(config):
        return frames
    queries = [frame for frame in frames if frame.is_query]
    driven = drive_all(buildings_of(config)[1], queries, config.query_views, config.seed)
    return (*(frame for frame in frames if not frame.is_query), *(view for views in driven for view in views))


def is_driven(config: HouseConfig) -> bool:
    """Return whether queries are views along a path."""
    return config.query_motion == "driven" and config.query_views > 1


def sequences_of(config: HouseConfig) -> dict[str, list[str]]:
    """Return the ids of the earlier views of each driven query, by the id of the query."""
    if not is_driven(config):
        return {}
    ids = [frame.id for frame in frames_of(config) if frame.is_query]
    groups = [ids[start : start + config.query_views] for start in range(0, len(ids), config.query_views)]
    return {views[-1]: views[:-1] for views in groups}


def object_table(building: Building, changed: Building) -> dict[str, Sequence[Any]]:
    """Return the columns of the table of objects.

    The objects of the mapped building come first, then the objects that were added later.
    """
    objects = [*building.objects, *building.signs]
    original_ids = {obj.instance_id for obj in objects}
    later = (*changed.objects, *changed.signs)
    objects += [obj for obj in later if obj.instance_id not in original_ids]
    centre = np.array([obj.bounds_m.mean(axis=0) for obj in objects])
    size = np.array([obj.size_m for obj in objects])
    return {
        "instance_id": [obj.instance_id for obj in objects],
        "label": [obj.label for obj in objects],
        "room": [obj.room for obj in objects],
        **dict(zip(("x_m", "y_m", "z_m"), centre.T, strict=True)),
        **dict(zip(("length_m", "width_m", "height_m"), size.T, strict=True)),
        "yaw_rad": [obj.yaw_rad for obj in objects],
    }


def render_frame(config: HouseConfig, frame: HouseFrame) -> Panorama:
    """Render the panorama of a frame. Queries show the changed building."""
    return _render(config, frame.pose, frame.is_query, frame.lighting, frame.id)


def render_pose(config: HouseConfig, T_world_pano: np.ndarray) -> Panorama:
    """Render a panorama of the changed building at a pose (4, 4).

    The lighting is the one of the queries; "evening" if the queries do not all have the same lighting.
    """
    x, y, z = T_world_pano[:3, 3]
    id = f"at {x:.4f} {y:.4f} {z:.4f} {np.degrees(pose_yaw(T_world_pano)):.3f}"
    return _render(config, T_world_pano, True, "evening" if config.lighting == "other" else config.lighting, id)


def _render(config: HouseConfig, T_world_pano: np.ndarray, changed: bool, lighting: Lighting, id: str) -> Panorama:
    """Render a panorama with annotations, and with colour and range as the settings select."""
    renderer = _renderer(config, changed, lighting)
    before, after = buildings_of(config)
    labels = {**before.labels, **after.labels}
    if config.rgb:
        rendering = renderer.render(T_world_pano)
        rgb, range_m, instance_id = rendering.rgb, rendering.range_m, rendering.instance_id
    else:
        rgb, (range_m, instance_id) = None, renderer.geometry(T_world_pano)
    annotations = Annotations(instance_id, labels, rendered=True)
    shown_m = _query_range(config, range_m, id) if changed else range_m if config.map_range else None
    return Panorama(id, rgb, shown_m, annotations=annotations)


def _query_range(config: HouseConfig, range_m: np.ndarray, id: str) -> np.ndarray | None:
    """Return the range of a query, multiplied by its random scale factor; None if queries have no range."""
    if not config.query_range:
        return None
    factor = 1 + config.query_scale_share * np.random.default_rng((config.seed, zlib.crc32(id.encode()))).normal()
    return range_m * np.float32(max(factor, 0.1))


@cache
def _renderer(config: HouseConfig, changed: bool, lighting: Lighting) -> HouseRenderer:
    """Return the renderer of a building. The lightings of one building share its geometry and textures."""
    if lighting != "day":
        return _renderer(config, changed, "day").relit(lighting)
    catalogue = Catalogue(config.models, config.models_part) if config.models else None
    return HouseRenderer(buildings_of(config)[changed].scene(catalogue), "day", config.height)
