"""Reading a folder of panoramas in the folder format. See docs/reference/folder-format.md."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from pydantic import Field

from salframe.framework.errors import DataError, TruthMissing, unknown
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.reading import read_model, read_table
from salframe.framework.validation import Settings
from salframe.panoramas.camera_height import USUAL_M
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.floors import MAX_CAMERA_M, SAME_FLOOR_M, Connection, FloorMasks, check_heights
from salframe.panoramas.folder_format import (
    IMAGE_KEYS,
    WRITTEN_AS,
    FrameEntry,
    Manifest,
    TruthEntry,
    TruthFile,
    pose_matrix,
    read_floor,
)
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.label_table import LabelTable
from salframe.panoramas.logo import find_logo
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.panorama_files import load_panorama
from salframe.panoramas.pose_conventions import convert_pose
from salframe.panoramas.range_encoding import RangeEncoding
from salframe.panoramas.sequences import Odometry

_MIN_UPRIGHT_COSINE = np.cos(np.radians(1.0))
"""Cosine of the maximum tilt of a pose that counts as upright."""
_MAX_LOGO_FRAMES = 8
"""Maximum number of frames whose pictures are compared to find a logo."""
MIN_STOREY_M = 2.4
"""Minimum height of a storey. Cameras whose heights differ by more stand on different floors."""


class Folder:
    """A dataset folder, read on demand. All methods raise DataError if a file is missing or malformed."""

    def __init__(self, root: Path):
        if not (root / MANIFEST).exists():
            raise DataError(f"{root} is not a dataset folder, expected a folder with the file {MANIFEST}")
        self.root = root
        self.manifest = read_model(root / MANIFEST, Manifest)

    @property
    def provides(self) -> frozenset[str]:
        """Parts that every frame has, a subset of {"rgb", "range", "annotations"}."""
        frames = self.manifest.frames
        parts = {name for name, (key, _) in WRITTEN_AS.items() if all(getattr(frame, key) for frame in frames)}
        return frozenset(parts - {"valid"})

    @cached_property
    def labels(self) -> dict[int, str]:
        """Label of each instance id, from the table of objects, translated by the table of labels."""
        if self.manifest.objects is None:
            return {}
        labels = read_labels(self.root / self.manifest.objects)
        if self.manifest.labels is None:
            return labels
        table = LabelTable.read(self.root / self.manifest.labels)
        return {id: table.name(label) for id, label in labels.items()}

    @cached_property
    def _truth(self) -> dict[str, TruthEntry]:
        return {} if self.manifest.truth is None else read_model(self.root / self.manifest.truth, TruthFile).queries

    def truth(self, query_id: str) -> Truth:
        """Return the truth of a query. Raises TruthMissing if it has none."""
        try:
            entry = self._truth[query_id]
        except KeyError:
            where = self.root / (self.manifest.truth or MANIFEST)
            raise TruthMissing(
                f"{where} has no true place of the query {query_id!r}, which an evaluation needs: add the place to the "
                "truth file, which the key `truth` of the manifest names"
            ) from None
        return Truth(entry.place, self._pose(entry.pose), entry.instances)

    @property
    def true_poses(self) -> dict[str, np.ndarray]:
        """Id of a query frame -> its true pose T_world_pano (4, 4). Frames with an unknown pose are missing."""
        poses = {id: self._pose(entry.pose) for id, entry in self._truth.items()}
        return {id: pose for id, pose in poses.items() if pose is not None}

    def reference_frame(self, entry: FrameEntry, content: str = "") -> ReferenceFrame:
        """Return the reference frame of an entry of the manifest. Its `load` reads the images. `content` is the cache
        key of its panorama (`ReferenceFrame.content`)."""
        kind = FrameKind.TRANSITION if entry.role == "transition" else FrameKind.SCENE
        pose, place = self._pose(entry.pose), entry.place
        if pose is None or place is None:
            raise DataError(
                f"{self.root / MANIFEST}: the reference frame {entry.id} has no pose or no place, expected both"
            )
        return ReferenceFrame(entry.id, place, pose, kind, partial(self.load, entry), content)

    def _pose(self, pose: Sequence[float] | None) -> np.ndarray | None:
        """Return T_world_pano (4, 4) of a pose in the convention and unit of the manifest; None if the pose is None."""
        if pose is None:
            return None
        return convert_pose(pose_matrix(pose), self.manifest.pose_convention, self.manifest.pose_unit_m)

    def query_frames(self, contents: Mapping[str, str]) -> list[QueryFrame]:
        """Return the queries of the manifest. The images of a query are read when the query is loaded.

        All views of a sequence form one query, in the order of time. The id of the query is the id of the last view.

        Args:
            contents: Id of a frame -> cache key of its content, such as a hash of its images (see
                `QueryFrame.content`). Frames that are missing here have the content "".

        Raises:
            DataError: The odometry cannot be read.
        """
        groups: dict[str, list[FrameEntry]] = {}
        for entry in self.manifest.frames:
            if entry.role == "query" and entry.sequence is None:
                groups[f"frame {entry.id}"] = [entry]
            elif entry.role == "query" and entry.sequence is not None:
                groups[f"sequence {entry.sequence}"] = self.sequences[entry.sequence]
        queries = []
        for entries in groups.values():
            *earlier, last = self.view_frames(entries, contents)
            times = [entry.t_s for entry in entries if entry.t_s is not None]
            T_last_view = self.odometry.motions(times) if self.odometry is not None and earlier else None
            queries.append(replace(last, earlier=tuple(earlier), T_last_view=T_last_view))
        return queries

    def view_frames(self, entries: Sequence[FrameEntry], contents: Mapping[str, str]) -> list[QueryFrame]:
        """Return one query frame with a single view for each entry. `contents` is as in `query_frames`."""
        return [QueryFrame(entry.id, partial(self.load, entry), contents.get(entry.id, "")) for entry in entries]

    @cached_property
    def sequences(self) -> dict[str, list[FrameEntry]]:
        """The views of each sequence by its name, in the order of time."""
        sequences: dict[str, list[FrameEntry]] = {}
        for entry in self.manifest.frames:
            if entry.role == "query" and entry.sequence is not None:
                sequences.setdefault(entry.sequence, []).append(entry)
        for entries in sequences.values():
            entries.sort(key=lambda entry: entry.t_s or 0.0)
        return sequences

    @cached_property
    def odometry(self) -> Odometry | None:
        """The odometry of the camera. None if the manifest names no file. Raises DataError if it cannot be read."""
        return None if self.manifest.odometry is None else Odometry.read(self.root / self.manifest.odometry)

    def load(self, frame: FrameEntry) -> Panorama:
        """Read the panorama of a frame.

        If the XMP of the picture declares a tilt, the panorama is levelled. If the pose of the frame is tilted too, the
        panorama is not levelled, because the pose describes the picture as it is stored.
        """
        pose = self._pose(frame.pose)
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
            encoding=frame.encoding(self.manifest.encoding(RangeEncoding())),
            level=pose is None or pose[2, 2] > _MIN_UPRIGHT_COSINE,
            logo=self._logo,
        )

    @cached_property
    def _logo(self) -> np.ndarray | None:
        """The logo at the bottom of the panoramas, as in `find_logo`. Rendered panoramas have none."""
        entries = [] if self.manifest.rendered else [frame for frame in self.manifest.frames if frame.rgb is not None]
        if len(entries) > _MAX_LOGO_FRAMES:
            indices = np.linspace(0, len(entries) - 1, _MAX_LOGO_FRAMES).round().astype(int)
            entries = [entries[index] for index in indices]
        return find_logo(rgb for entry in entries if (rgb := self._stored_picture(entry)) is not None)

    def _stored_picture(self, frame: FrameEntry) -> np.ndarray | None:
        """Return the picture of a frame, (H, 2H, 3) uint8 on the full sphere and not levelled. None if it cannot be
        read, which is an error when the frame is loaded."""
        try:
            return load_panorama(frame.id, rgb=self.root / (frame.rgb or ""), level=False).rgb
        except DataError:
            return None

    def floors(self) -> list[FloorMasks]:
        """Read the floor masks."""
        heights_m = self._floor_heights()
        floors = [read_floor(self.root, entry, z_m) for entry, z_m in zip(self.manifest.floors, heights_m, strict=True)]
        check_heights(floors)
        return floors

    def connections(self) -> list[Connection]:
        """Return the stairs and lifts.

        Raises:
            DataError: An end of a connection is not the place of a reference frame with the role `map`.
        """
        connections = list(self.manifest.connections or ())
        frames = [frame for frame in self.manifest.frames if frame.role == "map"]
        places = sorted({frame.place for frame in frames if frame.place is not None})
        for end in (end for one in connections for end in (one.start, one.end)):
            if end not in places:
                raise DataError(f"{self.root / MANIFEST}: the key `connections` has an {unknown('place', end, places)}")
        return connections

    def _floor_heights(self) -> list[float]:
        """Return the height of each floor in metres.

        A single floor without `z_m` is at 0 if all cameras are between -SAME_FLOOR_M and MAX_CAMERA_M. Otherwise it is
        USUAL_M below the lowest camera, or higher if the highest camera would be more than MAX_CAMERA_M above it.

        Raises:
            DataError: A floor has no `z_m`, and there are several floors, or the cameras stand on more than one storey.
        """
        heights_m = [floor.z_m for floor in self.manifest.floors]
        if None not in heights_m:
            return [height_m for height_m in heights_m if height_m is not None]
        if len(heights_m) > 1:
            raise DataError(
                f"{self.root / MANIFEST}: {heights_m.count(None)} of {len(heights_m)} floors have no z_m, expected the "
                "height of each floor in the world in metres"
            )
        poses = [self._pose(frame.pose) for frame in self.manifest.frames]
        cameras_m = [float(pose[2, 3]) for pose in poses if pose is not None]
        lowest_m, highest_m = min(cameras_m), max(cameras_m)
        if highest_m - lowest_m > MIN_STOREY_M:
            raise DataError(
                f"{self.root / MANIFEST}: the floor has no z_m, expected its height in the world in metres, because "
                f"the cameras span more than one storey (z = {lowest_m:.2f} to {highest_m:.2f} m)"
            )
        on_zero = lowest_m > -SAME_FLOOR_M and highest_m <= MAX_CAMERA_M
        return [0.0 if on_zero else max(lowest_m - USUAL_M, highest_m - MAX_CAMERA_M)]

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the manifest and of every file that it names."""
        names = [
            MANIFEST,
            *filter(None, (self.manifest.truth, self.manifest.objects, self.manifest.labels, self.manifest.odometry)),
        ]
        names += [name for floor in self.manifest.floors for name in (floor.free, floor.region, floor.obstacle)]
        names += [name for frame in self.manifest.frames for key in IMAGE_KEYS if (name := getattr(frame, key))]
        content = hashlib.sha256()
        for name in names:
            content.update(bytes.fromhex(file_sha256(self.root / name)))
        return content.hexdigest()


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
        raise DataError(
            f"{path} has {len(rows)} rows with {len(labels)} different values of instance_id, expected a different "
            "value in each row"
        )
    return labels
