"""Measure the difficulty of generated buildings: `python -m salframe_house.calibrate --seeds 0..9`.

The script localizes the queries from perfect annotations by the Jaccard index of label sets alone. Two parameters of
the generator were chosen so that the accuracy on house-42 is between 0.70 and 0.85: the share of twins (rooms with the
same list of objects), and the number of object classes that rooms have in common.
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
    """Accuracy of localization by label sets on the queries of one seed, and properties of the building.

    Attributes:
        seed: Seed of the building.
        accuracy: Share of queries localized to the right room.
        objects: Minimum, median and maximum number of objects in a room.
        visible: Mean number of objects visible in a reference frame.
        twins: Share of rooms that have the same list of objects as another room.
        shift_m: Mean distance of a query from the nearest reference frame of its room.
        map_frames: Number of reference frames, without transition frames.
        classes: Number of object classes in the building.
    """

    seed: int
    accuracy: float
    objects: tuple[float, float, float]
    visible: float
    twins: float
    shift_m: float
    map_frames: int
    classes: int


class _Viewer:
    """Computes which labels of a building are visible from a frame."""

    def __init__(self, building: Building):
        scene = building.scene()
        self._scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self._scene, scene.vertices_m[scene.triangles])
        self._instance_id, self._labels = scene.instance_id, building.labels

    def labels(self, frame: FrameSpec) -> list[str]:
        """Return one label per visible object."""
        pose = frame.pose
        direction = equirectangular_rays(_HEIGHT).reshape(-1, 3) @ pose[:3, :3].T.astype(np.float32)
        origin = np.repeat(pose[None, :3, 3].astype(np.float32), len(direction), 0)
        triangle = self._scene.run(origin, direction)
        return [self._labels[i] for i in visible_instances(self._instance_id[triangle[triangle >= 0]])]


def measure(style: Style, rooms: int, seed: int, queries_per_room: int = 3, fraction: float = 0.1) -> Difficulty:
    """Generate the building of a seed, change a fraction of its objects, and measure the accuracy by label sets."""
    building = generate_building(style, rooms, seed)
    changed = change_building(building, fraction, seed)
    frames = choose_frames(building, changed, seed, queries_per_room)
    reference = [frame for frame in frames if frame.role != "query"]
    viewer, query_viewer = _Viewer(building), _Viewer(changed)
    frame_labels = [viewer.labels(frame) for frame in reference]
    correct, shifts = [], []
    for query in frames[len(reference) :]:
        labels = set(query_viewer.labels(query))
        score = [len(labels & set(s)) / max(len(labels | set(s)), 1) for s in frame_labels]
        correct.append(reference[int(np.argmax(score))].place == query.place)
        shifts.append(min(np.hypot(f.x_m - query.x_m, f.y_m - query.y_m) for f in reference if f.place == query.place))
    counts = [sum(o.room == room.id for o in building.objects) for room in building.rooms]
    return Difficulty(
        seed,
        float(np.mean(correct)),
        (min(counts), float(np.median(counts)), max(counts)),
        float(np.mean([len(s) for s, f in zip(frame_labels, reference, strict=True) if f.role == "map"])),
        float(np.mean([room.twin is not None for room in building.rooms])),
        float(np.mean(shifts)),
        sum(f.role == "map" for f in reference),
        len({o.label for o in building.objects}),
    )


def main() -> None:
    """Print one row per seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--style", default="office", choices=get_args(Style))
    parser.add_argument("--rooms", type=int, default=42)
    parser.add_argument("--seeds", default="0..9", help="Seeds of the buildings: FIRST..LAST or one number")
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("..")
    print(
        f"{len(CLASSES)} classes\n"
        "seed accuracy objects/room (min median max)    visible  twins  shift/m  reference frames  classes used"
    )
    rows = []
    for seed in range(int(first), int(last or first) + 1):
        rows.append(row := measure(arguments.style, arguments.rooms, seed))
        low, median, high = row.objects
        print(
            f"{seed:4d} {row.accuracy:8.3f} {low:6.0f} {median:.1f} {high:.0f} {row.visible:24.1f} {row.twins:6.2f} "
            f"{row.shift_m:8.3f} {row.map_frames:8d} {row.classes:12d}",
            flush=True,
        )
    accuracy = [row.accuracy for row in rows]
    print(f"accuracy mean {np.mean(accuracy):.3f}, {min(accuracy):.3f} to {max(accuracy):.3f}")


if __name__ == "__main__":
    main()
