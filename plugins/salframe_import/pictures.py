"""`pictures`: equirectangular pictures with a table of poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, PositiveFloat

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_csv_numbers, read_csv_texts
from salframe.panoramas.importer import ImageFiles, Importer, PanoramaRecord, PlaceSource, Recording
from salframe.panoramas.pose_conventions import PoseConvention, convert_pose
from salframe.panoramas.range_encoding import MAX_STEP, MILLIMETRE, RangeEncoding, RangeKind

PICTURES = (".jpg", ".jpeg", ".png")
RANGE, VALID, OBJECTS = ".range.png", ".valid.png", ".objects.png"
"""Endings of range images, of masks, and of pictures that `show-objects` writes."""
POSITION, ANGLES = ("x_m", "y_m", "z_m", "yaw_deg"), ("roll_deg", "pitch_deg", "t_s")
"""Columns with numbers: required, and optional."""


class PictureImporter(Importer):
    """Equirectangular pictures, with range images NAME.range.png, and the table poses.csv. Pictures without a row are
    queries.

    The table has the columns picture, x_m, y_m, z_m and yaw_deg, and optionally place, roll_deg, pitch_deg and t_s. The
    angles are those of a camera with x forward, y left and z up: it is turned by the yaw, the pitch and the roll.
    """

    name = "pictures"
    version = "1"

    class Config(ComponentConfig):
        poses: str = Field("poses.csv", min_length=1, description="name of the table of poses in the folder")
        pose_convention: PoseConvention = Field(
            "ros", description="convention of the poses, such as compass for headings clockwise from north"
        )
        position_unit_m: PositiveFloat = Field(1.0, description="unit of the positions in metres")
        range_unit_m: PositiveFloat = Field(MILLIMETRE, description="metres per step of a range image")
        range_missing: tuple[Annotated[int, Field(ge=0, le=MAX_STEP)], ...] = Field(
            (), description="values of a range image that mean no reading, besides 0"
        )
        range_kind: RangeKind = Field(
            RangeKind.RAY, description="what a range image stores: ray, or cube for z-depth of stitched cube faces"
        )

    def read(self, source: Path) -> Recording:
        encoding = RangeEncoding(self.config.range_unit_m, self.config.range_missing, self.config.range_kind)
        encoding.check_panorama()
        if not source.is_dir():
            raise DataError(f"{source} is not a folder, expected a folder of pictures with {self.config.poses}")
        poses, places, times = self._read_table(source / self.config.poses)
        names = {path.relative_to(source).as_posix() for path in source.rglob("*") if _is_picture(path)}
        records = [
            self._record(source, name, encoding, poses.get(name), places.get(name), times.get(name))
            for name in sorted(names | poses.keys())
        ]
        return Recording(tuple(records))

    def _record(
        self,
        source: Path,
        name: str,
        encoding: RangeEncoding,
        pose: np.ndarray | None,
        place: str | None,
        t_s: float | None,
    ) -> PanoramaRecord:
        picture = source / name
        range_image, valid = (picture.with_suffix(ending) for ending in (RANGE, VALID))
        places = {} if place is None else {PlaceSource.COLUMN: place}
        if (folder := Path(name).parent.as_posix()) != ".":
            places[PlaceSource.FOLDER] = folder
        return PanoramaRecord(
            Path(name).with_suffix("").as_posix(),
            ImageFiles(
                picture, range_image if range_image.exists() else None, valid if valid.exists() else None, encoding
            ),
            T_world_pano=pose,
            places=places,
            t_s=t_s,
        )

    def _read_table(self, path: Path) -> tuple[dict[str, np.ndarray], dict[str, str], dict[str, float]]:
        """Return poses, places and times by the name of the picture. Raises DataError."""
        from scipy.spatial.transform import Rotation

        texts = read_csv_texts(path, ("picture",), ("place",))
        numbers = read_csv_numbers(path, POSITION, ANGLES)
        names = [Path(text.strip()).as_posix() for text in texts["picture"]]
        if repeated := [name for number, name in enumerate(names) if name in names[:number]]:
            raise DataError(f"{path} has two rows of the picture {repeated[0]}, expected one")
        poses = {}
        for name, row in zip(names, numbers, strict=True):
            pose = np.eye(4)
            angles_deg = np.nan_to_num(row[[3, 5, 4]])
            pose[:3, :3] = Rotation.from_euler("ZYX", angles_deg, degrees=True).as_matrix()
            pose[:3, 3] = row[:3]
            poses[name] = convert_pose(pose, self.config.pose_convention, self.config.position_unit_m)
        places = dict(zip(names, (text.strip() for text in texts.get("place", ())), strict=False))
        times = {name: float(row[6]) for name, row in zip(names, numbers, strict=True) if np.isfinite(row[6])}
        return poses, {name: place for name, place in places.items() if place}, times


def _is_picture(path: Path) -> bool:
    """Return whether a file is a picture, and no range image, mask or picture of detections."""
    name = path.name.lower()
    return name.endswith(PICTURES) and not name.endswith((RANGE, VALID, OBJECTS)) and not name.startswith(".")
