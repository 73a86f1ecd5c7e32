"""Render the sample recording of the tutorials into docs/tutorials/apartment: `python docs/make_sample.py`.

One panorama in each room of `house-6`, two queries, their range images, the poses of the rooms' panoramas, and the
floor plan. The recording is 640 x 320 pixels and has less than 1 MB.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

import salframe
from salframe.panoramas import images
from salframe.panoramas.folder_format import write_floor
from salframe.panoramas.geometry import pose_yaw

SAMPLE = Path(__file__).parent / "tutorials" / "apartment"
DATA = ["data.queries_per_room=1", "data.height=320"]
NUM_QUERIES = 2


def sample_frames(dataset: salframe.Dataset) -> Iterator[salframe.ReferenceFrame | salframe.QueryFrame]:
    """Yield the first reference frame of each room, and the queries."""
    (fold,) = dataset.folds()
    rooms: set[str] = set()
    for frame in fold.references:
        if frame.kind is salframe.FrameKind.SCENE and frame.place not in rooms:
            rooms.add(frame.place)
            yield frame
    yield from fold.queries[:NUM_QUERIES]


def write_sample(folder: Path) -> None:
    """Write the recording."""
    dataset = salframe.find_dataset("house-6", overrides=DATA)
    pictures, rows = folder / "pictures", []
    pictures.mkdir(parents=True, exist_ok=True)
    for frame in sample_frames(dataset):
        panorama, name = frame.load(), frame.id.removeprefix("map-")
        Image.fromarray(panorama.rgb).save(pictures / f"{name}.jpg", quality=85)
        images.write_range(pictures / f"{name}.range.png", panorama.range_m)
        if isinstance(frame, salframe.ReferenceFrame):
            x_m, y_m, z_m = frame.T_world_pano[:3, 3]
            numbers = x_m, y_m, z_m, np.degrees(pose_yaw(frame.T_world_pano))
            rows.append([f"{name}.jpg", frame.place, *(round(float(number), 3) for number in numbers)])
    with (pictures / "poses.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([["picture", "place", "x_m", "y_m", "z_m", "yaw_deg"], *rows])
    (floor,) = dataset.floors()
    entry = write_floor(folder, "floor", floor)
    (folder / "floors.yaml").write_text(json.dumps({"floors": [entry.model_dump(mode="json")]}, indent=1) + "\n")


if __name__ == "__main__":
    write_sample(SAMPLE)
    print(f"{SAMPLE}: {sum(path.stat().st_size for path in SAMPLE.rglob('*.*')) / 1e6:.2f} MB")
