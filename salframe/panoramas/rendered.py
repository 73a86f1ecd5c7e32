"""Data sets that render: once into the folder format, and read from there."""

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
from salframe.framework.files.writing import share_file, write_json
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama, visible_instances

if TYPE_CHECKING:
    from salframe.panoramas.folder_format import FrameEntry, TruthEntry

FrameRole = Literal["map", "transition", "query"]

_OBJECTS, _CONTENTS, _SHARED = "objects.parquet", "contents.json", "frames"


@dataclass(frozen=True)
class FrameSpec:
    """An upright panorama to render: its role, its place, and where it is taken, in the world (z up); `yaw_rad` turns
    its x axis from the world's."""

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
        """Whether its place and pose are truth, which the manifest does not tell."""
        return self.role == "query"


Frame = TypeVar("Frame", bound=FrameSpec)


class RenderedDataset(FolderDataset, Generic[Frame]):
    """Base of data sets that render their panoramas once, into a folder of salframe's cache, and read them from there.

    A subclass says which frames there are, of FrameSpec or a subclass, and renders one at a time; it may name objects
    and floors. It states `provides`: the folder, which knows, comes later. Its configuration and version determine
    every pixel, or it has a `fingerprint` of its own. Data sets that differ in some frames share the images of the
    others, and what caches know of these, where `depends_on` says what a frame's pixels depend on. Where an engine
    renders in other processes, each makes a data set of its own from the configuration.
    """

    @property
    @abstractmethod
    def provides(self) -> frozenset[str]:
        """Which of "rgb", "range", "annotations" every panorama has."""

    def kept(self, frame: Frame) -> frozenset[str]:
        """Which parts of what `render` gives are kept of a frame: what the data set provides, unless overridden."""
        return self.provides

    @abstractmethod
    def list_frames(self) -> Sequence[Frame]:
        """The panoramas of the data set, reference frames and queries. A query's id must not tell where it was taken."""

    def depends_on(self, frame: Frame) -> str:
        """A digest of all that the pixels of a frame depend on, besides the frame itself and the version: that of the
        settings, unless overridden by one of fewer of them."""
        return self.fingerprint

    @abstractmethod
    def render(self, frame: Frame) -> Panorama:
        """The panorama of one of these frames."""

    def list_objects(self) -> Mapping[str, Sequence[Any]] | None:
        """The columns of the table of objects, `instance_id` and `label` among them; None without annotations."""
        return None

    def list_floors(self) -> Mapping[str, FloorMasks]:
        """The floors by the name that their files begin with."""
        return {}

    def file_stem(self, number: int, frame: Frame) -> str:
        """What the files of a frame are called: its number, as an id may hold what no file's name can."""
        return f"{number:05d}"

    @cached_property
    def fingerprint(self) -> str:
        """Of the settings that pixels depend on, and the version."""
        return digest(identity(self.config, describing=True))

    @property
    def root(self) -> Path:
        """Where the rendered frames are kept."""
        return cache_home() / self.name / self.fingerprint[:16]

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Render the frames that are not there yet; progress(done, total) counts frames.

        Raises SalframeError where rendering processes die twice of one frame.
        """
        if (self.root / MANIFEST).exists() and (self.root / _CONTENTS).exists():
            return
        from salframe.panoramas.folder_format import write_floor, write_manifest, write_objects

        frames = self.list_frames()
        # What describes the frames comes first: what is wrong with it shows before hours of rendering.
        objects, floors = self.list_objects(), self.list_floors()
        entries = [self._entry(number, frame) for number, frame in enumerate(frames)]
        keys = [self._key(frame) for frame in frames]
        jobs = [self._job(*one) for one in zip(frames, entries, keys, strict=True)]
        absent = [job for job in jobs if not job.share()]
        done = len(frames) - len(absent)
        progress(done, len(frames))
        for answer in (self.engine or open_engine()).try_all(_Renderer(self), absent) if absent else ():
            if isinstance(answer, WorkerDied):
                raise SalframeError(
                    f"a rendering process died twice of a frame, after {done} of {len(frames)}: run it again to resume"
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
        # A frame's own labels belong to its pixels; components may also draw from the words of the whole table.
        words = sorted(set(objects["label"])) if objects else []
        contents = {frame.id: digest([key, words]) for frame, key in zip(frames, keys, strict=True)}
        write_json(self.root / _CONTENTS, contents)
        table = None if objects is None else _OBJECTS
        write_manifest(self.root, entries, truth, table, masks, rendered="annotations" in self.provides)

    @cached_property
    def contents(self) -> Mapping[str, str]:
        contents: dict[str, str] = read_as(self.root / _CONTENTS, dict[str, str])
        return contents

    def _key(self, frame: Frame) -> str:
        """What the images of a frame are shared by."""
        return digest([self.name, self.version, self.depends_on(frame), asdict(frame), sorted(self.kept(frame))])

    def _job(self, frame: Frame, entry: FrameEntry, key: str) -> _Job:
        from salframe.panoramas.folder_format import image_names

        shared = entry.model_copy(update=image_names(f"{key[:2]}/{key[2:]}", self.kept(frame)))
        return _Job(frame, self.root, entry, cache_home() / self.name / _SHARED, shared)

    def _entry(self, number: int, frame: Frame) -> FrameEntry:
        from salframe.panoramas.folder_format import FrameEntry, image_names

        known: dict[str, Any] = {} if frame.is_query else {"place": frame.place, "pose": _numbers(frame)}
        names = image_names(f"frames/{self.file_stem(number, frame)}", self.kept(frame))
        return FrameEntry(id=frame.id, role=frame.role, **names, **known)

    def _truth(self, frame: Frame, entry: FrameEntry) -> TruthEntry:
        from salframe.panoramas.folder_format import TruthEntry
        from salframe.panoramas.images import read_ids

        instances = visible_instances(read_ids(self.root / entry.instances)) if entry.instances else ()
        return TruthEntry(place=frame.place, pose=_numbers(frame), instances=instances)


def _numbers(frame: FrameSpec) -> tuple[float, ...]:
    """The pose as the manifest has it: 16 numbers row by row."""
    return tuple(frame.pose.ravel().tolist())


@dataclass(frozen=True)
class _Job:
    """A frame to render, its files in the folder of its data set, and in the folder `pool` that data sets share."""

    frame: FrameSpec
    root: Path
    entry: FrameEntry
    pool: Path
    shared: FrameEntry

    def share(self) -> bool:
        """Bring its images, where one of the folders has them all, to the other; whether one had."""
        from salframe.panoramas.folder_format import IMAGE_KEYS, is_written

        own, common = (self.root, self.entry), (self.pool, self.shared)
        for (here, entry), (there, other) in ((own, common), (common, own)):
            if is_written(here, entry):
                for name, other_name in ((getattr(entry, key), getattr(other, key)) for key in IMAGE_KEYS):
                    if name:
                        share_file(here / name, there / other_name)
                return True
        return False

    def write(self, panorama: Panorama) -> None:
        from salframe.panoramas.folder_format import write_panorama

        instance_id = None if panorama.annotations is None else panorama.annotations.instance_id
        write_panorama(self.root, self.entry, panorama.rgb, panorama.range_m, instance_id)
        self.share()


class _Renderer:
    """Renders frames of a data set and writes them. In another process it keeps a data set of its own, and what that
    has built, from one frame to the next."""

    def __init__(self, dataset: RenderedDataset[Any]) -> None:
        self._dataset = dataset

    def __call__(self, job: _Job) -> None:
        job.write(self._dataset.render(job.frame))

    def __reduce__(self) -> tuple[Any, ...]:
        return _renderer_of, (type(self._dataset), self._dataset.config)


@lru_cache(maxsize=1)
def _renderer_of(kind: type[RenderedDataset[Any]], config: ComponentConfig) -> _Renderer:
    return _Renderer(kind(config))
