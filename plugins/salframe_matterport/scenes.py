"""Scenes of a building from its official files. A scene consists of the objects that a labelled RGB-D panorama would
show at a viewpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.hashes import digest
from salframe.graphs.triangulation import triangulate
from salframe.panoramas.panorama import Annotations, ObjectBoxes
from salframe_matterport.bearings import bearing, direction
from salframe_matterport.readers import boxes_path, connectivity_path, read_boxes, read_connectivity


@dataclass(frozen=True, eq=False)
class ViewpointScene:
    """A viewpoint and its visible objects.

    Attributes:
        id: Id of the scene.
        place: Place of the viewpoint.
        T_world_pano: Pose (4, 4) of the panorama.
        object_id: Object ids (N,) int64, used only for triangulation and ground truth.
        labels: Label of each object.
        keys: Key of each object, which seeds simulated errors. An object has different keys at different viewpoints.
        azimuth_rad: Azimuths (N,), counter-clockwise from world +x.
        elevation_rad: Elevations (N,).
        width_rad: Horizontal angles (N,) that the objects subtend.
        height_rad: Vertical angles (N,) that the objects subtend.
        range_m: Ranges (N,) in metres, NaN where unknown.
    """

    id: str
    place: str
    T_world_pano: np.ndarray
    object_id: np.ndarray
    labels: tuple[str, ...]
    keys: tuple[str, ...]
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    width_rad: np.ndarray
    height_rad: np.ndarray
    range_m: np.ndarray

    def annotations(self, yaw_rad: float, ranged: bool = True) -> Annotations:
        """Return the objects in the frame of an upright panorama that looks along the world azimuth `yaw_rad`.

        If `ranged` is false, detectors do not use the ranges of the objects.
        """
        azimuth = self.azimuth_rad - yaw_rad
        # Diameter of a sphere that subtends this angle; bounded for objects that surround the viewpoint.
        width, height = (
            2 * self.range_m * np.sin(np.minimum(angle, np.pi) / 2) for angle in (self.width_rad, self.height_rad)
        )
        objects = ObjectBoxes(
            self.labels,
            self.keys,
            self.range_m[:, None] * direction(azimuth, self.elevation_rad),
            np.stack([width, np.minimum(width, height), height], 1),
            (azimuth + np.pi / 2) % np.pi,
            ranged,
        )
        return Annotations(objects=objects)


def generator(*key: object) -> np.random.Generator:
    """Return a random generator seeded by the key only."""
    return np.random.default_rng(int(digest([str(part) for part in key])[:32], 16))


def object_key(scan: str, viewpoint: str, number: int) -> str:
    """Return the key of an object at a viewpoint. It does not reveal the object's id."""
    return digest([scan, viewpoint, number])[:16]


