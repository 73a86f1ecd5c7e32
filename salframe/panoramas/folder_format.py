"""The folder format: a manifest, panoramas as images, and their metadata. See docs/reference/folder-format.md."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, field_validator, model_validator

from salframe.framework.errors import DataError
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.reading import read_model, read_table
from salframe.framework.files.writing import atomic_path, write_json
from salframe.framework.validation import Settings
from salframe.panoramas import images
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import is_rigid
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.panorama_files import load_panorama

IMAGE_KEYS = ("rgb", "range", "instances", "valid")
"""Keys of a frame in the manifest that name an image file."""
_MIN_UPRIGHT_COSINE = np.cos(np.radians(1.0))
"""Cosine of the maximum tilt of a pose that counts as upright."""
_WRITTEN_AS = {
    "rgb": ("rgb", ".jpg"),
    "range": ("range", ".range.png"),
    "annotations": ("instances", ".instances.png"),
    "valid": ("valid", ".valid.png"),
}
"""Parts of a panorama: the key in the manifest, and the ending of the file name."""


def _rigid(pose: tuple[float, ...] | None) -> tuple[float, ...] | None:
    if pose is not None and not is_rigid(np.array(pose).reshape(4, 4), 1e-3):
        expected = "16 numbers row by row: rotation and translation, then 0 0 0 1"
        raise ValueError(f"the pose is no rigid motion, expected {expected}")
    return pose


Pose = Field(None, min_length=16, max_length=16, description="T_world_pano, 4 x 4 row by row, metres")


class FrameEntry(Settings):
    """A panorama in the manifest: image files relative to the folder, and pose and place of reference frames."""

    id: str = Field(min_length=1)
    role: Literal["map", "transition", "query"]
    rgb: str | None = None
    range: str | None = None
    instances: str | None = None
    valid: str | None = None
    place: str | None = None
    pose: tuple[float, ...] | None = Pose
    _pose = field_validator("pose")(_rigid)

    @model_validator(mode="after")
    def _belongs_together(self) -> FrameEntry:
        has_pose, has_place = self.pose is not None, self.place is not None
        if self.role == "query" and (has_pose or has_place):
            raise ValueError(
                f"the query {self.id} has a pose or place in the manifest, expected them in the truth file"
            )
        if self.role != "query" and not (has_pose and has_place):
            raise ValueError(f"the reference frame {self.id} has no {'place' if has_pose else 'pose'}")
        if not (self.rgb or self.range or self.instances):
            raise ValueError(f"the frame {self.id} names no image, expected rgb, range or instances")
        return self


class FloorEntry(Settings):
    """A floor in the manifest: masks as PNG files with the layout of FloorMasks, and the place of each region label."""

    free: str
    region: str
    obstacle: str
    resolution_m: PositiveFloat
    origin_m: tuple[float, float]
    regions: dict[int, str]
    z_m: float = 0.0


class Manifest(Settings):
    """Content of manifest.json."""

    format: Literal["salframe-folder"]
    version: Literal[1]
    frames: tuple[FrameEntry, ...]
    truth: str | None = None
    objects: str | None = None
    floors: tuple[FloorEntry, ...] = ()
    rendered: bool = False

    @model_validator(mode="after")
    def _frames_differ(self) -> Manifest:
        ids: set[str] = set()
        for frame in self.frames:
            if frame.id in ids:
                raise ValueError(f"two frames have the id {frame.id}, expected unique ids")
            ids.add(frame.id)
        if not any(frame.role != "query" for frame in self.frames):
            raise ValueError(
                f"the manifest has {len(self.frames)} frames and no reference frame, expected at least one of role map"
            )
        if any(frame.instances for frame in self.frames) and self.objects is None:
            raise ValueError("frames have instance images, but `objects` names no table with their labels")
        return self


class TruthEntry(Settings):
    """The truth of a query in the truth file: place, pose, and ids of the visible instances."""

    place: str
    pose: tuple[float, ...] | None = Pose
    instances: tuple[int, ...] = ()
    _pose = field_validator("pose")(_rigid)


class TruthFile(Settings):
    """Content of the truth file: one entry for each query."""

    queries: dict[str, TruthEntry]


class Folder:
    """A dataset folder, read on demand. Raises DataError, in one line, where a file is missing or malformed."""

    def __init__(self, root: Path):
        if not (root / MANIFEST).exists():
            raise DataError(f"{root} is not a dataset folder: it has no {MANIFEST}")
        self.root = root
        self.manifest = read_model(root / MANIFEST, Manifest)

    @property
    def provides(self) -> frozenset[str]:
        """Parts that every frame has, of "rgb", "range" and "annotations"."""
        frames = self.manifest.frames
        parts = {name for name, (key, _) in _WRITTEN_AS.items() if all(getattr(frame, key) for frame in frames)}
        return frozenset(parts - {"valid"})

    @cached_property
    def labels(self) -> dict[int, str]:
        """Label of each instance id, from the table of objects."""
        return {} if self.manifest.objects is None else read_labels(self.root / self.manifest.objects)

    @cached_property
    def _truth(self) -> dict[str, TruthEntry]:
        return {} if self.manifest.truth is None else read_model(self.root / self.manifest.truth, TruthFile).queries

    def truth(self, query_id: str) -> Truth:
        """Return the truth of a query."""
        try:
            entry = self._truth[query_id]
        except KeyError:
            raise DataError(
                f"{self.root / (self.manifest.truth or MANIFEST)} has no truth of the query {query_id!r}"
            ) from None
        return Truth(entry.place, pose_matrix(entry.pose), entry.instances)

    def reference_frame(self, entry: FrameEntry, content: str = "") -> ReferenceFrame:
        """Return a reference frame of the manifest with this `content`; its images are read when it is loaded."""
        kind = FrameKind.TRANSITION if entry.role == "transition" else FrameKind.SCENE
        pose, place = pose_matrix(entry.pose), entry.place
        if pose is None or place is None:
            raise DataError(f"{self.root / MANIFEST}: the reference frame {entry.id} has no pose or no place")
        return ReferenceFrame(entry.id, place, pose, kind, partial(self.load, entry), content)

    def query_frame(self, entry: FrameEntry, content: str = "") -> QueryFrame:
        """Return a query of the manifest with this `content`; its images are read when it is loaded."""
        return QueryFrame(entry.id, partial(self.load, entry), content)

    def load(self, frame: FrameEntry) -> Panorama:
        """Read the panorama of a frame.

        A picture that is tilted by its XMP is levelled, unless the pose of the frame is tilted: such a pose describes
        the picture as it is stored.
        """
        pose = pose_matrix(frame.pose)
        rgb, range_image, instances, valid = (
            None if name is None else self.root / name for name in (getattr(frame, key) for key in IMAGE_KEYS)
        )
        return load_panorama(
            frame.id,
            rgb=rgb,
            range_image=range_image,
            instances=instances,
            valid=valid,
            labels=self.labels if instances else None,
            rendered=self.manifest.rendered,
            level=pose is None or pose[2, 2] > _MIN_UPRIGHT_COSINE,
        )

    def floors(self) -> list[FloorMasks]:
        """Read the floor masks."""
        floors = []
        for floor in self.manifest.floors:
            free, obstacle = (images.read_mask(self.root / name) for name in (floor.free, floor.obstacle))
            region = images.read_ids(self.root / floor.region)
            if not free.shape == obstacle.shape == region.shape:
                shapes = ", ".join(f"{image.shape[1]} x {image.shape[0]}" for image in (free, region, obstacle))
                raise DataError(
                    f"{self.root}: the masks free, region and obstacle of a floor are {shapes}, expected equal sizes"
                )
            floors.append(
                FloorMasks(free, region, obstacle, floor.resolution_m, floor.origin_m, floor.regions, floor.z_m)
            )
        return floors

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the manifest and of every file that it names."""
        names = [MANIFEST, *(name for name in (self.manifest.truth, self.manifest.objects) if name)]
        names += [name for floor in self.manifest.floors for name in (floor.free, floor.region, floor.obstacle)]
        names += [name for frame in self.manifest.frames for key in IMAGE_KEYS if (name := getattr(frame, key))]
        content = hashlib.sha256()
        for name in names:
            content.update(bytes.fromhex(file_sha256(self.root / name)))
        return content.hexdigest()


