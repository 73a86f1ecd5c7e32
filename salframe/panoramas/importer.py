"""The role `importer`: read recordings in a foreign format as panoramas, for the folder format."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.component import Role
from salframe.framework.errors import DataError
from salframe.panoramas.frames import check_pose
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.panorama_files import load_panorama
from salframe.panoramas.range_encoding import RangeEncoding

IMPORTED_PARTS = frozenset({"rgb", "range", "annotations", "valid"})
"""Parts that an imported panorama may have."""
_ID = re.compile(r"[^\s/\\.][^/\\]*(/[^\s/\\.][^/\\]*)*")


class PlaceSource(StrEnum):
    """Source of the place of a panorama.

    COLUMN: a column or field of the format. REGION: the room of a building model, or the region of the floor masks.
    FOLDER: the folder of the picture. NONE: no place is known, and each reference panorama is a place of its own, named
    by its id.
    """

    COLUMN = "column"
    REGION = "region"
    FOLDER = "folder"
    NONE = "none"


@dataclass(frozen=True)
class ImageFiles:
    """Equirectangular image files of a panorama, which are copied without a change.

    Attributes:
        rgb: JPEG or PNG file.
        range: 16-bit PNG file.
        valid: PNG file, black where the panorama has no image.
        encoding: Encoding of the values of the range image.
    """

    rgb: Path | None = None
    range: Path | None = None
    valid: Path | None = None
    encoding: RangeEncoding = field(default_factory=RangeEncoding)

    @property
    def by_part(self) -> dict[str, Path]:
        """Mapping from the part of a panorama, such as "rgb", to its image file."""
        files = {"rgb": self.rgb, "range": self.range, "valid": self.valid}
        return {part: path for part, path in files.items() if path is not None}


@dataclass(frozen=True, eq=False)
class PanoramaRecord:
    """A panorama of a recording. Its images are read when `load` is called.

    Attributes:
        id: Id of the frame, and the path of its images without file extension. Folders are separated by "/".
        images: The image files, or a function that reads and stitches the panorama. The function raises DataError if
            it cannot. Its panorama has the parts in `parts`, and the `notes` of the panorama are reported.
        parts: Parts of the panorama, a subset of IMPORTED_PARTS. If there are image files, they determine the parts.
        T_world_pano: (4, 4) pose in metres, world z up. None if it is unknown: the panorama is then a query.
        places: PlaceSource -> name of the place that this source states. Empty if no source states a place.
        t_s: Time of the recording in seconds; None if it is unknown.
        is_query: Whether the panorama is a query although its pose is known. The pose is then its truth.
        sequence: Name that the views of one query share, in the order of `t_s`; None for single panoramas.
        sources: Files that the panorama is made from. A stored panorama is made again if one of them is newer.

    Raises:
        DataError: The id is not a relative path, a part is unknown, the pose is not a rigid motion, or a view of a
            sequence has no time.
    """

    id: str
    images: ImageFiles | Callable[[], Panorama]
    parts: frozenset[str] = frozenset()
    T_world_pano: np.ndarray | None = None
    places: Mapping[PlaceSource, str] = field(default_factory=dict)
    t_s: float | None = None
    is_query: bool = False
    sequence: str | None = None
    sources: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        if not _ID.fullmatch(self.id):
            raise DataError(f"a panorama has the id {self.id!r}, expected a relative path without '..' and '\\'")
        if isinstance(self.images, ImageFiles):
            files = self.images.by_part
            object.__setattr__(self, "parts", frozenset(files))
            object.__setattr__(self, "sources", (*self.sources, *files.values()))
        if not self.parts or not self.parts <= IMPORTED_PARTS or self.parts == {"valid"}:
            received, expected = (
                f"the parts {', '.join(sorted(self.parts))}" if self.parts else "no image",
                ", ".join(sorted(IMPORTED_PARTS - {"valid"})),
            )
            raise DataError(
                f"the panorama {self.id} has {received}, expected at least one of {expected} (the mask "
                "`valid` is optional)"
            )
        if self.T_world_pano is not None:
            check_pose(self, f"the panorama {self.id}")
        if self.sequence is not None and self.t_s is None:
            raise DataError(
                f"the view {self.id} of the sequence {self.sequence!r} has no `t_s`, expected its time in seconds"
            )

    @property
    def is_reference(self) -> bool:
        """Whether the panorama can be a reference frame: its pose is known, and it is neither a query nor a view."""
        return self.T_world_pano is not None and not self.is_query and self.sequence is None

    def load(self) -> Panorama:
        """Read or stitch the panorama.

        Raises:
            DataError: The panorama cannot be read, or lacks a part that the record declares.
        """
        if not isinstance(self.images, ImageFiles):
            panorama = self.images()
            present = panorama.provides | ({"valid"} if panorama.valid is not None else set())
            if missing := self.parts - present:
                raise DataError(
                    f"the importer returned the panorama {self.id} without {' and '.join(sorted(missing))}, which it "
                    "had declared for this panorama: correct the importer"
                )
            return panorama
        files = self.images
        return load_panorama(
            self.id, rgb=files.rgb, range_image=files.range, valid=files.valid, encoding=files.encoding
        )


@dataclass(frozen=True, eq=False)
class Recording:
    """The panoramas of a recording.

    Attributes:
        records: The panoramas, in the order of the recording.
        odometry: (N, 5) float64 rows of the poses of the camera in any fixed frame with z up, as in odometry.csv: t_s,
            x_m, y_m, z_m, yaw_deg; None without sequences.
        objects: Columns of the table of objects, with `instance_id` and `label`; None without annotations.
        notes: Warnings about the recording, one line each, such as the numbers of images that were left out.

    Raises:
        DataError: There is no panorama, two panoramas have the same id, or the odometry has another shape.
    """

    records: tuple[PanoramaRecord, ...]
    odometry: np.ndarray | None = None
    objects: Mapping[str, Sequence[Any]] | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.records:
            raise DataError("the recording has no panorama, expected at least one")
        ids: set[str] = set()
        for record in self.records:
            if record.id in ids:
                raise DataError(f"two panoramas of the recording have the id {record.id}, expected unique ids")
            ids.add(record.id)
        if self.odometry is not None:
            check_array(self, "odometry", np.float64, None, 5)


class Importer(Role):
    """Converts recordings of other formats, such as ROS bags, to panoramas with poses, times and places."""

    role = "importer"
    word: ClassVar[str] = "format"

    @abstractmethod
    def read(self, source: Path) -> Recording:
        """Return the panoramas of a recording. Their images are read later, one at a time.

        Args:
            source: The folder or file of the recording.

        Raises:
            DataError: The source is missing or is not a recording of this format. The message is one line.
        """

    def read_views(self, source: Path) -> Recording:
        """Return the views of a moving camera as one sequence, for `track`.

        All records have `t_s`, and `odometry` has a row at the time of each record. `T_world_pano` of a record is its
        true pose in the world frame of maps, not in the frame of the odometry. None if it is unknown.

        Args:
            source: As in `read`.

        Raises:
            DataError: As in `read`, or the format has no odometry.
        """
        raise DataError(
            f"recordings in the format {self.name} have no odometry (measured camera motion), expected a format with "
            "odometry such as rosbag, or a folder of panoramas with a sequence"
        )
