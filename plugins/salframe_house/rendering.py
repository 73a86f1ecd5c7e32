"""Content of the dataset `house`: frames, panoramas and the table of objects."""

from __future__ import annotations

import zlib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from salframe.panoramas.floors import Connection, FloorMasks
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
from salframe_house.storeys import (
    STOREY_M,
    lower_pose,
    name_on,
    raise_frame,
    raise_masks,
    stairs_between,
    storey_at,
    storey_configs,
)


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
    """Return a building of one storey in two states: when the map is made, and when the queries are taken.

    For several storeys, call this function with each of `storey_configs`.
    """
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


def floors_of(config: HouseConfig) -> tuple[list[FloorMasks], list[FloorMasks]]:
    """Return the floor masks of each storey at the time of mapping and at the time of the queries."""
    storeys = [
        [raise_masks(config, number, building.floor_masks()) for building in buildings_of(storey)]
        for number, storey in enumerate(storey_configs(config))
    ]
    before, after = zip(*storeys, strict=True)
    return list(before), list(after)


def stairs_of(config: HouseConfig) -> list[Connection]:
    """Return the stairs between the storeys of a dataset."""
    return stairs_between(config, [buildings_of(storey)[0] for storey in storey_configs(config)])


def room_types_of(config: HouseConfig) -> dict[str, str]:
    """Return the type of each room of a dataset."""
    return {
        name_on(config, number, room.id): room.kind
        for number, storey in enumerate(storey_configs(config))
        for room in buildings_of(storey)[0].rooms
    }


@cache
def frames_of(config: HouseConfig) -> tuple[HouseFrame, ...]:
    """Return the frames of a dataset, storey by storey (see `choose_frames`), with the lighting of its settings.
    The earlier views of a query with `query_motion=driven` come directly before its last view."""
    if config.storeys == 1:
        return _frames_of_storey(config)
    frames: list[HouseFrame] = []
    for number, storey in enumerate(storey_configs(config)):
        before = len(frames)  # ids of queries continue to count, because the storey would reveal their position
        for frame in _frames_of_storey(storey):
            id = _count_on(frame.id, before) if frame.is_query else name_on(config, number, frame.id)
            frames.append(raise_frame(config, number, frame, id))
    return tuple(frames)


def _count_on(query_id: str, count: int) -> str:
    """Return the id of a query whose number is larger by a count."""
    name, number, *view = query_id.split("-")
    return "-".join([name, f"{int(number) + count:04d}", *view])


def _frames_of_storey(config: HouseConfig) -> tuple[HouseFrame, ...]:
    """Return the frames of one storey."""
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
    """Return the ids of the earlier views of each driven query (views along a path), by the id of the query."""
    if not is_driven(config):
        return {}
    ids = [frame.id for frame in frames_of(config) if frame.is_query]
    groups = [ids[start : start + config.query_views] for start in range(0, len(ids), config.query_views)]
    return {views[-1]: views[:-1] for views in groups}


def object_table(config: HouseConfig) -> dict[str, Sequence[Any]]:
    """Return the columns of the table of objects.

    On each storey, the objects of the mapped building come first, then the objects that were added later.
    """
    columns: dict[str, list[Any]] = defaultdict(list)
    first_ids = first_ids_of(config)
    for number, storey in enumerate(storey_configs(config)):
        building, changed = buildings_of(storey)
        objects = [*building.objects, *building.signs]
        original_ids = {obj.instance_id for obj in objects}
        objects += [obj for obj in (*changed.objects, *changed.signs) if obj.instance_id not in original_ids]
        for obj in objects:
            centre_m = obj.bounds_m.mean(axis=0) + np.array([0.0, 0.0, number * STOREY_M])
            columns["instance_id"].append(obj.instance_id + first_ids[number])
            columns["label"].append(obj.label)
            columns["room"].append(name_on(config, number, obj.room))
            for name, value in zip(("x_m", "y_m", "z_m"), centre_m, strict=True):
                columns[name].append(value)
            for name, value in zip(("length_m", "width_m", "height_m"), obj.size_m, strict=True):
                columns[name].append(value)
            columns["yaw_rad"].append(obj.yaw_rad)
    return dict(columns)


def first_ids_of(config: HouseConfig) -> list[int]:
    """Return the number that is added to the instance ids of each storey, so that they differ between storeys."""
    storeys = [buildings_of(storey) for storey in storey_configs(config)]
    max_ids = [max({**before.labels, **after.labels}, default=0) for before, after in storeys]
    return [0, *np.cumsum(max_ids)[:-1].tolist()]


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
    number = storey_at(config, T_world_pano[2, 3])
    storey, T_storey_pano = storey_configs(config)[number], lower_pose(T_world_pano, number)
    renderer = _renderer(storey, changed, lighting)
    before, after = buildings_of(storey)
    first_id = first_ids_of(config)[number]
    labels = {instance_id + first_id: label for instance_id, label in {**before.labels, **after.labels}.items()}
    if config.rgb:
        rendering = renderer.render(T_storey_pano)
        rgb, range_m, instance_id = rendering.rgb, rendering.range_m, rendering.instance_id
    else:
        rgb, (range_m, instance_id) = None, renderer.geometry(T_storey_pano)
    annotations = Annotations(np.where(instance_id > 0, instance_id + first_id, 0), labels, rendered=True)
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
