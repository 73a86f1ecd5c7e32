"""`matterport3d`: RGB-D panoramas of real buildings, stitched from the official release."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError
from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import digest
from salframe.panoramas import images
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.folder_format import FrameEntry, image_names, is_written, write_panorama
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.hidden_places import add_hidden_places, hide_query_place_setting
from salframe.panoramas.house_file import HouseFile, read_house
from salframe.panoramas.panorama import Annotations, Panorama, visible_instances
from salframe.panoramas.query_view import QueryView
from salframe_matterport.objects import label_pixels, labels
from salframe_matterport.release import Color, Viewpoint, cameras_path, find_buildings, house_path, read_viewpoints
from salframe_matterport.scenes import generator


class Matterport3D(Dataset):
    """Real buildings of Matterport3D: the images of each viewpoint, stitched to one RGB-D panorama.

    The range comes from the 18 depth images of the viewpoint. The colour comes from the six skybox images or from the
    18 colour images (setting `color`).

    The annotations are the objects of the .house file: a pixel shows the object whose oriented box contains its 3D
    point. The places are the regions of the .house file. Viewpoints outside all regions are left out. Each query has a
    map of all other viewpoints of its building. A viewpoint is a query if its region contains another viewpoint. The
    query is rotated by a random yaw. Each panorama is stitched once and stored in salframe's cache.
    """

    name = "matterport3d"
    version = "1"
    provides = frozenset({"rgb", "range", "annotations"})

    class Config(QueryView):
        root: Path | None = Field(
            None,
            description="path of the folder of the Matterport3D release, which contains v1/scans/<scan>/...; "
            "required (--data-dir sets it)",
        )
        scans: Literal["all"] | tuple[str, ...] = Field(
            "all",
            description="list of the ids of the buildings to use, such as [17DRP5sb8fy]; all: all buildings in "
            "the folder",
        )
        color: Color = Field(
            "skybox",
            description="source images of the colour of a panorama. skybox: the six skybox images, which have even "
            "exposure; pictures: the 18 colour images that belong to the depth images",
        )
        height: int = Field(512, ge=64, description="height of a panorama in pixels; its width is twice the height")
        seed: int = Field(0, description="random seed of the yaws of queries")
        hide_query_place: bool = hide_query_place_setting()

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._broken: dict[str, str] = {}

    @cached_property
    def _buildings(self) -> dict[str, Path]:
        if self.config.root is None:
            raise DataError(
                f"the dataset {self.name} has no folder, expected the folder of the Matterport3D release "
                "(see `salframe docs real-buildings`): pass --data-dir DIR"
            )
        buildings = find_buildings(self.config.root)
        if self.config.scans == "all":
            return buildings
        missing = sorted(set(self.config.scans) - set(buildings))
        if missing:
            raise DataError(
                f"{self.config.root} has no building {', '.join(missing)}, expected one or more of "
                f"{', '.join(buildings)}"
            )
        return {scan: buildings[scan] for scan in self.config.scans}

    @cached_property
    def _houses(self) -> dict[str, HouseFile]:
        return {scan: read_house(house_path(folder)) for scan, folder in self._buildings.items()}

    @cached_property
    def _viewpoints(self) -> dict[str, tuple[Viewpoint, str]]:
        """Viewpoint and place of each frame, by frame id."""
        scenes = {}
        for scan, folder in self._buildings.items():
            panoramas = self._houses[scan].panoramas
            for name, viewpoint in read_viewpoints(folder).items():
                if name in panoramas and panoramas[name].region is not None:
                    scenes[f"{scan}/{name}"] = viewpoint, f"{scan}/region-{panoramas[name].region}"
        return scenes

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the settings and of each file's name, size and modification time.

        Hashing the content of all images would take minutes.
        """
        return digest([self.version, self.config.seed, [self._key(id) for id in self._viewpoints]])

    def _key(self, id: str) -> str:
        """Return the cache key of the stitched panorama of a viewpoint."""
        viewpoint, _ = self._viewpoints[id]
        files = [cameras_path(viewpoint.folder), house_path(viewpoint.folder), *viewpoint.files(self.config.color)]
        return digest([self.version, id, self.config.color, self.config.height, *map(_stamp, files)])

    @property
    def _folder(self) -> Path:
        """Folder of the stitched panoramas of all buildings."""
        return cache_home() / self.name

    def _cached_files(self, id: str) -> dict[str, Any]:
        """Return the names of the cached files of a viewpoint's panorama, by their content (such as "rgb")."""
        return image_names(f"{id.split('/')[0]}/{self._key(id)[:24]}", self.provides | {"valid"})

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Stitch the panoramas that are not in the cache yet.

        Missing or damaged images are reported when the viewpoint is loaded.
        """
        for done, (id, (viewpoint, _)) in enumerate(self._viewpoints.items()):
            progress(done, len(self._viewpoints))
            # The role "query" avoids storing a pose and a place.
            entry = FrameEntry(id=id, role="query", **self._cached_files(id))
            if not is_written(self._folder, entry):
                try:
                    panorama = viewpoint.stitch(self.config.height, self.config.color)
                    objects = self._houses[viewpoint.folder.name].objects
                    range_m = cast(np.ndarray, panorama.range_m)  # a stitched panorama always has a range image
                    instance_id = label_pixels(range_m, viewpoint.T_world_pano, objects)
                    write_panorama(self._folder, entry, panorama.rgb, panorama.range_m, instance_id, panorama.valid)
                except DataError as error:
                    self._broken[id] = str(error)
        progress(len(self._viewpoints), len(self._viewpoints))

    def folds(self) -> Sequence[Fold]:
        folds = self.view([fold for fold, _ in self._folds.values()])
        if not self.config.hide_query_place:
            return folds
        return add_hidden_places(folds, lambda query_id: self._folds[query_id][1])

    def truth(self, query_id: str) -> Truth:
        try:
            fold, truth = self._folds[query_id]
        except KeyError:
            raise DataError(f"the dataset {self.name} has no query {query_id!r}") from None
        if fold.id in self._broken:
            return truth
        return replace(
            truth, instances=visible_instances(images.read_ids(self._folder / self._cached_files(fold.id)["instances"]))
        )

    @cached_property
    def _folds(self) -> dict[str, tuple[Fold, Truth]]:
        """Fold and truth of each query, by query id."""
        references: dict[str, list[ReferenceFrame]] = {scan: [] for scan in self._buildings}
        for id, (viewpoint, place) in self._viewpoints.items():
            load = self._load(id, id, 0)
            references[id.split("/")[0]].append(ReferenceFrame(id, place, viewpoint.T_world_pano, load=load))
        folds = {}
        for frames in references.values():
            scenes_of = Counter(frame.place for frame in frames)
            for i, frame in enumerate(frames):
                if scenes_of[frame.place] < 2:
                    continue
                query = f"{frame.id}/query"
                columns = int(generator(self.config.seed, "yaw", query).integers(2 * self.config.height))
                x_m, y_m, z_m = frame.T_world_pano[:3, 3]
                pose = pose_2d(x_m, y_m, pose_yaw(frame.T_world_pano) + np.pi * columns / self.config.height, z_m)
                fold = Fold(
                    frame.id,
                    tuple(frames[:i] + frames[i + 1 :]),
                    (QueryFrame(query, self._load(query, frame.id, columns)),),
                )
                folds[query] = fold, Truth(frame.place, pose)
        if not folds:
            raise DataError(f"{self.config.root} has no queries, because no region has two viewpoints: add buildings")
        return folds

    def _load(self, id: str, viewpoint_id: str, columns: int) -> Callable[[], Panorama]:
        """Return a loader of a viewpoint's panorama, turned by `columns` columns.

        The loader holds only paths and labels, so that a query does not carry its pose or place.
        """
        labels_by_id = labels(self._houses[viewpoint_id.split("/")[0]].objects)
        cached_files, broken = self._cached_files(viewpoint_id), self._broken.get(viewpoint_id)
        return partial(_load, id, self._folder, cached_files, columns, labels_by_id, broken)


def _stamp(path: Path) -> list[str | int]:
    """Return name, size and modification time of a file; the name only if the file is missing."""
    if not path.exists():
        return [path.name]
    state = path.stat()
    return [path.name, state.st_size, state.st_mtime_ns]


def _load(
    id: str, root: Path, files: Mapping[str, str], columns: int, labels_by_id: Mapping[int, str], broken: str | None
) -> Panorama:
    """Load a stitched panorama and turn it by `columns` columns. Raises DataError if it could not be stitched."""
    if broken is not None:
        raise DataError(broken)
    images_by_part = (
        images.read_color(root / files["rgb"]),
        images.read_range(root / files["range"]),
        images.read_mask(root / files["valid"]),
        images.read_ids(root / files["instances"]),
    )
    rgb, range_m, valid, instance_id = (np.roll(image, columns, axis=1) for image in images_by_part)
    return Panorama(id, rgb, range_m, valid, Annotations(instance_id, labels_by_id))