def pose_matrix(pose: Sequence[float] | None) -> np.ndarray | None:
    """Return the pose, (4, 4) float64, from 16 numbers row by row; None from None."""
    return None if pose is None else np.array(pose, np.float64).reshape(4, 4)


class ObjectRow(Settings):
    """A row of the table of objects; other columns are ignored. Id 0 means no object."""

    instance_id: int = Field(strict=True, ge=0, le=65535)
    label: str = Field(strict=True)


def read_labels(path: Path) -> dict[int, str]:
    """Read the label of each instance id from a Parquet table with the columns instance_id and label.

    Raises:
        DataError: The table is malformed or empty, or has an id twice.
    """
    rows = read_table(path, ObjectRow)
    if not rows:
        raise DataError(f"{path} has no row, expected one for each object of the instance images")
    labels = {row.instance_id: row.label for row in rows}
    if len(labels) < len(rows):
        raise DataError(f"{path} has {len(rows)} rows and {len(labels)} different instance_id, expected unique ids")
    return labels


def write_objects(path: Path, columns: Mapping[str, Sequence]) -> None:
    """Write the table of objects, one row each, with the columns instance_id, label and any others."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with atomic_path(path) as temporary:
        pq.write_table(pa.table(dict(columns)), temporary, write_page_checksum=True)


def write_floor(root: Path, name: str, masks: FloorMasks) -> FloorEntry:
    """Write the masks of a floor as NAME-free.png, NAME-region.png and NAME-obstacle.png; return its manifest entry."""
    entry = FloorEntry(
        free=f"{name}-free.png",
        region=f"{name}-region.png",
        obstacle=f"{name}-obstacle.png",
        resolution_m=masks.resolution_m,
        origin_m=masks.origin_m,
        regions=dict(masks.regions),
        z_m=masks.z_m,
    )
    images.write_mask(root / entry.free, masks.free)
    images.write_ids(root / entry.region, masks.region)
    images.write_mask(root / entry.obstacle, masks.obstacle)
    return entry


def image_names(stem: str, parts: Iterable[str]) -> dict[str, Any]:
    """Return the file names of a panorama by key of the manifest: STEM.jpg, STEM.range.png and so on.

    Args:
        stem: The beginning of all names.
        parts: The parts of the panorama, of "rgb", "range", "annotations" and "valid".
    """
    selected = set(parts)
    return {key: stem + ending for name, (key, ending) in _WRITTEN_AS.items() if name in selected}


def write_panorama(
    root: Path,
    frame: FrameEntry,
    rgb: np.ndarray | None = None,
    range_m: np.ndarray | None = None,
    instance_id: np.ndarray | None = None,
    valid: np.ndarray | None = None,
) -> None:
    """Write the images of a frame to the files that its entry names, each atomically."""
    if frame.range and range_m is not None:
        images.write_range(root / frame.range, range_m)
    if frame.instances and instance_id is not None:
        images.write_ids(root / frame.instances, instance_id)
    if frame.valid and valid is not None:
        images.write_mask(root / frame.valid, valid)
    if frame.rgb and rgb is not None:
        images.write_color(root / frame.rgb, rgb)


def is_written(root: Path, frame: FrameEntry) -> bool:
    """Return whether all image files of a frame exist."""
    return all((root / name).exists() for key in IMAGE_KEYS if (name := getattr(frame, key)))


def write_manifest(
    root: Path,
    frames: Sequence[FrameEntry],
    truth: Mapping[str, TruthEntry],
    objects: str | None = None,
    floors: Sequence[FloorEntry] = (),
    rendered: bool = False,
) -> None:
    """Write truth.json and then manifest.json. Call this last: the manifest makes the folder a dataset."""
    write_json(root / "truth.json", TruthFile(queries=dict(truth)).model_dump(mode="json", exclude_none=True))
    manifest = Manifest(
        format="salframe-folder",
        version=1,
        frames=tuple(frames),
        truth="truth.json",
        objects=objects,
        floors=tuple(floors),
        rendered=rendered,
    )
    write_json(root / MANIFEST, manifest.model_dump(mode="json", exclude_none=True))
