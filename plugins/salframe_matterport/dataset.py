"""`matterport-annotations`: real buildings as labelled RGB-D panoramas would show them, from public annotations."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.config import ComponentConfig
from salframe.framework.errors import DataError
from salframe.framework.identity import digest
from salframe.navigation.world import NavigableDataset, World
from salframe.panoramas.frames import Fold, MapFrame, QueryFrame, Truth
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.panorama import Panorama
from salframe_matterport.readers import (
    boxes_path,
    connectivity_path,
    find_scans,
    read_connectivity,
    read_regions,
    regions_path,
)
from salframe_matterport.scenes import Scene, generator, read_scenes


class MatterportAnnotations(NavigableDataset):
    """Real buildings: viewpoints of Matterport3D, objects from REVERIE's boxes, one fold a query.

    Every included viewpoint that sees an object is a scene; ranges come from the positions triangulated from all
    bearings of an object. A query is a viewpoint whose region has another scene; its own scene is not in its fold's map
    and its frame is turned by a random yaw.
    """

    name = "matterport-annotations"
    version = "1"

    class Config(ComponentConfig):
        root: Path | None = Field(None, description="folder of connectivity/, reverie/BBox/ and vp2room_label.json")
        scans: Literal["all"] | tuple[str, ...] = Field("all", description="buildings to use")
        range_noise: float = Field(
            0.05, ge=0, lt=1, description="standard deviation of the range's factor, drawn per viewpoint and object"
        )
        min_visible: int = Field(3, ge=1, description="visible objects a query must have")
        seed: int = Field(0, description="of range noise, ranges of objects seen once, and the yaw of queries")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._buildings: dict[str, list[Scene]] = {}

    @property
    def provides(self) -> frozenset[str]:
        return frozenset({"annotations"})

    @cached_property
    def _root(self) -> Path:
        if self.config.root is None:
            raise DataError(
                f"{self.name} needs the folder of the official files (docs/how-to/matterport.md): --data-dir DIR"
            )
        return self.config.root

    @cached_property
    def _scans(self) -> Sequence[str]:
        known = find_scans(self._root)
        if self.config.scans == "all":
            return known
        absent = sorted(set(self.config.scans) - set(known))
        if absent:
            raise DataError(f"{self._root} has no building {', '.join(absent)}, expected some of {', '.join(known)}")
        return self.config.scans

    @cached_property
    def fingerprint(self) -> str:
        """Of the settings and of the bytes of every file read."""
        content = hashlib.sha256(digest(self.config.model_dump(mode="json", exclude={"root"})).encode())
        files = [regions_path(self._root)]
        for scan in self._scans:
            path = connectivity_path(self._root, scan)
            files += [path, *(boxes_path(self._root, scan, viewpoint) for viewpoint in read_connectivity(path))]
        for path in files:
            try:
                content.update(hashlib.sha256(path.read_bytes()).digest())
            except OSError as error:
                raise DataError(f"cannot read {path}: {error.strerror}") from None
        return content.hexdigest()

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Read and triangulate the buildings one by one."""
        for done, scan in enumerate(self._scans):
            progress(done, len(self._scans))
            self._building(scan)
        progress(len(self._scans), len(self._scans))

    def folds(self) -> Sequence[Fold]:
        return [fold for fold, _ in self._folds.values()]

    def truth(self, query_id: str) -> Truth:
        try:
            return self._folds[query_id][1]
        except KeyError:
            raise DataError(f"{self.name} has no query {query_id!r}") from None

    def worlds(self) -> Sequence[World]:
        """Each building's viewpoint graph (salframe_matterport.navigation)."""
        from salframe_matterport.navigation import viewpoint_world

        return [
            viewpoint_world(
                connectivity_path(self._root, scan),
                scan,
                self._building(scan),
                self._mapping(scan),
                self._regions.get(scan, {}),
            )
            for scan in self._scans
        ]

    def scenes(self) -> dict[str, Scene]:
        """Every scene by its id, with the ids of its objects: for evaluation, like `truth`, never for a localizer."""
        return {scene.id: scene for scan in self._scans for scene in self._building(scan)}

    @cached_property
    def _regions(self) -> dict[str, dict[str, int]]:
        return read_regions(regions_path(self._root))

    def _building(self, scan: str) -> list[Scene]:
        if scan not in self._buildings:
            regions = self._regions.get(scan, {})
            self._buildings[scan] = read_scenes(self._root, scan, regions, self.config.range_noise, self.config.seed)
        return self._buildings[scan]

    def _mapping(self, scan: str) -> list[MapFrame]:
        """The mapping frames of all scenes of a building."""
        return [
            MapFrame(
                scene.id, scene.place, scene.T_world_pano, load=_load(scene, scene.id, pose_yaw(scene.T_world_pano))
            )
            for scene in self._building(scan)
        ]

    @cached_property
    def _folds(self) -> dict[str, tuple[Fold, Truth]]:
        """Fold and truth of each query, by the query's id."""
        folds = {}
        for scan in self._scans:
            scenes = self._building(scan)
            mapping = self._mapping(scan)
            scenes_of = Counter(scene.place for scene in scenes)
            for i, scene in enumerate(scenes):
                if len(scene.labels) < self.config.min_visible or scenes_of[scene.place] < 2:
                    continue
                query = f"{scene.id}/query"
                x_m, y_m, z_m = scene.T_world_pano[:3, 3]
                yaw_rad = generator(self.config.seed, "yaw", query).uniform(-np.pi, np.pi)
                fold = Fold(
                    scene.id, tuple(mapping[:i] + mapping[i + 1 :]), (QueryFrame(query, _load(scene, query, yaw_rad)),)
                )
                folds[query] = (
                    fold,
                    Truth(scene.place, pose_2d(x_m, y_m, yaw_rad, z_m), tuple(scene.object_id.tolist())),
                )
        if not folds:
            raise DataError(
                f"{self._root} gives no query: expected a viewpoint with {self.config.min_visible} visible objects "
                "and another in its region"
            )
        return folds


def _load(scene: Scene, id: str, yaw_rad: float) -> Callable[[], Panorama]:
    """What gives the panorama of a scene turned to look along `yaw_rad`. It holds the objects alone, so that no query
    carries its pose or place along.
    """
    return partial(Panorama, id, annotations=scene.annotations(yaw_rad))
