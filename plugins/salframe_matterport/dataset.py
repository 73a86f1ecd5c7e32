"""`matterport-annotations`: real buildings as labelled RGB-D panoramas would show them, from public annotations."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError
from salframe.framework.files.hashes import digest, file_sha256
from salframe.navigation.world import NavigableDataset, World
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_yaw
from salframe.panoramas.hidden_places import add_hidden_places
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import VIEW_SETTINGS, as_query
from salframe_matterport.chains import Walks, with_query_keys
from salframe_matterport.readers import (
    boxes_path,
    connectivity_path,
    find_scans,
    read_connectivity,
    read_regions,
    read_room_types,
    regions_path,
)
from salframe_matterport.scenes import ViewpointScene, generator, read_scenes, retriangulate_ranges
from salframe_matterport.settings import AnnotationsConfig

APART_M = 1000.0
"""Distance between buildings in one map, in metres: large enough that none of their rooms overlap."""


class MatterportAnnotations(NavigableDataset):
    """Real buildings: the objects visible from each viewpoint of Matterport3D, from the annotations of the benchmark
    REVERIE.

    By default, each query has a map of all other viewpoints of its building. The query is rotated by a random yaw. The
    annotations contain the direction of an object, but no range. salframe triangulates the position of the object from
    its directions at several viewpoints, and computes the range from the position.

    With `query_motion=driven`, a query is a random walk from viewpoint to viewpoint. Its views are the panoramas of the
    walk, each with a random yaw. The map contains none of these viewpoints.
    """

    name = "matterport-annotations"
    version = "1"

    class Config(AnnotationsConfig):
        """See AnnotationsConfig."""

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._buildings: dict[str, list[ViewpointScene]] = {}
        self._references_by_scan: dict[str, list[ReferenceFrame]] = {}
        self._retriangulated: dict[str, ViewpointScene] = {}
        self._walks: dict[str, Walks] = {}

    @property
    def provides(self) -> frozenset[str]:
        return frozenset({"annotations"})

    @cached_property
    def _root(self) -> Path:
        if self.config.root is None:
            raise DataError(
                f"the dataset {self.name} has no folder, expected the folder of its files (see `salframe docs "
                "matterport`): pass --data-dir DIR"
            )
        return self.config.root

    @cached_property
    def _scans(self) -> Sequence[str]:
        buildings = find_scans(self._root)
        if self.config.scans == "all":
            return buildings
        missing = sorted(set(self.config.scans) - set(buildings))
        if missing:
            raise DataError(
                f"{self._root} has no building {', '.join(missing)}, expected one or more of {', '.join(buildings)}"
            )
        return self.config.scans

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the settings that panoramas depend on and of the content of every file that is read."""
        map_settings = {"leave_out", "query_triangulates", "one_map", "map_share", "hide_query_place"}
        settings = self.config.model_dump(mode="json", exclude={"root", *map_settings, *VIEW_SETTINGS})
        content = hashlib.sha256(digest(settings).encode())
        files = [regions_path(self._root)]
        for scan in self._scans:
            path = connectivity_path(self._root, scan)
            files += [path, *(boxes_path(self._root, scan, viewpoint) for viewpoint in read_connectivity(path))]
        for path in files:
            content.update(bytes.fromhex(file_sha256(path)))
        return content.hexdigest()

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Read the buildings and triangulate their objects."""
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
            raise DataError(f"the dataset {self.name} has no query {query_id!r}") from None

    def room_types(self) -> Mapping[str, str]:
        """Return the room type of each region, in the words of its annotators."""
        types = read_room_types(regions_path(self._root))
        return {f"{scan}/region-{index}": kind for scan in self._scans for index, kind in types.get(scan, {}).items()}

    def worlds(self) -> Sequence[World]:
        """Return the viewpoint graph of each building (salframe_matterport.navigation)."""
        from salframe_matterport.navigation import viewpoint_world

        return [
            viewpoint_world(
                connectivity_path(self._root, scan),
                scan,
                self._building(scan),
                self._building_references(scan),
                self._regions.get(scan, {}),
                self._as_query,
            )
            for scan in self._scans
        ]

    def _as_query(self, panorama: Panorama) -> Panorama:
        """Return a panorama of an agent with the settings of queries applied."""
        panorama = as_query(panorama, self.config)
        annotations = panorama.annotations
        if self.config.query_range or annotations is None or annotations.objects is None:
            return panorama
        directions = replace(annotations, objects=replace(annotations.objects, ranged=False))
        return replace(panorama, annotations=directions)

    def scenes(self) -> dict[str, ViewpointScene]:
        """Return every scene (viewpoint) with its object ids, by the id of its reference frame.

        Like `truth`, this is for evaluation only; a localizer must not use it.
        """
        scenes = {scene.id: scene for scan in self._scans for scene in self._building(scan)}
        return scenes if self.config.query_triangulates else {**scenes, **self._retriangulated_scenes}

    @cached_property
    def _regions(self) -> dict[str, dict[str, int]]:
        return read_regions(regions_path(self._root))

    def _building(self, scan: str) -> list[ViewpointScene]:
        if scan not in self._buildings:
            regions = self._regions.get(scan, {})
            self._buildings[scan] = read_scenes(self._root, scan, regions, self.config.range_noise, self.config.seed)
        return self._buildings[scan]

    def _building_references(self, scan: str) -> list[ReferenceFrame]:
        """Return the reference frames of all scenes of a building."""
        if scan not in self._references_by_scan:
            self._references_by_scan[scan] = [self._reference_frame(scan, scene) for scene in self._building(scan)]
        return self._references_by_scan[scan]

    def _reference_frame(self, scan: str, scene: ViewpointScene) -> ReferenceFrame:
        yaw_rad = pose_yaw(scene.T_world_pano)
        return ReferenceFrame(
            scene.id, scene.place, self._world_pose(scan, scene), load=_load(scene, scene.id, yaw_rad)
        )

    def _world_pose(self, scan: str, scene: ViewpointScene) -> np.ndarray:
        """Return T_world_pano (4, 4) of a scene, in the common world if there is one map."""
        T_world_pano = scene.T_world_pano.copy()
        T_world_pano[0, 3] += APART_M * list(self._scans).index(scan) if self.config.one_map else 0.0
        return T_world_pano

    @cached_property
    def _folds(self) -> list[Fold]:
        queries = {scan: self._queries(scan) for scan in self._scans}
        if not any(queries.values()):
            more = "1 other viewpoint" if self.config.leave_out == 1 else f"{self.config.leave_out} other viewpoints"
            raise DataError(
                f"{self._root} has no queries, expected a viewpoint with at least {self.config.min_visible} visible "
                f"objects, in a region with at least {more}: decrease min_visible or leave_out, or choose other "
                "buildings"
            )
        if self.config.map_share is not None:
            return self._folds_of_shared_maps(queries)
        if self.config.one_map:
            return self._folds_of_one_map(queries)
        query_scenes = (scene for scenes in queries.values() for scene in scenes)
        return [Fold(scene.id, tuple(self._map_of(scene)), (self._query(scene),)) for scene in query_scenes]

    def _folds_of_shared_maps(self, queries: Mapping[str, Sequence[ViewpointScene]]) -> list[Fold]:
        """Return one fold for each building with queries, or one fold for all buildings if `one_map` is set.

        All queries of a fold share its map.
        """
        folds = [
            Fold(scan, tuple(self._map_without(scan, self._outside_shared_map(scan))), tuple(map(self._query, scenes)))
            for scan, scenes in queries.items()
        ]
        if not self.config.one_map:
            return [fold for fold in folds if fold.queries]
        references = tuple(frame for fold in folds for frame in fold.references)
        return [Fold("one-map", references, tuple(query for fold in folds for query in fold.queries))]

    def _folds_of_one_map(self, queries: Mapping[str, Sequence[ViewpointScene]]) -> list[Fold]:
        """Return folds with one query per building and a map of all buildings."""
        folds = []
        for number in range(max(map(len, queries.values()))):
            fold_queries = {scan: scenes[number] for scan, scenes in queries.items() if number < len(scenes)}
            frames = [
                frame
                for scan in self._scans
                for frame in (
                    self._map_of(fold_queries[scan]) if scan in fold_queries else self._building_references(scan)
                )
            ]
            folds.append(Fold(f"one-map-{number}", tuple(frames), tuple(map(self._query, fold_queries.values()))))
        return folds

    def _queries(self, scan: str) -> list[ViewpointScene]:
        """Return the scenes of a building that are queries."""
        scenes, queries = self._building(scan), []
        outside = self._outside_shared_map(scan)
        for scene in scenes:
            if len(scene.labels) < self.config.min_visible or scene.id not in outside:
                continue
            left_out = self._left_out(scene)
            if any(other.place == scene.place and other.id not in left_out for other in scenes):
                queries.append(scene)
        return queries

    def _outside_shared_map(self, scan: str) -> frozenset[str]:
        """Return the ids of the scenes of a building that are not in its shared map. If each query has its own map,
        return all ids."""
        ids = [scene.id for scene in self._building(scan)]
        if self.config.map_share is None:
            return frozenset(ids)
        size = min(max(round(self.config.map_share * len(ids)), 1), len(ids) - 1)
        return frozenset(generator(self.config.seed, "map", scan).permutation(ids)[size:].tolist())

    def _left_out(self, query: ViewpointScene) -> frozenset[str]:
        """Return the ids of the scenes that are left out of the map of a query, including the scenes of its views."""
        scan = scan_of(query)
        if self.config.map_share is not None:
            return self._outside_shared_map(scan)
        views = frozenset(scene.id for scene in self._walk(query))
        return views | nearest_of_place(self._building(scan), query, self.config.leave_out)

    @cached_property
    def _truths(self) -> dict[str, Truth]:
        """Truth of each query, by query id."""
        return {
            query_id(scene): Truth(
                scene.place, self._query_pose(scene, query_id(scene)), tuple(scene.object_id.tolist())
            )
            for scan in self._scans
            for scene in self._queries(scan)
        }

    def _query(self, scene: ViewpointScene) -> QueryFrame:
        """Return the query of a scene, with its earlier views if it is driven."""
        walk = self._walk(scene)
        ids = [*(f"{query_id(scene)}/{view.id.partition('/')[2]}" for view in walk[:-1]), query_id(scene)]
        *earlier, query = (
            QueryFrame(id, _load(with_query_keys(scene, view), id, self._yaw_rad(id), self.config.query_range))
            for view, id in zip(walk, ids, strict=True)
        )
        if not self._is_driven:
            return query
        T_world_view = np.stack([self._query_pose(view, id) for view, id in zip(walk, ids, strict=True)])
        return replace(query, earlier=tuple(earlier), T_last_view=invert_pose(T_world_view[-1]) @ T_world_view)

    @property
    def _is_driven(self) -> bool:
        return self.config.query_motion == "driven" and self.config.query_views > 1

    def _walk(self, query: ViewpointScene) -> list[ViewpointScene]:
        """Return the scenes of all views of a query. The last view is the query itself."""
        if not self._is_driven:
            return [query]
        scan = scan_of(query)
        if scan not in self._walks:
            self._walks[scan] = Walks(self._root, scan, self.config.seed)
        outside = self._outside_shared_map(scan)
        scenes = [scene for scene in self._building(scan) if scene.id in outside]
        return self._walks[scan].walk(query, scenes, self.config.query_views)

    def _query_pose(self, scene: ViewpointScene, id: str) -> np.ndarray:
        """Return the world pose (4, 4) of the query panorama `id` at a scene."""
        x_m, y_m, z_m = self._world_pose(scan_of(scene), scene)[:3, 3]
        return pose_2d(x_m, y_m, self._yaw_rad(id), z_m)

    def _yaw_rad(self, id: str) -> float:
        """Return the world yaw of the query panorama `id`."""
        return float(generator(self.config.seed, "yaw", id).uniform(-np.pi, np.pi))

    def _map_of(self, query: ViewpointScene) -> list[ReferenceFrame]:
        """Return the reference frames of a query's building, without the scenes that are left out for the query."""
        return self._map_without(scan_of(query), self._left_out(query))

    def _map_without(self, scan: str, left_out: Collection[str]) -> list[ReferenceFrame]:
        """Return the reference frames of a building without some scenes."""
        frames = [frame for frame in self._building_references(scan) if frame.id not in left_out]
        if self.config.query_triangulates:
            return frames
        retriangulated = self._retriangulate_without(scan, left_out)
        return [
            self._reference_frame(scan, retriangulated[frame.id]) if frame.id in retriangulated else frame
            for frame in frames
        ]

    def _retriangulate_without(self, scan: str, left_out: Collection[str]) -> dict[str, ViewpointScene]:
        """Triangulate the objects of left-out scenes again, from the other scenes of the building only.

        Returns:
            The scenes that see these objects, with the new ranges. The key is the id of the replaced scene. The id of a
            new scene ends with a hash of the ids that were left out.
        """
        map_scenes = [scene for scene in self._building(scan) if scene.id not in left_out]
        objects = np.concatenate([scene.object_id for scene in self._building(scan) if scene.id in left_out])
        retriangulated = retriangulate_ranges(map_scenes, objects, self.config.range_noise, self.config.seed)
        suffix = digest(sorted(left_out))[:8]
        renamed_scenes = {id: replace(scene, id=f"{id}-{suffix}") for id, scene in retriangulated.items()}
        self._retriangulated.update((scene.id, scene) for scene in renamed_scenes.values())
        return renamed_scenes

    @property
    def _retriangulated_scenes(self) -> dict[str, ViewpointScene]:
        """Mapping from id to scene, for all scenes that `_retriangulate_without` returned in any fold."""
        _ = self._folds
        return self._retriangulated


def nearest_of_place(scenes: Sequence[ViewpointScene], query: ViewpointScene, count: int) -> set[str]:
    """Return the ids of the `count` scenes of a query's place that are nearest to the query, including the query."""
    neighbours = [scene for scene in scenes if scene.place == query.place and scene is not query]
    neighbours.sort(key=lambda scene: float(np.linalg.norm(scene.T_world_pano[:3, 3] - query.T_world_pano[:3, 3])))
    return {query.id, *(scene.id for scene in neighbours[: count - 1])}


def scan_of(scene: ViewpointScene) -> str:
    """Return the id of the building of a scene."""
    return scene.id.partition("/")[0]


def query_id(scene: ViewpointScene) -> str:
    """Return the id of a scene's query."""
    return f"{scene.id}/query"


def _load(scene: ViewpointScene, id: str, yaw_rad: float, ranged: bool = True) -> Callable[[], Panorama]:
    """Return a loader of a scene's panorama that looks along `yaw_rad`, with or without the ranges of its objects.

    The loader holds only the objects, so that a query does not carry its pose or place.
    """
    return partial(Panorama, id, annotations=scene.annotations(yaw_rad, ranged))
