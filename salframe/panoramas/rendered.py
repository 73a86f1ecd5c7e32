"""Datasets that render their panoramas once into the folder format and read them from there."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import identity
from salframe.framework.engines.engine import open_engine
from salframe.framework.errors import SalframeError, WorkerDied
from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import digest
from salframe.framework.files.reading import read_as
from salframe.framework.files.writing import share_file, write_json, write_text
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.floors import Connection, FloorMasks
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.motion_file import COLUMNS
from salframe.panoramas.panorama import Panorama, visible_instances

if TYPE_CHECKING:
    from salframe.panoramas.folder_format import FrameEntry, TruthEntry

FrameRole = Literal["map", "transition", "query"]

_OBJECTS, _CONTENTS, _SHARED, _ODOMETRY = "objects.parquet", "contents.json", "frames", "odometry.csv"
_SEQUENCE_S = 1000
"""Time from the first view of a sequence to the first view of the next sequence, in seconds."""


@dataclass(frozen=True)
class FrameSpec:
    """An upright panorama to render.

    Attributes:
        id: Id of the frame.
        role: Whether it is a reference frame of a scene ("map"), one of a transition, or a query.
        place: Name of its place.
        x_m: Position of the camera in the world (z up).
        y_m: Position of the camera in the world.
        z_m: Position of the camera in the world.
        yaw_rad: Azimuth of the x axis of the panorama in the world.
    """

    id: str
    role: FrameRole
    place: str
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float

    @property
    def pose(self) -> np.ndarray:
        """T_world_pano (4, 4) float64."""
        return pose_2d(self.x_m, self.y_m, self.yaw_rad, self.z_m)

    @property
    def is_query(self) -> bool:
        """Whether the frame is a query, whose place and pose are in the truth file and not in the manifest."""
        return self.role == "query"


Frame = TypeVar("Frame", bound=FrameSpec)


class RenderedDataset(FolderDataset, Generic[Frame]):
    """Base of datasets that render their panoramas once into a folder of the salframe cache and read them from there.

    A subclass lists its frames (FrameSpec or a subclass) and renders one frame at a time. It may list objects and
    floors. It declares `provides`, because the folder does not exist before `prepare`. If the pixels
    also depend on something else than its configuration and version, it overrides `fingerprint`. It may override
    `depends_on`. Datasets with different settings then share the images and cache entries of their common frames. An
    engine that renders in other processes creates one dataset per process from the configuration.
    """

    @property
    @abstractmethod
    def provides(self) -> frozenset[str]:
        """Parts that every panorama has, a subset of {"rgb", "range", "annotations"}."""

    def stored_parts(self, frame: Frame) -> frozenset[str]:
        """Return the parts of a rendered frame to store: `provides`, unless overridden."""
        return self.provides

    @abstractmethod
    def list_frames(self) -> Sequence[Frame]:
        """Return all frames, reference frames and queries. The id of a query must not reveal its place or pose."""

    def depends_on(self, frame: Frame) -> str:
        """Return a digest of the settings that the pixels of a frame depend on, besides the frame and the version.

        The default is `fingerprint`, which includes all settings. Override this method if fewer settings matter.
        """
        return self.fingerprint

    @abstractmethod
    def render(self, frame: Frame) -> Panorama:
        """Render the panorama of a frame."""

    def list_sequences(self) -> Mapping[str, Sequence[str]]:
        """Return the ids of the earlier views of each query with several views, by the id of the query.

        `list_frames` must contain all of these views.
        """
        return {}

    def list_objects(self) -> Mapping[str, Sequence[Any]] | None:
        """Return the columns of the table of objects, with `instance_id` and `label`; None without annotations."""
        return None

    def list_floors(self) -> Mapping[str, FloorMasks]:
        """Return the floors by name. The file names of a floor begin with its name."""
        return {}

    def list_connections(self) -> Sequence[Connection]:
        """Return the stairs and lifts between the floors. Their ends are names of places."""
        return ()

    def file_stem(self, number: int, frame: Frame) -> str:
        """Return the file name of a frame without extension: its number, because ids may contain any character."""
        return f"{number:05d}"

    @cached_property
    def fingerprint(self) -> str:
        """Digest of the settings that pixels depend on, and of the version."""
        return digest(identity(self.config, describing=True))

    @property
    def root(self) -> Path:
        """The folder of the rendered frames."""
        return cache_home() / self.name / self.fingerprint[:16]

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Render the missing frames.

        Args:
            progress: Called as progress(done, total) with numbers of frames.

        Raises:
            SalframeError: Rendering processes died twice while they rendered the same frame.
        """
        if (self.root / MANIFEST).exists() and (self.root / _CONTENTS).exists():
            return
        from salframe.panoramas.folder_format import write_floor, write_manifest, write_objects

        frames = self.list_frames()
        # Objects, floors and entries are validated first, so that errors appear before hours of rendering.
        objects, floors = self.list_objects(), self.list_floors()
        entries = [self._entry(number, frame) for number, frame in enumerate(frames)]
        entries, odometry = self._with_sequences(frames, entries)
        keys = [self._key(frame) for frame in frames]
        jobs = [self._job(*arguments) for arguments in zip(frames, entries, keys, strict=True)]
        missing = [job for job in jobs if not job.share()]
        done = len(frames) - len(missing)
        progress(done, len(frames))
        for answer in (self.engine or open_engine()).try_all(_Renderer(self), missing) if missing else ():
            if isinstance(answer, WorkerDied):
                raise SalframeError(
                    f"two rendering processes died on the same frame, after {done} of {len(frames)} frames: "
                    "run the command again to resume"
                )
            if isinstance(answer, BaseException):
                raise answer
            done += 1
            progress(done, len(frames))
        if objects is not None:
            write_objects(self.root / _OBJECTS, objects)
        truth = {
            frame.id: self._truth(frame, entry) for frame, entry in zip(frames, entries, strict=True) if frame.is_query
        }
        masks = [write_floor(self.root, name, floor) for name, floor in floors.items()]
        # The key of a frame covers its own labels; components may also use the labels of the whole table.
        labels = sorted(set(objects["label"])) if objects else []
        contents = {frame.id: digest([key, labels]) for frame, key in zip(frames, keys, strict=True)}
        write_json(self.root / _CONTENTS, contents)
        table = None if objects is None else _OBJECTS
        if odometry:
            write_text(self.root / _ODOMETRY, odometry)
        write_manifest(
            self.root,
            entries,
            truth,
            table,
            masks,
            rendered="annotations" in self.provides,
            odometry=_ODOMETRY if odometry else None,
            connections=self.list_connections(),
        )

    def _with_sequences(self, frames: Sequence[Frame], entries: list[FrameEntry]) -> tuple[list[FrameEntry], str]:
        """Return the entries with their sequences and times, and the true odometry as CSV; "" without sequences.

        The views of a sequence are one second apart.
        """
        rows, numbers = [], {frame.id: number for number, frame in enumerate(frames)}
        entries = list(entries)
        for start, (query, earlier) in enumerate(self.list_sequences().items()):
            for step, id in enumerate((*earlier, query)):
                number, t_s = numbers[id], float(start * _SEQUENCE_S + step)
                entries[number] = entries[number].model_copy(update={"sequence": query, "t_s": t_s})
                frame = frames[number]
                rows.append(f"{t_s},{frame.x_m},{frame.y_m},{frame.z_m},{np.degrees(frame.yaw_rad)}")
        return entries, "\n".join([",".join(COLUMNS), *rows, ""]) if rows else ""

    @cached_property
    def contents(self) -> Mapping[str, str]:
        contents: dict[str, str] = read_as(self.root / _CONTENTS, dict[str, str])
        return contents

    def _key(self, frame: Frame) -> str:
        """Return the key under which datasets share the images of a frame."""
        return digest(
            [self.name, self.version, self.depends_on(frame), asdict(frame), sorted(self.stored_parts(frame))]
        )

    def _job(self, frame: Frame, entry: FrameEntry, key: str) -> _Job:
        from salframe.panoramas.folder_format import image_names

        shared = entry.model_copy(update=image_names(f"{key[:2]}/{key[2:]}", self.stored_parts(frame)))
        return _Job(frame, self.root, entry, cache_home() / self.name / _SHARED, shared)

    def _entry(self, number: int, frame: Frame) -> FrameEntry:
        from salframe.panoramas.folder_format import FrameEntry, image_names

        location: dict[str, Any] = {} if frame.is_query else {"place": frame.place, "pose": _pose_numbers(frame)}
        names = image_names(f"frames/{self.file_stem(number, frame)}", self.stored_parts(frame))
        return FrameEntry(id=frame.id, role=frame.role, **names, **location)

    def _truth(self, frame: Frame, entry: FrameEntry) -> TruthEntry:
        from salframe.panoramas.folder_format import TruthEntry
        from salframe.panoramas.images import read_ids

        instances = visible_instances(read_ids(self.root / entry.instances)) if entry.instances else ()
        return TruthEntry(place=frame.place, pose=_pose_numbers(frame), instances=instances)


