"""A folder with the tiny folder's rooms as map, and a sequence through the bedroom and the kitchen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from tiny_folder import write_tiny_folder

from salframe.panoramas.folder_format import FrameEntry, write_panorama
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.testing.rooms import ROOMS, look, stand

SHARES = ((0.45, 0.45), (0.55, 0.5), (0.6, 0.6))
"""Positions of the camera in each room, as fractions of the room's size."""


def poses() -> list[np.ndarray]:
    """The true poses of the camera: three in the bedroom, then three in the kitchen."""
    return [stand(room, *share, yaw_rad=0.4 * i) for room in ROOMS[:2] for i, share in enumerate(SHARES)]


def write_tracked_folder(root: Path, *, dropped: int | None = None, broken: int | None = None) -> Path:
    """Write the folder. Odometry has another origin than the map; there is none around the view `dropped`, and the
    images of the view `broken` are missing."""
    write_tiny_folder(root)
    manifest = json.loads((root / "manifest.json").read_text())
    labels = sorted({box.label for room in ROOMS for box in room.boxes})
    T_odom_world = pose_2d(5.0, -2.0, 1.0)
    rows = ["t_s,x_m,y_m,z_m,yaw_deg"]
    for number, pose in enumerate(poses()):
        panorama = look(ROOMS[number // len(SHARES)], f"step-{number}", pose)
        files = {part: f"frames/step-{number}.{part}.png" for part in ("rgb", "range", "instances")}
        t_s = 10.0 + 3 * number
        entry = FrameEntry(id=f"step-{number}", role="query", sequence="walk", t_s=t_s, **files)
        instance_id = np.zeros_like(panorama.annotations.instance_id)
        for key, label in panorama.annotations.labels.items():
            instance_id[panorama.annotations.instance_id == key] = labels.index(label) + 1
        if number != broken:
            write_panorama(root, entry, panorama.rgb, panorama.range_m, instance_id)
        manifest["frames"].append(entry.model_dump(mode="json", exclude_none=True))
        x, y, z = (T_odom_world @ pose)[:3, 3]
        if number != dropped:
            rows.append(f"{t_s},{x},{y},{z},{np.degrees(pose_yaw(T_odom_world @ pose))}")
    manifest["odometry"] = "odometry.csv"
    (root / "odometry.csv").write_text("\n".join(rows) + "\n")
    (root / "manifest.json").write_text(json.dumps(manifest))
    return root
