"""The folder format: a manifest, panoramas as images, and their metadata. See docs/reference/folder-format.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, field_validator, model_validator

from salframe.framework.errors import DataError, counted
from salframe.framework.files.writing import atomic_path, write_json
from salframe.framework.validation import Settings
from salframe.panoramas import images
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.floors import Connection, FloorMasks
from salframe.panoramas.geometry import is_rigid
from salframe.panoramas.pose_conventions import PoseConvention
from salframe.panoramas.range_encoding import MAX_STEP, RangeEncoding, RangeKind

IMAGE_KEYS = ("rgb", "range", "instances", "valid")
"""Keys of a frame in the manifest that name an image file."""
WRITTEN_AS = {
    "rgb": ("rgb", ".jpg"),
    "range": ("range", ".range.png"),
    "annotations": ("instances", ".instances.png"),
    "valid": ("valid", ".valid.png"),
}
"""Part of a panorama -> its key in the manifest, and the ending of its file name."""


def _rigid(pose: tuple[float, ...] | None) -> tuple[float, ...] | None:
    if pose is not None and not is_rigid(np.array(pose).reshape(4, 4), 1e-3):
        expected = "16 numbers row by row: rotation and translation, then 0 0 0 1"
        raise ValueError(f"the pose {list(pose)} is not a rigid motion, expected {expected}")
    return pose


Pose = Field(None, min_length=16, max_length=16, description="T_world_pano, 4 x 4 row by row, metres")


class RangeKeys(Settings):
    """Keys of the manifest that declare the encoding of range images.

    They may be in the entry of a frame, or at the top level for all frames without them. None: not declared.

    Attributes:
        range_unit_m: Metres per step.
        range_missing: Values that mean an unknown range, besides 0.
        range_kind: Quantity that the values measure: "ray" or "cube".
    """

    range_unit_m: PositiveFloat | None = None
    range_missing: tuple[Annotated[int, Field(strict=True, ge=0, le=MAX_STEP)], ...] | None = None
    range_kind: RangeKind | None = None

    @field_validator("range_kind")
    @classmethod
    def _applies_to_panorama(cls, kind: RangeKind | None) -> RangeKind | None:
        if kind is not None:
            try:
                RangeEncoding(kind=kind).check_panorama()
            except DataError as error:
                raise ValueError(str(error)) from None
        return kind

    def encoding(self, default: RangeEncoding) -> RangeEncoding:
        """Return the encoding, with the values of `default` for keys that are not declared."""
        return RangeEncoding(
            default.unit_m if self.range_unit_m is None else self.range_unit_m,
            default.missing if self.range_missing is None else self.range_missing,
            default.kind if self.range_kind is None else self.range_kind,
        )


class FrameEntry(RangeKeys):
    """A panorama in the manifest: image files relative to the folder, and pose and place of reference frames."""

    id: str = Field(min_length=1)
    role: Literal["map", "transition", "query"]
    rgb: str | None = None
    range: str | None = None
    instances: str | None = None
    valid: str | None = None
    place: str | None = None
    pose: tuple[float, ...] | None = Pose
    sequence: str | None = Field(None, min_length=1)
    t_s: Annotated[float, Field(allow_inf_nan=False)] | None = None
    _pose = field_validator("pose")(_rigid)

    @model_validator(mode="after")
    def _belongs_together(self) -> FrameEntry:
        has_pose, has_place = self.pose is not None, self.place is not None
        if self.role == "query" and (has_pose or has_place):
            raise ValueError(
                f"the query {self.id} has a pose or place in the manifest, expected none: move both to the truth file"
            )
        if self.role != "query" and not (has_pose and has_place):
            absent = "place" if has_pose else "pose" if has_place else "pose and no place"
            raise ValueError(f"the reference frame {self.id} has no {absent}, expected the keys `pose` and `place`")
        if self.sequence is not None and self.role != "query":
            raise ValueError(f"the reference frame {self.id} has the key `sequence`, expected the key only in queries")
        if self.sequence is not None and self.t_s is None:
            raise ValueError(
                f"the view {self.id} of the sequence {self.sequence!r} has no `t_s`, expected its time in seconds"
            )
        if not (self.rgb or self.range or self.instances):
            raise ValueError(
                f"the frame {self.id} has no image file, expected at least one of the keys rgb, range and instances"
            )
        return self


class FloorEntry(Settings):
    """A floor in the manifest: masks as PNG files with the layout of FloorMasks, and the place of each region label."""

    free: str
    region: str
    obstacle: str
    resolution_m: PositiveFloat
    origin_m: tuple[float, float]
    regions: dict[int, str]
    z_m: float | None = None


class Manifest(RangeKeys):
    """Content of manifest.json. All paths are relative to its folder.

    Attributes:
        format: Name of the format.
        version: Version of the format.
        frames: All frames: reference frames and queries.
        truth: JSON file with the truth of the queries.
        objects: Table with the label of each instance id.
        labels: Table that translates labels.
        floors: The floors.
        connections: Stairs and lifts between the floors.
        rendered: Whether annotations and ranges come from a renderer and are free of errors.
        odometry: Table with the odometry of the camera.
        pose_convention: Axes of the poses.
        pose_unit_m: Unit of the positions in metres.
    """

    format: Literal["salframe-folder"]
    version: Literal[1]
    frames: tuple[FrameEntry, ...]
    truth: str | None = None
    objects: str | None = None
    labels: str | None = None
    floors: tuple[FloorEntry, ...] = ()
    connections: tuple[Connection, ...] | None = None
    rendered: bool = False
    odometry: str | None = None
    pose_convention: PoseConvention = "ros"
    pose_unit_m: PositiveFloat = 1.0

    @model_validator(mode="after")
    def _frames_differ(self) -> Manifest:
        ids: set[str] = set()
        for frame in self.frames:
            if frame.id in ids:
                raise ValueError(f"two frames have the id {frame.id}, expected unique ids")
            ids.add(frame.id)
        times = {(frame.sequence, frame.t_s) for frame in self.frames if frame.sequence is not None}
        views = [frame for frame in self.frames if frame.sequence is not None]
        if len(times) < len(views):
            (sequence, t_s), _ = Counter((view.sequence, view.t_s) for view in views).most_common(1)[0]
            raise ValueError(
                f"two views of the sequence {sequence!r} have the same t_s = {t_s:g}, expected a different time "
                "(seconds) for each view"
            )
        if not any(frame.role != "query" for frame in self.frames):
            raise ValueError(
                f"none of {counted(len(self.frames), 'frame')} in the manifest is a reference frame, expected at least "
                "one "
                'frame with "role": "map"'
            )
        if any(frame.instances for frame in self.frames) and self.objects is None:
            raise ValueError(
                "frames have instance images, but the manifest has no `objects`, expected a table with the labels of "
                "the instances"
            )
        if self.labels is not None and self.objects is None:
            raise ValueError(
                "received `labels` without `objects`, expected both: `labels` translates the labels of the table "
                "`objects`"
            )
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


def pose_matrix(pose: Sequence[float]) -> np.ndarray:
    """Return the pose, (4, 4) float64, from 16 numbers row by row."""
    return np.array(pose, np.float64).reshape(4, 4)


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


def read_floor(root: Path, entry: FloorEntry, z_m: float) -> FloorMasks:
    """Read the masks of a floor at a height in metres. Raises DataError if they cannot be read or differ in size."""
    free, obstacle = (images.read_mask(root / name) for name in (entry.free, entry.obstacle))
    region = images.read_ids(root / entry.region)
    if not free.shape == obstacle.shape == region.shape:
        shapes = ", ".join(f"{image.shape[1]} x {image.shape[0]}" for image in (free, region, obstacle))
        raise DataError(
            f"{root}: the masks free, region and obstacle of the floor at z = {z_m:g} m have the sizes {shapes}, "
            "expected equal sizes"
        )
    return FloorMasks(free, region, obstacle, entry.resolution_m, entry.origin_m, entry.regions, z_m)


def image_names(stem: str, parts: Iterable[str]) -> dict[str, Any]:
    """Return the file names of a panorama by key of the manifest: STEM.jpg, STEM.range.png and so on.

    Args:
        stem: The beginning of all names.
        parts: The parts of the panorama, a subset of {"rgb", "range", "annotations", "valid"}.
    """
    selected = set(parts)
    return {key: stem + ending for name, (key, ending) in WRITTEN_AS.items() if name in selected}


def write_panorama(
    root: Path,
    frame: FrameEntry,
    rgb: np.ndarray | None = None,
    range_m: np.ndarray | None = None,
    instance_id: np.ndarray | None = None,
    valid: np.ndarray | None = None,
) -> None:
    """Write the images of a frame to the files that its entry names, each atomically.

    The images have the shapes and dtypes of `Panorama`. The range along the ray, `range_m` in metres, is written in the
    encoding that the entry declares.
    """
    if frame.range and range_m is not None:
        images.write_range(root / frame.range, range_m, frame.encoding(RangeEncoding()))
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
    odometry: str | None = None,
    connections: Sequence[Connection] = (),
) -> None:
    """Write truth.json and then manifest.json. Call this last: the manifest makes the folder a dataset.

    Args:
        root: The folder.
        frames: Entries of all frames.
        truth: Truth of the queries by id. If it is empty, no truth file is written, and evaluation is not possible.
        objects: Name of the table of objects.
        floors: Entries of the floors.
        rendered: Whether annotations and ranges come from a renderer and are free of errors.
        odometry: Name of the CSV file with the poses of the views of sequences over time.
        connections: Stairs and lifts between the floors.
    """
    if truth:
        write_json(root / "truth.json", TruthFile(queries=dict(truth)).model_dump(mode="json", exclude_none=True))
    manifest = Manifest(
        format="salframe-folder",
        version=1,
        frames=tuple(frames),
        truth="truth.json" if truth else None,
        objects=objects,
        floors=tuple(floors),
        rendered=rendered,
        odometry=odometry,
        connections=tuple(connections) or None,
    )
    write_json(root / MANIFEST, manifest.model_dump(mode="json", exclude_none=True))
