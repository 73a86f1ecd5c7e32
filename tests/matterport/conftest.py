"""A small building in the official formats, drawn with scipy's rotations, and the real buildings where they are at
hand."""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

FOCAL_PX = 415.69
SHARED = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))


def sphere(samples=4000):
    """Unit vectors spread evenly over the sphere (Fibonacci)."""
    k = np.arange(samples) + 0.5
    z, turn = 1 - 2 * k / samples, np.pi * (1 + 5**0.5) * k
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], 1)


SPHERE = sphere()


def ball_boxes(offset_m, radius_m):
    """visible_pos and bbox2d of a ball at offset_m from the viewpoint, as a renderer of the 36 views gives them."""
    views, boxes = [], []
    for view in range(36):
        # From a camera that looks along +y (right +x, down -z): up by the elevation, then clockwise by the heading.
        turn = Rotation.from_euler("z", -30 * (view % 12), degrees=True) * Rotation.from_euler(
            "x", 30 * (view // 12 - 1), degrees=True
        )
        local = turn.inv().apply(offset_m + radius_m * SPHERE)
        ahead = local[local[:, 1] > 0.01]
        column, row = 320 + FOCAL_PX * ahead[:, 0] / ahead[:, 1], 240 - FOCAL_PX * ahead[:, 2] / ahead[:, 1]
        inside = (column >= 0) & (column < 640) & (row >= 0) & (row < 480)
        if inside.any():
            x, y = int(column[inside].min()), int(row[inside].min())
            views.append(view)
            boxes.append([x, y, int(np.ceil(column[inside].max())) - x, int(np.ceil(row[inside].max())) - y])
    return views, boxes


@dataclass
class Building:
    """Writes a building: viewpoints (x, y, z, azimuth in degrees of the camera, region) and balls seen from them."""

    root: Path
    scan: str = "fake"
    viewpoints: dict = field(default_factory=dict)
    balls: dict = field(default_factory=dict)  # object id -> (label, position, radius)
    sees: dict = field(default_factory=dict)  # viewpoint -> object ids

    def write(self):
        connectivity, regions = [], {}
        for name, (x, y, z, azimuth_deg, region) in self.viewpoints.items():
            turn = np.radians(azimuth_deg)
            forward, right = np.array([np.cos(turn), np.sin(turn), 0]), np.array([np.sin(turn), -np.cos(turn), 0])
            pose = np.eye(4)
            pose[:3, :3] = np.stack([right, [0, 0, -1], forward], 1)
            pose[:3, 3] = x, y, z
            connectivity.append(
                {"image_id": name, "pose": pose.ravel().tolist(), "included": name != "hidden", "height": 1.5}
            )
            regions[name] = {"region_index": str(region), "label": "b"}
            objects = {}
            for number in self.sees.get(name, self.balls):
                label, position, radius = self.balls[number]
                views, boxes = ball_boxes(np.subtract(position, (x, y, z)), radius)
                objects[str(number)] = {"name": label, "visible_pos": views, "bbox2d": boxes}
            objects["999"] = {"name": "out#of#sight", "visible_pos": [], "bbox2d": []}
            self.write_json(f"reverie/BBox/{self.scan}_{name}.json", {name: objects})
        self.write_json(f"connectivity/{self.scan}_connectivity.json", connectivity)
        self.write_json("vp2room_label.json", {"label_info": {}, "pano_info": {self.scan: regions}})

    def write_json(self, path, content):
        path = self.root / path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content))


@pytest.fixture
def building(tmp_path):
    """Two rooms: a and b in region 0, c alone in region 1; "hidden" is not included. b alone sees object 5."""
    fake = Building(
        tmp_path,
        viewpoints={
            "a": (0, 0, 1.5, 90, 0),
            "b": (1.2, 0.3, 1.6, -35, 0),
            "c": (0.4, 3.0, 1.5, 10, 1),
            "hidden": (9, 9, 1.5, 0, 1),
        },
        balls={
            1: ("arm#chair", (0.5, 1.4, 0.6), 0.3),
            2: ("Lamp", (-0.9, 0.4, 2.2), 0.15),
            3: ("table", (0.8, -1.2, 0.5), 0.4),
            4: ("bed", (1.6, 4.0, 0.6), 0.5),
            5: ("plant", (2.4, 1.0, 1.0), 0.2),
        },
        sees={"a": (1, 2, 3), "b": (1, 2, 3, 5), "c": (1, 2, 4)},
    )
    fake.write()
    return fake


@pytest.fixture(scope="session")
def real_root():
    root = SHARED / "matterport3d"
    if not root.is_dir():
        pytest.skip(f"no real buildings at {root} (set SALFRAME_SHARED_DATA)")
    return root
