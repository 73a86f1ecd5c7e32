"""Measure which errors of poses and ranges the checks of a dataset detect, and which correct data they report.

    python tests/benchmarks/pose_checks.py [--seeds N] [--json FILE]

The errors are applied to the reference frames of `house-6`, seeds 1 to N, without floor masks. Printed are, for each
error, the median displacement that it causes between the poses of the frames and the true ones, and the number of
folders in which `data_notes` reported it. Correct data are `house-6`, `house-12`, `house-42` and `house-106`, seeds 1
to 5, with floor masks, tilted cameras, cameras at other heights, survey coordinates, noisy ranges and poses, and one
frame a place. Only compared frames are rendered.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError
from salframe.panoramas.data_checks import data_notes
from salframe.panoramas.dataset import Fold
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import (
    equirectangular_rays,
    invert_pose,
    pose_2d,
    pose_errors,
    pose_yaw,
    sample_nearest,
)
from salframe.panoramas.opening import configure_dataset
from salframe.panoramas.panorama import Panorama
from salframe.testing.rooms import ROOMS, look

Frames = Sequence[ReferenceFrame]
Change = Callable[[np.ndarray, np.random.Generator], np.ndarray]


class Described:
    """What `data_notes` reads of a dataset: frames and floors."""

    def __init__(self, frames: Frames, floors: Sequence[FloorMasks]) -> None:
        self._frames, self._floors = frames, floors

    def folds(self) -> list[Fold]:
        return [Fold("all", tuple(self._frames), ())]

    def floors(self) -> list[FloorMasks]:
        return list(self._floors)


def house_frames(preset: str, seed: int) -> tuple[list[ReferenceFrame], list[FloorMasks]]:
    """Return the reference frames of a generated building, rendered when they are loaded, and its floors."""
    _, config = configure_dataset(preset, None, [{"seed": seed, "queries_per_room": 0, "rgb": False}])
    house = registry().build("dataset", config)

    @lru_cache(maxsize=32)
    def render(index: int) -> Panorama:
        return house.render(frames[index])

    frames = [frame for frame in house.list_frames() if not frame.is_query]
    kinds = {"map": FrameKind.SCENE, "transition": FrameKind.TRANSITION}
    references = [
        ReferenceFrame(frame.id, frame.place, frame.pose, kinds[frame.role], partial(render, index))
        for index, frame in enumerate(frames)
    ]
    return references, list(house.list_floors().values())


def notes_of(frames: Frames, floors: Sequence[FloorMasks] = ()) -> list[str]:
    """Return the warnings about frames: units, missing readings, storeys, regions and poses."""
    try:
        return data_notes(Described(frames, floors))
    except DataError as error:
        return [str(error)]


def turn(pose: np.ndarray, axis: Sequence[float], angle_deg: float) -> np.ndarray:
    turned = pose.copy()
    turned[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(np.radians(angle_deg) * np.array(axis)).as_matrix()
    return turned


def scaled(pose: np.ndarray, factor: float) -> np.ndarray:
    changed = pose.copy()
    changed[:3, 3] *= factor
    return changed


def level_pose(pose: np.ndarray, x: float, y: float, yaw: float) -> np.ndarray:
    return pose_2d(x, y, yaw, pose[2, 3])


CONVENTIONS: dict[str, Change] = {
    "world to camera": lambda pose, rng: invert_pose(pose),
    "compass heading": lambda pose, rng: level_pose(pose, *pose[:2, 3], np.pi / 2 - pose_yaw(pose)),
    "clockwise heading": lambda pose, rng: level_pose(pose, *pose[:2, 3], -pose_yaw(pose)),
    "plan mirrored": lambda pose, rng: level_pose(pose, pose[0, 3], -pose[1, 3], -pose_yaw(pose)),
    "positions mirrored": lambda pose, rng: level_pose(pose, pose[0, 3], -pose[1, 3], pose_yaw(pose)),
    "x and y exchanged": lambda pose, rng: level_pose(pose, pose[1, 3], pose[0, 3], pose_yaw(pose)),
}
ANGLES = (5, 10, 15, 20, 30, 45, 60, 90, 120, 150, 180)
POSE_SCALES = (0.5, 0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0, 3.28, 10.0, 100.0, 1000.0)
RANGE_SCALES = (0.2, 0.25, 0.3048, 0.5, 0.7, 0.8, 0.9, 1.1, 1.25, 1.5, 2.0, 3.28, 4.0, 5.0)


def pose_changes() -> Iterator[tuple[str, Change]]:
    yield from CONVENTIONS.items()
    for angle in ANGLES:
        yield f"all headings turned by {angle} deg", lambda pose, rng, a=angle: turn(pose, (0, 0, 1), a)
        yield (
            f"each heading turned by {angle} deg to a random side",
            lambda pose, rng, a=angle: turn(pose, (0, 0, 1), a * rng.choice([-1, 1])),
        )
        yield (
            f"each pose rotated by {angle} deg about a random axis",
            lambda pose, rng, a=angle: turn(pose, unit(rng), a),
        )
    for scale in POSE_SCALES:
        yield f"positions times {scale:g}", lambda pose, rng, s=scale: scaled(pose, s)


def unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def with_ranges(frames: Frames, change: Callable[[np.ndarray], np.ndarray]) -> list[ReferenceFrame]:
    """Return the frames with changed range images."""

    def load(frame: ReferenceFrame) -> Panorama:
        panorama = frame.load()
        return replace(panorama, range_m=change(panorama.range_m).astype(np.float32))

    return [replace(frame, load=partial(load, frame)) for frame in frames]


def displacement(frames: Frames, poses: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the median distance in metres and rotation in degrees between wrong and true poses."""
    errors = [pose_errors(pose, frame.T_world_pano) for frame, pose in zip(frames, poses, strict=True)]
    metres, radians = np.median(errors, axis=0)
    return float(metres), float(np.degrees(radians))


