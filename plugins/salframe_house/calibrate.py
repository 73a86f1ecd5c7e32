"""How hard a generated building is: `python -m salframe_house.calibrate --seeds 0..9`.

Localizes the queries with perfect annotations by the Jaccard index of label sets alone, which is what the share of
twins and the overlap of the rooms' furniture are set by: on house-42 between 0.70 and 0.85.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import get_args

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import visible_instances
from salframe.panoramas.rendered import FrameSpec
from salframe_house.building import Building, Style, change_building, generate_building
from salframe_house.frames import choose_frames
from salframe_house.furniture import CLASSES

_HEIGHT = 512


@dataclass(frozen=True)
class Difficulty:
    """Accuracy of label sets by the seed's queries, and what the building is like."""

    seed: int
    accuracy: float
    objects: tuple[float, float, float]  # in a room: least, median, most
    visible: float  # objects in a reference frame, mean
    twins: float  # share of rooms
    shift_m: float
    map_frames: int
    classes: int


class _Viewer:
    """Which labels of a building are visible from where."""

    def __init__(self, building: Building):
        scene = building.scene()
        self._scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self._scene, scene.vertices_m[scene.triangles])
        self._instance_id, self._labels = scene.instance_id, building.labels

    def labels(self, frame: FrameSpec) -> list[str]:
        """A label for each visible object."""
        pose = frame.pose
        direction = equirectangular_rays(_HEIGHT).reshape(-1, 3) @ pose[:3, :3].T.astype(np.float32)
        origin = np.repeat(pose[None, :3, 3].astype(np.float32), len(direction), 0)
        triangle = self._scene.run(origin, direction)
        return [self._labels[i] for i in visible_instances(self._instance_id[triangle[triangle >= 0]])]


def measure(style: Style, rooms: int, seed: int, queries_per_room: int = 3, fraction: float = 0.1) -> Difficulty:
    """Generate, change and look at the building with this seed."""
    building = generate_building(style, rooms, seed)
    changed = change_building(building, fraction, seed)
    frames = choose_frames(building, changed, seed, queries_per_room)
    mapping = [frame for frame in frames if frame.role != "query"]
    viewer, later = _Viewer(building), _Viewer(changed)
    seen = [viewer.labels(frame) for frame in mapping]
    correct, shifts = [], []
    for query in frames[len(mapping) :]:
        labels = set(later.labels(query))
        score = [len(labels & set(s)) / max(len(labels | set(s)), 1) for s in seen]
        correct.append(mapping[int(np.argmax(score))].place == query.place)
        shifts.append(min(np.hypot(f.x_m - query.x_m, f.y_m - query.y_m) for f in mapping if f.place == query.place))
    held = [sum(o.room == room.id for o in building.objects) for room in building.rooms]
    return Difficulty(
        seed,
        float(np.mean(correct)),
        (min(held), float(np.median(held)), max(held)),
        float(np.mean([len(s) for s, f in zip(seen, mapping, strict=True) if f.role == "map"])),
        float(np.mean([room.twin is not None for room in building.rooms])),
        float(np.mean(shifts)),
        sum(f.role == "map" for f in mapping),
        len({o.label for o in building.objects}),
    )


def main() -> None:
    """Print a row a seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--style", default="office", choices=get_args(Style))
    parser.add_argument("--rooms", type=int, default=42)
    parser.add_argument("--seeds", default="0..9", help="first..last")
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("..")
    print(
        f"{len(CLASSES)} classes\n"
        "seed accuracy objects/room (least median most)  visible  twins  shift/m  reference frames  classes used"
    )
    rows = []
    for seed in range(int(first), int(last or first) + 1):
        rows.append(row := measure(arguments.style, arguments.rooms, seed))
        least, median, most = row.objects
        print(
            f"{seed:4d} {row.accuracy:8.3f} {least:6.0f} {median:.1f} {most:.0f} {row.visible:24.1f} {row.twins:6.2f} "
            f"{row.shift_m:8.3f} {row.map_frames:8d} {row.classes:12d}",
            flush=True,
        )
    accuracy = [row.accuracy for row in rows]
    print(f"accuracy mean {np.mean(accuracy):.3f}, {min(accuracy):.3f} to {max(accuracy):.3f}")


if __name__ == "__main__":
    main()
