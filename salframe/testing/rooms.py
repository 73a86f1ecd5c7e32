"""Panoramas of furnished rooms made of boxes, rendered exactly: the input of the conformance suite."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Set
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from salframe.graphs.boxes import detections_from_points
from salframe.graphs.detections import Detections
from salframe.graphs.graph import GraphConfig, SaliencyGraph, build_graph
from salframe.panoramas.frames import QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import equirectangular_rays, invert_pose, pose_2d, transform_points
from salframe.panoramas.panorama import PARTS, Annotations, Panorama
from salframe.testing.expectations import lock

EYE_M = 1.5
"""Height of the camera above the floor."""
HEIGHT_PX = 192
"""Height of the suite's panoramas. The width is twice the height."""


@dataclass(frozen=True)
class Box:
    """A piece of furniture: its label, and its centre and size along the room's axes, in metres."""

    label: str
    centre_m: tuple[float, float, float]
    size_m: tuple[float, float, float]


@dataclass(frozen=True)
class FurnishedRoom:
    """A room with furniture, from (0, 0, 0) to size_m. corner_m is the position of its corner (0, 0) in the world."""

    name: str
    size_m: tuple[float, float, float]
    boxes: tuple[Box, ...]
    corner_m: tuple[float, float] = (0.0, 0.0)

    def emptied(self) -> FurnishedRoom:
        """Return the room without furniture."""
        return replace(self, boxes=())


RANDOM_LABELS = (
    *("bed", "chair", "desk", "lamp", "plant", "shelf", "sofa", "stool"),
    *("table", "television", "cabinet", "wardrobe", "mirror", "sink"),
)
"""Labels of the furniture of random rooms."""

ROOMS = (
    FurnishedRoom(
        "bedroom",
        (4.2, 3.6, 2.6),
        (
            Box("bed", (1.1, 0.8, 0.3), (2.0, 1.4, 0.6)),
            Box("nightstand", (0.3, 1.8, 0.25), (0.4, 0.4, 0.5)),
            Box("lamp", (0.3, 1.8, 0.7), (0.2, 0.2, 0.4)),
            Box("wardrobe", (3.8, 0.7, 1.0), (0.6, 1.2, 2.0)),
            Box("desk", (3.2, 3.2, 0.4), (1.4, 0.6, 0.8)),
            Box("chair", (3.1, 2.6, 0.45), (0.45, 0.5, 0.9)),
            Box("picture", (1.2, 3.58, 1.6), (0.8, 0.04, 0.6)),
        ),
    ),
    FurnishedRoom(
        "kitchen",
        (3.4, 3.0, 2.6),
        (
            Box("counter", (1.4, 0.3, 0.45), (2.4, 0.6, 0.9)),
            Box("refrigerator", (3.05, 0.4, 0.9), (0.6, 0.7, 1.8)),
            Box("microwave", (0.6, 0.3, 1.05), (0.5, 0.4, 0.3)),
            Box("table", (1.0, 2.4, 0.38), (1.2, 0.8, 0.76)),
            Box("chair", (2.2, 2.5, 0.45), (0.45, 0.45, 0.9)),
            Box("clock", (3.38, 2.0, 1.9), (0.04, 0.35, 0.35)),
        ),
        (6.0, 0.0),
    ),
    FurnishedRoom(
        "lounge",
        (5.0, 4.0, 2.6),
        (
            Box("sofa", (1.2, 0.5, 0.4), (2.0, 0.9, 0.8)),
            Box("armchair", (0.5, 2.2, 0.4), (0.8, 0.8, 0.8)),
            Box("tv", (2.4, 3.93, 1.1), (1.2, 0.1, 0.7)),
            Box("bookshelf", (4.8, 1.4, 1.0), (0.35, 1.6, 2.0)),
            Box("plant", (4.6, 3.6, 0.6), (0.5, 0.5, 1.2)),
            Box("table", (1.3, 1.5, 0.22), (0.9, 0.6, 0.44)),
        ),
        (0.0, 6.0),
    ),
)


def stand(room: FurnishedRoom, x_share: float = 0.5, y_share: float = 0.5, yaw_rad: float = 0.3) -> np.ndarray:
    """Return T_world_pano (4, 4) of a camera at eye height, at a fraction of the room's size along x and y."""
    return pose_2d(
        room.corner_m[0] + x_share * room.size_m[0], room.corner_m[1] + y_share * room.size_m[1], yaw_rad, EYE_M
    )


