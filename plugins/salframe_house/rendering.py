"""Rendering a building into a dataset folder: the frames in a few processes, what describes them, and the manifest
last."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from pathlib import Path

import numpy as np

from salframe.framework.errors import SalframeError
from salframe.framework.processes import die_with_parent
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder_format import (
    FrameEntry,
    TruthEntry,
    is_written,
    write_floor,
    write_manifest,
    write_objects,
    write_panorama,
)
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.images import read_ids
from salframe.panoramas.panorama import Annotations, Panorama
from salframe_house.assets import Catalogue
from salframe_house.building import Building, Style, change_building, generate_building
from salframe_house.dataset import House
from salframe_house.frames import FrameSpec, choose_frames
from salframe_house.render import Renderer

VISIBLE_PIXELS = 50
"""An object that covers fewer pixels is not visible."""

_WORKERS = 2


def render_building(root: Path, config: House.Config, progress: Callable[[int, int], None]) -> None:
    """Render the frames of a building that are not in the folder `root` yet, then describe them all.

    `progress(done, total)` counts frames. Raises SalframeError where a rendering process dies.
    """
    building, changed = buildings(config.style, config.rooms, config.seed, config.changed_fraction)
    specs = choose_frames(building, changed, config.seed, config.queries_per_room, config.query_yaw)
    entries = [_entry(number, spec, config.rgb) for number, spec in enumerate(specs)]
    _render(root, config, list(zip(specs, entries, strict=True)), progress)
    _describe(root, building, changed, specs, entries)


def _render(
    root: Path, config: House.Config, frames: list[tuple[FrameSpec, FrameEntry]], progress: Callable[[int, int], None]
) -> None:
    todo = [(spec, entry) for spec, entry in frames if not is_written(root, entry)]
    done = len(frames) - len(todo)
    progress(done, len(frames))
    if not todo:
        return
    pool = ProcessPoolExecutor(_WORKERS, mp_context=multiprocessing.get_context("spawn"), initializer=die_with_parent)
    try:
        for future in as_completed([pool.submit(_render_frame, root, config, spec, entry) for spec, entry in todo]):
            future.result()
            done += 1
            progress(done, len(frames))
    except BrokenProcessPool:
        raise SalframeError(
            f"a rendering process died after {done} of {len(frames)} frames: run it again to resume"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _describe(
    root: Path, building: Building, changed: Building, specs: Sequence[FrameSpec], entries: list[FrameEntry]
) -> None:
    """Write what describes the frames; the manifest, which says that all is there, comes last."""
    truth = {
        entry.id: TruthEntry(place=spec.place, pose=_pose(spec), instances=_visible(root / str(entry.instances)))
        for spec, entry in zip(specs, entries, strict=True)
        if spec.role == "query"
    }
    mapped = {placed.instance_id for placed in building.objects}
    objects = [*building.objects, *(placed for placed in changed.objects if placed.instance_id not in mapped)]
    centre = np.array([placed.bounds_m.mean(axis=0) for placed in objects])
    size = np.array([placed.size_m for placed in objects])
    write_objects(
        root / "objects.parquet",
        {
            "instance_id": [placed.instance_id for placed in objects],
            "label": [placed.label for placed in objects],
            "room": [placed.room for placed in objects],
            **dict(zip(("x_m", "y_m", "z_m"), centre.T, strict=True)),
            **dict(zip(("length_m", "width_m", "height_m"), size.T, strict=True)),
            "yaw_rad": [placed.yaw_rad for placed in objects],
        },
    )
    floor = write_floor(root, "floor", building.floor_masks())
    write_manifest(root, entries, truth, "objects.parquet", [floor], rendered=True)


@cache
def buildings(style: Style, rooms: int, seed: int, changed_fraction: float) -> tuple[Building, Building]:
    """The building that is mapped, and what has become of it when the queries are taken."""
    building = generate_building(style, rooms, seed)
    return building, change_building(building, changed_fraction, seed)


def render_panorama(config: House.Config, T_world_pano: np.ndarray) -> Panorama:
    """A panorama of the changed building at a pose (4, 4), in the queries' light; where that is not one for all, in the
    evening's."""
    lighting = "evening" if config.lighting == "other" else config.lighting
    renderer = _renderer(config, True, lighting)
    mapped, changed = buildings(config.style, config.rooms, config.seed, config.changed_fraction)
    labels = {**mapped.labels, **changed.labels}
    x, y, z = T_world_pano[:3, 3]
    id = f"at {x:.4f} {y:.4f} {z:.4f} {np.degrees(pose_yaw(T_world_pano)):.3f}"
    if config.rgb:
        rendering = renderer.render(T_world_pano)
        return Panorama(
            id, rendering.rgb, rendering.range_m, annotations=Annotations(rendering.instance_id, labels, rendered=True)
        )
    range_m, instance_id = renderer.geometry(T_world_pano)
    return Panorama(id, None, range_m, annotations=Annotations(instance_id, labels, rendered=True))


def changed_floor(config: House.Config) -> FloorMasks:
    """The floor of the building as the queries find it."""
    return buildings(config.style, config.rooms, config.seed, config.changed_fraction)[1].floor_masks()


def _entry(number: int, spec: FrameSpec, rgb: bool) -> FrameEntry:
    """The manifest's entry of a frame. A query is known by its number: its name in the plan holds its place."""
    query = spec.role == "query"
    id = f"query-{number:04d}" if query else spec.id
    return FrameEntry(
        id=id,
        role=spec.role,
        rgb=f"frames/{id}.jpg" if rgb else None,
        range=f"frames/{id}.range.png",
        instances=f"frames/{id}.instances.png",
        pose=None if query else _pose(spec),
        place=None if query else spec.place,
    )


def _pose(spec: FrameSpec) -> tuple[float, ...]:
    return tuple(pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m).ravel().tolist())


def _visible(path: Path) -> tuple[int, ...]:
    pixels = np.bincount(read_ids(path).ravel())
    return tuple(int(i) for i in np.flatnonzero(pixels >= VISIBLE_PIXELS) if i)


def _render_frame(root: Path, config: House.Config, spec: FrameSpec, entry: FrameEntry) -> None:
    lighting = config.lighting if spec.role == "query" and config.lighting != "other" else spec.lighting
    renderer = _renderer(config, spec.role == "query", lighting)
    pose = pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m)
    if config.rgb:
        rendering = renderer.render(pose)
        write_panorama(root, entry, rendering.rgb, rendering.range_m, rendering.instance_id)
    else:
        range_m, instance_id = renderer.geometry(pose)
        write_panorama(root, entry, None, range_m, instance_id)


@cache
def _renderer(config: House.Config, changed: bool, lighting: str) -> Renderer:
    """Renderers of a worker process; the lightings of one building share its geometry and textures."""
    if lighting != "day":
        return _renderer(config, changed, "day").relit(lighting)
    building = buildings(config.style, config.rooms, config.seed, config.changed_fraction)[changed]
    catalogue = Catalogue(config.models, config.models_part) if config.models else None
    return Renderer(building.scene(catalogue), "day", config.height)