def detection_curves(seeds: Sequence[int]) -> list[dict]:
    rows: dict[str, list[tuple[float, float, bool]]] = {}
    for seed in seeds:
        frames, _ = house_frames("house-6", seed)
        for name, change in pose_changes():
            rng = np.random.default_rng(seed)
            poses = [change(frame.T_world_pano, rng) for frame in frames]
            wrong = [replace(frame, T_world_pano=pose) for frame, pose in zip(frames, poses, strict=True)]
            rows.setdefault(name, []).append((*displacement(frames, poses), bool(notes_of(wrong))))
        for scale in RANGE_SCALES:
            wrong = with_ranges(frames, lambda range_m, s=scale: range_m * s)
            rows.setdefault(f"ranges times {scale:g}", []).append((0.0, 0.0, bool(notes_of(wrong))))
        cube = with_ranges(frames, lambda range_m: range_m * np.abs(equirectangular_rays(len(range_m))).max(-1))
        rows.setdefault("z-depth of cube faces", []).append((0.0, 0.0, bool(notes_of(cube))))
        upside = with_ranges(frames, lambda range_m: range_m[::-1, ::-1])
        rows.setdefault("images upside down", []).append((0.0, 0.0, bool(notes_of(upside))))
        print(f"house-6 seed {seed}", file=sys.stderr)
    return [
        {
            "error": name,
            "median_m": float(np.median([row[0] for row in found])),
            "median_deg": float(np.median([row[1] for row in found])),
            "reported": sum(row[2] for row in found),
            "folders": len(found),
        }
        for name, found in rows.items()
    ]


def tilted(frames: Frames, angle_deg: float, declared: bool) -> list[ReferenceFrame]:
    """Return frames whose cameras are tilted about random horizontal axes, with or without poses that say so."""
    changed = []
    for number, frame in enumerate(frames):
        angle = np.random.default_rng(number).uniform(-np.pi, np.pi)
        rotation = Rotation.from_rotvec(np.radians(angle_deg) * np.array([np.cos(angle), np.sin(angle), 0])).as_matrix()

        def load(frame=frame, rotation=rotation) -> Panorama:
            panorama = frame.load()
            rays = equirectangular_rays(len(panorama.range_m)) @ rotation.T
            return Panorama(panorama.id, range_m=sample_nearest(panorama.range_m, rays))

        pose = frame.T_world_pano.copy()
        pose[:3, :3] = pose[:3, :3] @ rotation
        changed.append(replace(frame, T_world_pano=pose if declared else frame.T_world_pano, load=load))
    return changed


