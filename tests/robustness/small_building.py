"""A small building in the files that navigation and topologies read: floors of the tiny folder's rooms, and viewpoints
with the objects that they see."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from matterport.conftest import Building

from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder_format import write_floor
from salframe.testing.rooms import ROOMS

RESOLUTION_M = 0.1
CORRIDORS_M = ((4.2, 6.0, 1.2, 2.4), (1.2, 2.4, 3.6, 6.0))
"""Free floor between the bedroom and the kitchen, and between the bedroom and the lounge: min and max x, min and max
y."""
NEIGHBOURS = {"ab", "ba", "ac", "ca"}
"""Viewpoints that an agent can walk between."""


def write_floors(root: Path) -> None:
    """Write masks of the floor that joins the three rooms, and list them in the manifest of a tiny folder."""
    top_m = 11.0
    y_m, x_m = np.meshgrid(
        top_m - (np.arange(120) + 0.5) * RESOLUTION_M, -1.0 + (np.arange(120) + 0.5) * RESOLUTION_M, indexing="ij"
    )
    free, region = np.zeros(x_m.shape, bool), np.zeros(x_m.shape, np.int32)
    boxes = [
        (room.corner_m[0], room.corner_m[0] + room.size_m[0], room.corner_m[1], room.corner_m[1] + room.size_m[1])
        for room in ROOMS
    ]
    for number, (min_x_m, max_x_m, min_y_m, max_y_m) in enumerate((*boxes, *CORRIDORS_M), 1):
        inside = (x_m > min_x_m) & (x_m < max_x_m) & (y_m > min_y_m) & (y_m < max_y_m)
        free |= inside
        region[inside] = number if number <= len(ROOMS) else 1
    regions = {number: room.name for number, room in enumerate(ROOMS, 1)}
    masks = FloorMasks(free, region, np.zeros_like(free), RESOLUTION_M, (-1.0, top_m), regions)
    manifest = json.loads((root / "manifest.json").read_text())
    manifest["floors"] = [write_floor(root, "floor", masks).model_dump(mode="json")]
    (root / "manifest.json").write_text(json.dumps(manifest))


def write_viewpoints(root: Path) -> None:
    """Write three viewpoints in two rooms with a published episode, and an episode of a file."""
    building = Building(
        root,
        viewpoints={"a": (0, 0, 1.5, 90, 0), "b": (1.2, 0.3, 1.6, -35, 0), "c": (0.4, 3.0, 1.5, 10, 1)},
        balls={
            1: ("arm#chair", (0.5, 1.4, 0.6), 0.3),
            2: ("Lamp", (-0.9, 0.4, 2.2), 0.15),
            3: ("table", (0.8, -1.2, 0.5), 0.4),
            4: ("bed", (1.6, 4.0, 0.6), 0.5),
            5: ("plant", (2.4, 1.0, 1.0), 0.2),
        },
        sees={"a": (1, 2, 3), "b": (1, 2, 3, 5), "c": (1, 2, 4)},
    )
    building.write()
    path = root / "connectivity" / "fake_connectivity.json"
    viewpoints = json.loads(path.read_text())
    for viewpoint in viewpoints:
        viewpoint["unobstructed"] = [viewpoint["image_id"] + name in NEIGHBOURS for name in building.viewpoints]
    path.write_text(json.dumps(viewpoints))
    episode = {"path_id": 1, "scan": "fake", "objId": 4, "path": ["b", "a", "c"], "heading": 0.5}
    building.write_json("reverie/REVERIE_val.json", [{**episode, "instructions": ["go"]}])
    episode = {"start": "fake/b", "goal": "fake/c"}
    building.write_json("episodes.json", [{**episode, "yaw_deg": 90.0}, {**episode, "yaw_deg": None}])