def _pose_numbers(frame: FrameSpec) -> tuple[float, ...]:
    """Return the pose as in the manifest: 16 numbers row by row."""
    return tuple(frame.pose.ravel().tolist())


@dataclass(frozen=True)
class _Job:
    """A frame to render.

    Attributes:
        frame: The frame.
        root: The folder of the dataset.
        entry: File names of the frame in `root`.
        pool: The folder that datasets share.
        shared: File names of the frame in `pool`.
    """

    frame: FrameSpec
    root: Path
    entry: FrameEntry
    pool: Path
    shared: FrameEntry

    def share(self) -> bool:
        """Link or copy all images from one of the two folders to the other. Return False if neither has all images."""
        from salframe.panoramas.folder_format import IMAGE_KEYS, is_written

        private, common = (self.root, self.entry), (self.pool, self.shared)
        for (source, entry), (target, other) in ((private, common), (common, private)):
            if is_written(source, entry):
                for name, other_name in ((getattr(entry, key), getattr(other, key)) for key in IMAGE_KEYS):
                    if name:
                        share_file(source / name, target / other_name)
                return True
        return False

    def write(self, panorama: Panorama) -> None:
        """Write the images of a rendered panorama to both folders."""
        from salframe.panoramas.folder_format import write_panorama

        instance_id = None if panorama.annotations is None else panorama.annotations.instance_id
        write_panorama(self.root, self.entry, panorama.rgb, panorama.range_m, instance_id)
        self.share()


class _Renderer:
    """Render frames of a dataset and write them.

    A worker process creates one dataset and reuses it for all frames.
    """

    def __init__(self, dataset: RenderedDataset[Any]) -> None:
        self._dataset = dataset

    def __call__(self, job: _Job) -> None:
        job.write(self._dataset.render(job.frame))

    def __reduce__(self) -> tuple[Any, ...]:
        return _renderer_of, (type(self._dataset), self._dataset.config)


@lru_cache(maxsize=1)
def _renderer_of(kind: type[RenderedDataset[Any]], config: ComponentConfig) -> _Renderer:
    return _Renderer(kind(config))
