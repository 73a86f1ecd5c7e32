"""`pictures`: equirectangular pictures with a table of poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, PositiveFloat

from salframe.framework.errors import DataError
from salframe.panoramas.importer import ImageFiles, Importer, PanoramaRecord, PlaceSource, Recording
from salframe.panoramas.range_encoding import MAX_STEP, MILLIMETRE, RangeEncoding, RangeKind
from salframe_import.pose_table import PoseRow, PoseSettings, read_pose_table

PICTURES = (".jpg", ".jpeg", ".png")
RANGE, VALID, OBJECTS = ".range.png", ".valid.png", ".objects.png"
"""Endings of range images, of masks of valid pixels, and of the pictures that `show-objects` writes."""


class PictureImporter(Importer):
    """Equirectangular pictures, with optional range images NAME.range.png and a table of poses, poses.csv.

    The table has the columns picture, x_m, y_m, z_m and yaw_deg, and optionally place, roll_deg, pitch_deg and t_s. The
    camera has x forward, y left and z up. Its rotation is the yaw about z, then the pitch about the new y, then the
    roll about the new x. The columns qx, qy, qz and qw (a quaternion) can replace the angles. Pictures that are not in
    the table are queries.
    """

    name = "pictures"
    version = "1"

    class Config(PoseSettings):
        range_unit_m: PositiveFloat = Field(
            MILLIMETRE, description="length (m) of one unit of a range image (0.001: the values are in millimetres)"
        )
        range_missing: tuple[Annotated[int, Field(ge=0, le=MAX_STEP)], ...] = Field(
            (), description="list of the values of a range image that mean an unknown range, in addition to 0"
        )
        range_kind: RangeKind = Field(
            RangeKind.RAY,
            description="quantity that a range image contains. ray: distance along the ray; cube: depth along the "
            "axis of the cube face that shows the pixel, for pictures stitched from cube faces; z: not allowed, "
            "because a panorama has no optical axis",
        )

    def read(self, source: Path) -> Recording:
        encoding = RangeEncoding(self.config.range_unit_m, self.config.range_missing, self.config.range_kind)
        encoding.check_panorama()
        if not source.is_dir():
            raise DataError(f"{source} is not a folder, expected a folder of pictures with {self.config.poses}")
        rows = read_pose_table(source / self.config.poses, self.config)
        names = {path.relative_to(source).as_posix() for path in source.rglob("*") if _is_picture(path)}
        missing = sorted(rows.keys() - names)
        notes = []
        if missing:
            notes.append(
                f"{len(missing)} of {len(rows)} rows of {self.config.poses} name a picture that does not exist (such "
                f"as {missing[0]}), expected file names with their suffix; upper and lower case are different"
            )
        records = tuple(_record(source, name, encoding, rows.get(name)) for name in sorted(names))
        return Recording(records, notes=tuple(notes))


def _record(source: Path, name: str, encoding: RangeEncoding, row: PoseRow | None) -> PanoramaRecord:
    """Return the record of a picture."""
    picture = source / name
    range_image, valid = (
        path if path.exists() else None for path in (picture.with_suffix(RANGE), picture.with_suffix(VALID))
    )
    places = {} if row is None else dict(row.places)
    if (folder := Path(name).parent.as_posix()) != ".":
        places[PlaceSource.FOLDER] = folder
    return PanoramaRecord(
        Path(name).with_suffix("").as_posix(),
        ImageFiles(picture, range_image, valid, encoding),
        T_world_pano=None if row is None else row.T_world_pano,
        places=places,
        t_s=None if row is None else row.t_s,
    )


def _is_picture(path: Path) -> bool:
    """Return whether a file is a colour picture, and not a range image, a mask or a picture of detections."""
    name = path.name.lower()
    return name.endswith(PICTURES) and not name.endswith((RANGE, VALID, OBJECTS)) and not name.startswith(".")
