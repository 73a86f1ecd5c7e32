"""A service on a map of three rendered rooms and a hall between them."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import httpx
import numpy as np

from salframe.framework.components.registry import registry
from salframe.framework.validation import validate
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import write_map
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import ReferenceFrame
from salframe.serving.access import AccessRules
from salframe.serving.limits import ServiceLimits
from salframe.serving.run import listen, make_server
from salframe.serving.served_map import MapHolder
from salframe.testing.rooms import ROOMS, FurnishedRoom, box_detections, map_frames, query_frames, query_truths
from salframe.topology.build import build_topology
from salframe.topology.building_map import BuildingMap

PLUGINS = "served_plugin,salframe_graphs,salframe_planners,salframe_annotations,salframe_trackers,salframe.configs"
RESOLUTION_M = 0.05
HALL = ((0.0, 4.0), (9.4, 5.6))
DOORS = (((3.0, 3.6), (3.9, 4.0)), ((7.5, 3.0), (8.4, 4.0)), ((2.0, 5.6), (2.9, 6.0)))
TRUTHS = {room.name: query_truths()[f"{room.name}-query"] for room in ROOMS}
"""Place and pose of the query in each room."""
QUERIES = {room.name: frame for room, frame in zip(ROOMS, query_frames(), strict=True)}


def floor() -> FloorMasks:
    """The rooms as boxes, and a hall that doors connect with each of them."""
    origin = np.array([-0.5, 10.5])
    region = np.zeros((220, 220), np.int32)
    free = np.zeros(region.shape, bool)

    def area(low, high):
        (left, bottom), (right, top) = (
            np.round(np.array([1, -1]) * (np.array(point) - origin) / RESOLUTION_M).astype(int) for point in (low, high)
        )
        return slice(top, bottom), slice(left, right)

    for number, room in enumerate(ROOMS, 1):
        corner = np.array(room.corner_m)
        region[area(corner, corner + room.size_m[:2])] = number
    region[area(*HALL)] = 4
    free[region > 0] = True
    for door in DOORS:
        free[area(*door)] = True
    places = {**{number: room.name for number, room in enumerate(ROOMS, 1)}, 4: "hall"}
    return FloorMasks(free, region, np.zeros_like(free), RESOLUTION_M, tuple(origin.tolist()), places)


def build(folder: Path, *, topology: bool = True, names: dict[str, str] | None = None) -> Path:
    """Build the map of the rooms. `names` replaces names of places."""
    frames = [
        ReferenceFrame(frame.id, (names or {}).get(frame.place, frame.place), frame.T_world_pano, load=frame.load)
        for frame in map_frames()
    ]
    role = registry().get(Localizer.role, "saliency-places")
    config = validate(role.Config, {"kind": "saliency-places", "detector": {"kind": "painted"}}, "test")
    localization = LocalizationMap.build(role(config), frames)
    with write_map(folder) as parts:
        BuildingMap(localization, build_topology([floor()], frames) if topology else None).write(parts)
    return folder


def png(image: np.ndarray) -> bytes:
    """An image as PNG; colours are RGB."""
    return cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)[1].tobytes()


def upload(room: str) -> dict[str, tuple[str, io.BytesIO, str]]:
    """The files of the query in a room."""
    panorama = QUERIES[room].load()
    steps = np.round(panorama.range_m * 1000).astype(np.uint16)
    return {
        "image": ("a.png", io.BytesIO(png(panorama.rgb)), "image/png"),
        "range": ("b.png", io.BytesIO(png(steps)), "image/png"),
    }


def detections(room: FurnishedRoom) -> list[dict[str, object]]:
    """The furniture of a room from its middle, as JSON: the pose of the query is that of the reference frame."""
    boxes = box_detections(room)
    return [
        {"label": label, "centroid_m": centre, "size_m": size, "yaw_deg": float(np.degrees(yaw))}
        for label, centre, size, yaw in zip(
            boxes.labels, boxes.centroid_m.tolist(), boxes.size_m.tolist(), boxes.yaw_rad, strict=True
        )
    ]


@dataclass
class Running:
    """A service in a thread of this process."""

    url: str
    port: int
    maps: MapHolder
    client: httpx.Client


@contextmanager
def serving(folder: Path, *, rules: AccessRules | None = None, **limits: object) -> Iterator[Running]:
    """A service on a map."""
    maps = MapHolder(folder)
    with listen("127.0.0.1", 0) as listener:
        port = listener.getsockname()[1]
        chosen = rules or AccessRules.of_address("127.0.0.1", None, ())
        server = make_server(maps, ServiceLimits(workers=2, **limits), chosen)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.01)
        url = f"http://127.0.0.1:{port}"
        with httpx.Client(base_url=url, timeout=60) as client:
            yield Running(url, port, maps, client)
        server.should_exit = True
        thread.join(60)
        assert not thread.is_alive()
