"""`matterport-annotations`: real buildings as labelled RGB-D panoramas would show them, from public annotations."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.errors import DataError
from salframe.framework.files.hashes import digest, file_sha256
from salframe.navigation.world import NavigableDataset, World
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.hidden_places import add_hidden_places, hide_query_place_setting
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import VIEW_SETTINGS, QueryView, as_query
from salframe_matterport.readers import (
    boxes_path,
    connectivity_path,
    find_scans,
    read_connectivity,
    read_regions,
    read_room_types,
    regions_path,
)
from salframe_matterport.scenes import ViewpointScene, generator, range_again, read_scenes

APART_M = 1000.0
"""In one map, buildings lie so far apart that none of their rooms meet."""


class MatterportAnnotations(NavigableDataset):
    """Real buildings: viewpoints of Matterport3D, objects from REVERIE's boxes, one fold a query.

    Every included viewpoint that sees an object is a scene; ranges come from the positions triangulated from all
    bearings of an object. A query is a viewpoint whose region has another scene; its own scene is not in its fold's map
    and its frame is turned by a random yaw. What else its map holds is set: `leave_out`, `query_triangulates`,
    `one_map`, `hide_query_place`.
    """

    name = "matterport-annotations"
    version = "1"

    class Config(QueryView):
        root: Path | None = Field(None, description="folder of connectivity/, reverie/BBox/ and vp2room_label.json")
        scans: Literal["all"] | tuple[str, ...] = Field("all", description="buildings to use")
        range_noise: float = Field(
            0.05, ge=0, lt=1, description="standard deviation of the range's factor, drawn per viewpoint and object"
        )
        min_visible: int = Field(3, ge=1, description="visible objects a query must have")
        seed: int = Field(0, description="of range noise, ranges of objects seen once, and the yaw of queries")
        leave_out: int = match_only(
            1,
            ge=1,
            description="viewpoints of the query's region that its map lacks: its own, and those nearest to it; "
            "queries are viewpoints of regions that have more",
        )
        query_triangulates: bool = match_only(
            True,
            description="bearings of the viewpoints that a map lacks help to triangulate its ranges; "
            "false: those of the map's own viewpoints alone",
        )
        one_map: bool = match_only(
            False, description="a map holds all buildings, 1 km apart along x; a fold asks a query of each"
        )
        hide_query_place: bool = hide_query_place_setting()

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._buildings: dict[str, list[ViewpointScene]] = {}
        self._mapped: dict[str, list[ReferenceFrame]] = {}
        self._again: dict[str, ViewpointScene] = {}

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
        """Of the settings that panoramas depend on and of the bytes of every file read."""
        about_maps = {"leave_out", "query_triangulates", "one_map", "hide_query_place"}
        settings = self.config.model_dump(mode="json", exclude={"root", *about_maps, *VIEW_SETTINGS})
        content = hashlib.sha256(digest(settings).encode())
        files = [regions_path(self._root)]
        for scan in self._scans:
            path = connectivity_path(self._root, scan)
            files += [path, *(boxes_path(self._root, scan, viewpoint) for viewpoint in read_connectivity(path))]
        for path in files:
            content.update(bytes.fromhex(file_sha256(path)))
        return content.hexdigest()

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Read and triangulate the buildings one by one."""
        for done, scan in enumerate(self._scans):
            progress(done, len(self._scans))
            self._building(scan)
        progress(len(self._scans), len(self._scans))

    def folds(self) -> Sequence[Fold]:
        folds = self.view(self._folds)
        return add_hidden_places(folds, self.truth) if self.config.hide_query_place else folds

    def truth(self, query_id: str) -> Truth:
        try:
            return self._truths[query_id]
        except KeyError:
            raise DataError(f"{self.name} has no query {query_id!r}") from None

    def room_types(self) -> Mapping[str, str]:
        """As the annotators of the regions called them."""
        types = read_room_types(regions_path(self._root))
        return {f"{scan}/region-{index}": kind for scan in self._scans for index, kind in types.get(scan, {}).items()}

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
                partial(as_query, config=self.config),
            )
            for scan in self._scans
        ]

    def scenes(self) -> dict[str, ViewpointScene]:
        """Every scene by the id of its reference frames, with the ids of its objects: for evaluation, like `truth`, never
        for a localizer."""
        own = {scene.id: scene for scan in self._scans for scene in self._building(scan)}
        return own if self.config.query_triangulates else {**own, **self._scenes_again}

    @cached_property
    def _regions(self) -> dict[str, dict[str, int]]:
        return read_regions(regions_path(self._root))

    def _building(self, scan: str) -> list[ViewpointScene]:
        if scan not in self._buildings:
            regions = self._regions.get(scan, {})
            self._buildings[scan] = read_scenes(self._root, scan, regions, self.config.range_noise, self.config.seed)
        return self._buildings[scan]

    def _mapping(self, scan: str) -> list[ReferenceFrame]:
        """The reference frames of all scenes of a building."""
        if scan not in self._mapped:
            self._mapped[scan] = [self._map_frame(scan, scene) for scene in self._building(scan)]
        return self._mapped[scan]

    def _map_frame(self, scan: str, scene: ViewpointScene) -> ReferenceFrame:
        yaw_rad = pose_yaw(scene.T_world_pano)
        return ReferenceFrame(scene.id, scene.place, self._stands(scan, scene), load=_load(scene, scene.id, yaw_rad))

    def _stands(self, scan: str, scene: ViewpointScene) -> np.ndarray:
        """T_world_pano (4, 4) of a scene, in one world where there is one map."""
        T_world_pano = scene.T_world_pano.copy()
        T_world_pano[0, 3] += APART_M * list(self._scans).index(scan) if self.config.one_map else 0.0
        return T_world_pano

    @cached_property
    def _folds(self) -> list[Fold]:
        queries = {scan: self._queries(scan) for scan in self._scans}
        if not any(queries.values()):
            more = "another" if self.config.leave_out == 1 else f"{self.config.leave_out} others"
            raise DataError(
                f"{self._root} gives no query: expected a viewpoint with {self.config.min_visible} visible objects "
                f"and {more} in its region"
            )
        if not self.config.one_map:
            every = (scene for scenes in queries.values() for scene in scenes)
            return [Fold(scene.id, tuple(self._map_without(scene)), (self._query(scene),)) for scene in every]
        folds = []
        for number in range(max(map(len, queries.values()))):
            asked = {scan: scenes[number] for scan, scenes in queries.items() if number < len(scenes)}
            frames = [
                frame
                for scan in self._scans
                for frame in (self._map_without(asked[scan]) if scan in asked else self._mapping(scan))
            ]
            folds.append(Fold(f"one-map-{number}", tuple(frames), tuple(map(self._query, asked.values()))))
        return folds

    def _queries(self, scan: str) -> list[ViewpointScene]:
        """The scenes of a building that are queries."""
        scenes = self._building(scan)
        scenes_of = Counter(scene.place for scene in scenes)
        return [
            scene
            for scene in scenes
            if len(scene.labels) >= self.config.min_visible and scenes_of[scene.place] > self.config.leave_out
        ]

    @cached_property
    def _truths(self) -> dict[str, Truth]:
        """By the query's id."""
        truths = {}
        for scan in self._scans:
            for scene in self._queries(scan):
                x_m, y_m, z_m = self._stands(scan, scene)[:3, 3]
                pose = pose_2d(x_m, y_m, self._yaw_rad(scene), z_m)
                truths[query_id(scene)] = Truth(scene.place, pose, tuple(scene.object_id.tolist()))
        return truths

    def _query(self, scene: ViewpointScene) -> QueryFrame:
        return QueryFrame(query_id(scene), _load(scene, query_id(scene), self._yaw_rad(scene)))

    def _yaw_rad(self, scene: ViewpointScene) -> float:
        """How the query of a scene is turned in the world."""
        return float(generator(self.config.seed, "yaw", query_id(scene)).uniform(-np.pi, np.pi))

    def _map_without(self, query: ViewpointScene) -> list[ReferenceFrame]:
        """The reference frames of a query's building, without what is left out for it."""
        scan = query.id.partition("/")[0]
        left_out = nearest_of_place(self._building(scan), query, self.config.leave_out)
        frames = [frame for frame in self._mapping(scan) if frame.id not in left_out]
        if self.config.query_triangulates:
            return frames
        again = self._triangulated_without(scan, left_out)
        return [self._map_frame(scan, again[frame.id]) if frame.id in again else frame for frame in frames]

    def _triangulated_without(self, scan: str, left_out: Collection[str]) -> dict[str, ViewpointScene]:
        """The scenes of a building that see the same objects as those left out, with the ranges that the other scenes
        give, by the id of the scene that each takes the place of. Their own ids name what was left out."""
        kept = [scene for scene in self._building(scan) if scene.id not in left_out]
        objects = np.concatenate([scene.object_id for scene in self._building(scan) if scene.id in left_out])
        again = range_again(kept, objects, self.config.range_noise, self.config.seed)
        mark = digest(sorted(left_out))[:8]
        found = {id: replace(scene, id=f"{id}-{mark}") for id, scene in again.items()}
        self._again.update((scene.id, scene) for scene in found.values())
        return found

    @property
    def _scenes_again(self) -> dict[str, ViewpointScene]:
        """The scenes of `_triangulated_without` of all folds, by their own ids."""
        _ = self._folds
        return self._again


def nearest_of_place(scenes: Sequence[ViewpointScene], query: ViewpointScene, count: int) -> set[str]:
    """The ids of the `count` scenes of a query's place that are nearest to it, itself first."""
    own = [scene for scene in scenes if scene.place == query.place and scene is not query]
    own.sort(key=lambda scene: float(np.linalg.norm(scene.T_world_pano[:3, 3] - query.T_world_pano[:3, 3])))
    return {query.id, *(scene.id for scene in own[: count - 1])}


def query_id(scene: ViewpointScene) -> str:
    """The id of the query that a scene is."""
    return f"{scene.id}/query"


def _load(scene: ViewpointScene, id: str, yaw_rad: float) -> Callable[[], Panorama]:
    """What gives the panorama of a scene turned to look along `yaw_rad`. It holds the objects alone, so that no query
    carries its pose or place along.
    """
    return partial(Panorama, id, annotations=scene.annotations(yaw_rad))