def look(room: FurnishedRoom, id: str, T_world_pano: np.ndarray, parts: Set[str] = PARTS) -> Panorama:
    """Render a panorama of a room.

    Args:
        room: The room.
        id: Id of the panorama.
        T_world_pano: (4, 4) pose of the camera, upright, inside the room and outside its boxes.
        parts: Parts of the panorama: "range" is the distance to the surface along each ray, "annotations" the box that
            each ray hits, and "rgb" a random texture of each surface.
    """
    room_from_pano = pose_2d(-room.corner_m[0], -room.corner_m[1], 0) @ T_world_pano
    eye = room_from_pano[:3, 3]
    rays = equirectangular_rays(HEIGHT_PX).astype(np.float64) @ room_from_pano[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = (np.where(rays > 0, np.array(room.size_m) - eye, -eye) / rays).min(-1)
        instance_id = np.zeros(range_m.shape, np.int32)
        for number, box in enumerate(room.boxes, 1):
            to_sides = (np.array(box.centre_m) - eye + np.multiply.outer((-0.5, 0.5), box.size_m))[:, None, None] / rays
            enters, leaves = to_sides.min(0).max(-1), to_sides.max(0).min(-1)
            hit = (enters < leaves) & (enters > 0) & (enters < range_m)
            range_m[hit], instance_id[hit] = enters[hit], number
    labels = {number: box.label for number, box in enumerate(room.boxes, 1)}
    return Panorama(
        id,
        rgb=_paint(room, eye + rays * range_m[..., None], instance_id) if "rgb" in parts else None,
        range_m=range_m.astype(np.float32) if "range" in parts else None,
        annotations=Annotations(instance_id, labels) if "annotations" in parts else None,
    )


def _loader(room: FurnishedRoom, id: str, T_world_pano: np.ndarray, parts: Set[str]) -> Callable[[], Panorama]:
    """Return a function that returns the panorama that `look` renders, with read-only arrays. Each process renders it
    once."""
    return partial(_load, room, id, tuple(T_world_pano.ravel().tolist()), frozenset(parts))


def _load(room: FurnishedRoom, id: str, pose: tuple[float, ...], parts: frozenset[str]) -> Panorama:
    return _rendered(HEIGHT_PX, room, id, pose, parts)


@lru_cache(maxsize=64)
def _rendered(height_px: int, room: FurnishedRoom, id: str, pose: tuple[float, ...], parts: frozenset[str]) -> Panorama:
    """Return the panorama of `look`, from a cache. Tests change HEIGHT_PX, so it is part of the cache key."""
    panorama = look(room, id, np.reshape(pose, (4, 4)), parts)
    lock(panorama)
    return panorama


def _paint(room: FurnishedRoom, points_m: np.ndarray, instance_id: np.ndarray) -> np.ndarray:
    """Return a (H, 2H, 3) uint8 texture: one colour per surface, in patches of 8 cm with random lightness."""
    seeds = [zlib.crc32(name.encode()) for name in (room.name, *(f"{room.name} {box.label}" for box in room.boxes))]
    colour = np.array([np.random.default_rng(seed).uniform(60, 230, 3) for seed in seeds])
    lightness = np.random.default_rng(seeds[0]).uniform(0.4, 1.1, 4096)
    patch = np.floor(points_m / 0.08 + 1e-6).astype(np.int64) @ np.array([1, 71, 1009]) + 211 * instance_id
    return np.clip(colour[instance_id] * lightness[patch % 4096][..., None], 0, 255).astype(np.uint8)


def blank_panorama(parts: Set[str]) -> Panorama:
    """Return a blank panorama that has only these parts.

    Its colour is black, its range is unknown at each pixel, and its annotations contain no objects.

    Args:
        parts: Names of the parts: some of `rgb`, `range` and `annotations`.
    """
    shape = (HEIGHT_PX, 2 * HEIGHT_PX)
    return Panorama(
        "blank",
        rgb=np.zeros((*shape, 3), np.uint8) if "rgb" in parts else None,
        range_m=np.full(shape, np.nan, np.float32) if "range" in parts else None,
        annotations=Annotations(np.zeros(shape, np.int32), {}) if "annotations" in parts else None,
    )


def halved(panorama: Panorama) -> Panorama:
    """Return the panorama with the left half of the image invalid."""

    def hide(image: np.ndarray) -> np.ndarray:
        masked = image.copy()
        masked[:, :HEIGHT_PX] = np.nan if image.dtype.kind == "f" else 0
        return masked

    valid = np.broadcast_to(np.arange(2 * HEIGHT_PX) >= HEIGHT_PX, (HEIGHT_PX, 2 * HEIGHT_PX))
    return replace(_changed(panorama, hide), valid=valid)


def _changed(panorama: Panorama, change: Callable[[np.ndarray], np.ndarray]) -> Panorama:
    """Return the panorama with a function applied to each of its images."""
    annotations = panorama.annotations
    if annotations is not None and annotations.instance_id is not None:
        annotations = replace(annotations, instance_id=change(annotations.instance_id))
    rgb, range_m = (None if image is None else change(image) for image in (panorama.rgb, panorama.range_m))
    return replace(panorama, rgb=rgb, range_m=range_m, annotations=annotations)


def map_frames(parts: Set[str] = PARTS) -> list[ReferenceFrame]:
    """Return a reference frame in the middle of each room."""
    return [
        ReferenceFrame(f"{room.name}-map", room.name, pose, load=_loader(room, f"{room.name}-map", pose, parts))
        for room, pose in ((room, stand(room)) for room in ROOMS)
    ]


def query_frames(parts: Set[str] = PARTS) -> list[QueryFrame]:
    """Return a query in each room, near the reference frame and with another heading."""
    return [QueryFrame(id, _loader(room, id, pose, parts)) for id, room, pose in _queries()]


def query_truths() -> dict[str, Truth]:
    """Return place and pose of each of `query_frames`, by id."""
    return {id: Truth(room.name, pose) for id, room, pose in _queries()}


def _queries() -> list[tuple[str, FurnishedRoom, np.ndarray]]:
    return [(f"{room.name}-query", room, stand(room, 0.55, 0.45, 2.0 + i)) for i, room in enumerate(ROOMS)]


def box_detections(room: FurnishedRoom) -> Detections:
    """Return the furniture as a perfect detector in the middle of the room would detect it.

    The points of an object are the eight corners of its box.
    """
    T_pano_world = invert_pose(stand(room))
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    corners = [np.array(box.centre_m) + signs * box.size_m + (*room.corner_m, 0) for box in room.boxes]
    points = [transform_points(T_pano_world, corner).astype(np.float32) for corner in corners]
    return detections_from_points([box.label for box in room.boxes], np.ones(len(points)), points)


def room_graph(room: FurnishedRoom) -> SaliencyGraph:
    """Return the saliency graph of a room. The saliency of an object is its share of the volume of all boxes."""
    detections = box_detections(room)
    volume = detections.size_m.prod(1)
    return build_graph(detections, volume / volume.sum() if len(volume) else volume, GraphConfig())  # type: ignore[call-arg]  # pydantic's defaults


def random_rooms(seed: int, count: int = 3) -> tuple[FurnishedRoom, ...]:
    """Return rooms of random size side by side, each with five to eight boxes along its walls, depending on a seed."""
    rng = np.random.default_rng(seed)
    rooms, left_m = [], 0.0
    for number in range(count):
        size = rng.uniform([4.5, 4.0, 2.4], [7.0, 6.0, 3.2])
        boxes = []
        for label in rng.choice(RANDOM_LABELS, size=int(rng.integers(5, 9)), replace=False):
            box = rng.uniform([0.4, 0.3, 0.4], [1.0, 0.8, 1.8])
            side, along = int(rng.integers(4)), rng.uniform(0.15, 0.85)
            centre = np.array([along * size[0], box[1] / 2 + 0.02, box[2] / 2])
            if side % 2:
                centre = np.array([box[0] / 2 + 0.02, along * size[1], box[2] / 2])
            if side >= 2:
                centre[:2] = size[:2] - centre[:2]
            boxes.append(Box(str(label), tuple(centre.tolist()), tuple(box.tolist())))
        rooms.append(
            FurnishedRoom(f"room-{number}", tuple(size.tolist()), tuple(boxes), (left_m, float(rng.uniform(-2, 2))))
        )
        left_m += float(size[0]) + 1.0
    return tuple(rooms)


def random_frames(seed: int) -> tuple[list[ReferenceFrame], list[QueryFrame]]:
    """Return two reference frames and a query in each of `random_rooms`, with random headings that depend on a seed."""
    rng = np.random.default_rng((seed, 1))
    references, queries = [], []
    for room in random_rooms(seed):
        for number, (x_share, y_share) in enumerate(((0.42, 0.5), (0.58, 0.46))):
            name, pose = f"{room.name}-{number}", stand(room, x_share, y_share, float(rng.uniform(-np.pi, np.pi)))
            references.append(ReferenceFrame(name, room.name, pose, load=_loader(room, name, pose, PARTS)))
        name, pose = f"{room.name}-query", stand(room, 0.5, 0.54, float(rng.uniform(-np.pi, np.pi)))
        queries.append(QueryFrame(name, _loader(room, name, pose, PARTS)))
    return references, queries