def read_scenes(
    root: Path, scan: str, regions: Mapping[str, int], range_noise: float, seed: int
) -> list[ViewpointScene]:
    """Read the scenes of the viewpoints that show at least one object, in the order of the connectivity file.

    The range of an object is the distance to its triangulated position times a random factor. An object that could not
    be triangulated gets the range of another object of the building, drawn at random; NaN if there is none.

    Args:
        root: Folder of the official files.
        scan: Id of the building.
        regions: Region index of each viewpoint.
        range_noise: Standard deviation of the logarithm of the random factor.
        seed: Random seed of the ranges.

    Raises:
        DataError: A file is missing or malformed, or a viewpoint has no region.
    """
    poses = read_connectivity(connectivity_path(root, scan))
    visible = {viewpoint: read_boxes(boxes_path(root, scan, viewpoint), viewpoint) for viewpoint in poses}
    visible = {viewpoint: objects for viewpoint, objects in visible.items() if objects}
    unplaced = sorted(visible.keys() - regions.keys())
    if unplaced:
        raise DataError(
            f"vp2room_label.json has no region for {len(unplaced)} viewpoints of {scan}, "
            f"expected a region for each viewpoint; the first viewpoint without a region is {unplaced[0]}"
        )

    origin_m = np.array([poses[viewpoint][:3, 3] for viewpoint, objects in visible.items() for _ in objects]).reshape(
        -1, 3
    )
    object_id = np.array([number for objects in visible.values() for number in objects], np.int64)
    angles = np.array([bearing(b.view, b.box_px) for objects in visible.values() for b in objects.values()]).reshape(
        -1, 4
    )
    distinct, target = np.unique(object_id, return_inverse=True)
    position_m = triangulate(origin_m, direction(angles[:, 0], angles[:, 1]), target, len(distinct))
    true_range_m = np.linalg.norm(position_m[target] - origin_m, axis=1)
    triangulated_m = true_range_m[np.isfinite(true_range_m)]

    scenes = []
    first = 0
    for viewpoint, objects in visible.items():
        keys = [object_key(scan, viewpoint, number) for number in objects]
        # Sorted by a hash, so that neither keys nor order reveal which objects are the same at another viewpoint.
        order = sorted(range(len(keys)), key=keys.__getitem__)
        rows = first + np.array(order)
        range_m = np.full(len(rows), np.nan)
        for i, row in enumerate(rows):
            random = generator(seed, "range", scan, viewpoint, object_id[row])
            range_m[i] = _noisy_range(true_range_m[row], triangulated_m, range_noise, random)
        labels = [boxes.label for boxes in objects.values()]
        azimuth_rad, elevation_rad, width_rad, height_rad = angles[rows].T
        scenes.append(
            ViewpointScene(
                id=f"{scan}/{viewpoint}",
                place=f"{scan}/region-{regions[viewpoint]}",
                T_world_pano=poses[viewpoint],
                object_id=object_id[rows],
                labels=tuple(labels[i] for i in order),
                keys=tuple(keys[i] for i in order),
                azimuth_rad=azimuth_rad,
                elevation_rad=elevation_rad,
                width_rad=width_rad,
                height_rad=height_rad,
                range_m=range_m,
            )
        )
        first += len(objects)
    return scenes


def _noisy_range(range_m: float, others_m: np.ndarray, range_noise: float, random: np.random.Generator) -> float:
    """Return a range in metres times a random factor.

    If the range is unknown, return a random value of `others_m`, or NaN if `others_m` is empty.
    """
    if np.isfinite(range_m):
        return float(range_m * np.exp(range_noise * random.standard_normal()))
    return float(random.choice(others_m)) if len(others_m) else np.nan


def retriangulate_ranges(
    scenes: Sequence[ViewpointScene], objects: np.ndarray, range_noise: float, seed: int
) -> dict[str, ViewpointScene]:
    """Triangulate the ranges of some objects again, from the bearings of `scenes` only.

    Random factors are drawn as in `read_scenes`. An object that cannot be triangulated gets the range of another object
    of the scenes, drawn at random.

    Args:
        scenes: Scenes of a building.
        objects: Ids of the objects.
        range_noise: Standard deviation of the logarithm of the random factor.
        seed: Random seed of the ranges.

    Returns:
        Copies of the scenes that show some of the objects, with the new ranges, by scene id.
    """
    affected = [np.isin(scene.object_id, objects) for scene in scenes]
    rays = [(scene, i) for scene, shared in zip(scenes, affected, strict=True) for i in np.flatnonzero(shared)]
    origin_m = np.array([scene.T_world_pano[:3, 3] for scene, _ in rays]).reshape(-1, 3)
    azimuth_rad = np.array([scene.azimuth_rad[i] for scene, i in rays])
    elevation_rad = np.array([scene.elevation_rad[i] for scene, i in rays])
    distinct, target = np.unique([scene.object_id[i] for scene, i in rays], return_inverse=True)
    position_m = triangulate(origin_m, direction(azimuth_rad, elevation_rad), target, len(distinct))
    true_range_m = np.linalg.norm(position_m[target] - origin_m, axis=1)
    other_m = np.concatenate([scene.range_m[~shared] for scene, shared in zip(scenes, affected, strict=True)])
    other_m = other_m[np.isfinite(other_m)]
    new_range_m: dict[str, np.ndarray] = {scene.id: scene.range_m.copy() for scene, _ in rays}
    for (scene, i), range_m in zip(rays, true_range_m, strict=True):
        scan, _, viewpoint = scene.id.partition("/")
        random = generator(seed, "range", scan, viewpoint, scene.object_id[i])
        new_range_m[scene.id][i] = _noisy_range(range_m, other_m, range_noise, random)
    return {scene.id: replace(scene, range_m=new_range_m[scene.id]) for scene in scenes if scene.id in new_range_m}