def noisy(frames: Frames, seed: int) -> list[ReferenceFrame]:
    """Return frames with ranges of 3 % noise, 2 % bias and 10 % holes, positions 5 cm and headings 1 deg off."""
    rng = np.random.default_rng(seed)

    def blur(range_m: np.ndarray) -> np.ndarray:
        noise = np.random.default_rng(seed)
        changed = range_m * (1.02 + 0.03 * noise.standard_normal(range_m.shape))
        return np.where(noise.random(range_m.shape) < 0.1, np.nan, changed)

    poses = [frame.T_world_pano @ pose_2d(*rng.normal(0, 0.05, 2), rng.normal(0, np.radians(1))) for frame in frames]
    return with_ranges([replace(f, T_world_pano=pose) for f, pose in zip(frames, poses, strict=True)], blur)


def rooms_at(height_m: float) -> list[ReferenceFrame]:
    """Return two frames in each drawn room, at a camera height."""
    poses = [
        (
            room,
            name,
            pose_2d(room.corner_m[0] + x * room.size_m[0], room.corner_m[1] + y * room.size_m[1], yaw, height_m),
        )
        for room in ROOMS
        for name, x, y, yaw in (("a", 0.5, 0.5, 0.3), ("b", 0.35, 0.45, 2.0))
    ]
    return [
        ReferenceFrame(f"{room.name}-{name}", room.name, pose, load=partial(look, room, name, pose))
        for room, name, pose in poses
    ]


def correct_data(seeds: Sequence[int]) -> Iterator[tuple[str, Frames, Sequence[FloorMasks]]]:
    for preset in ("house-6", "house-12", "house-42", "house-106"):
        for seed in seeds:
            frames, floors = house_frames(preset, seed)
            yield f"{preset} seed {seed}", frames, floors
            if preset not in ("house-6", "house-12"):
                continue
            for angle in (2, 5):
                yield f"{preset} seed {seed}, tilted by {angle} deg with poses", tilted(frames, angle, True), floors
                yield f"{preset} seed {seed}, tilted by {angle} deg without", tilted(frames, angle, False), floors
            moved = [
                replace(frame, T_world_pano=pose_2d(448123.5, 5411876.25, 0.7, 312.4) @ frame.T_world_pano)
                for frame in frames
            ]
            yield f"{preset} seed {seed}, survey coordinates", moved, ()
            yield f"{preset} seed {seed}, noisy ranges and poses", noisy(frames, seed), floors
            single = {frame.place: frame for frame in reversed(frames) if frame.kind is FrameKind.SCENE}
            yield f"{preset} seed {seed}, one frame a place", list(single.values()), floors
    for height in (0.2, 0.3, 0.5, 1.0, 1.5, 2.0, 2.4):
        yield f"cameras at {height} m", rooms_at(height), ()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--false-alarm-seeds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    alarms, checked = [], 0
    for name, frames, floors in correct_data(range(1, arguments.false_alarm_seeds + 1)):
        checked += 1
        alarms += [f"{name}: {note}" for note in notes_of(frames, floors)]
        print(f"{checked} checked, {len(alarms)} false alarms: {name}", file=sys.stderr)
    rows = detection_curves(range(1, arguments.seeds + 1))
    for row in rows:
        moved = f"{row['median_m']:8.2f} m {row['median_deg']:6.1f} deg"
        print(f"{row['error']:55s} {moved}  reported in {row['reported']} of {row['folders']}")
    print(f"false alarms: {len(alarms)} of {checked}")
    print("\n".join(alarms))
    if arguments.json:
        arguments.json.write_text(json.dumps({"errors": rows, "checked": checked, "alarms": alarms}, indent=1))


if __name__ == "__main__":
    main()
