"""`cubemap`: six faces of a cube with a table of poses."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat, field_validator

from salframe.framework.errors import DataError
from salframe.panoramas import images
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import sample_nearest
from salframe.panoramas.importer import Importer, PanoramaRecord, PlaceSource, Recording
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_encoding import MAX_STEP, MILLIMETRE, RangeEncoding, RangeKind
from salframe.panoramas.stitching import AGREEING, PosedCamera
from salframe_import.pose_table import PoseRow, PoseSettings, read_pose_table
from salframe_import.stations import PosedImage, read_depth, station_record

FACES = ("front", "right", "back", "left", "up", "down")
"""Faces in the order of the setting `faces`."""
_FORWARD, _LEFT, _UP = np.eye(3)
_AXES = {
    "front": (-_LEFT, -_UP, _FORWARD),
    "right": (-_FORWARD, -_UP, -_LEFT),
    "back": (_LEFT, -_UP, -_FORWARD),
    "left": (_FORWARD, -_UP, _LEFT),
    "up": (-_LEFT, _FORWARD, _UP),
    "down": (-_LEFT, -_FORWARD, -_UP),
}
"""Right, down and forward axis of each face in the panorama frame. The lower edge of the face "up" and the upper edge
of the face "down" touch the face "front"."""
MIN_SEAM_AGREEMENT, MAX_SEAM_GREY = 0.8, 24.0
"""Minimum share of the points on the edges of the cube at which the two faces agree, and maximum difference of grey
values that agree."""
SEAMS = (
    "the faces do not join at the edges of the cube: check the order of the setting faces, the rotation of the face "
    "images, and the settings depth_unit_m and depth_kind"
)


class CubemapImporter(Importer):
    """Cubemaps: six faces of 90 degrees as colour images, with optional depth images and a table of poses, poses.csv.

    The poses table has a column `picture` with the name of the cubemap. The file names of the faces contain this name
    too.
    The other columns are those of the importer `pictures`. Cubemaps that are not in the table are queries.
    """

    name = "cubemap"
    version = "1"

    class Config(PoseSettings):
        height: int = Field(
            512, ge=64, le=4096, description="height of a panorama in pixels; its width is twice the height"
        )
        picture: str = Field(
            "{name}_{face}.jpg",
            description="pattern of the file names of the colour images: {name} stands for the name of the cubemap, "
            "{face} for the name of the face",
        )
        depth: str = Field(
            "{name}_{face}.depth.png",
            description="pattern of the file names of the depth images, with {name} and {face} as in `picture`; "
            "cubemaps without depth images are imported without range",
        )
        faces: tuple[str, str, str, str, str, str] = Field(
            FACES,
            description="names of the six faces in the file names, in the order front, right, back, left, up, down",
        )
        depth_unit_m: PositiveFloat = Field(
            MILLIMETRE, description="length (m) of one unit of a depth image (0.001: the values are in millimetres)"
        )
        depth_missing: tuple[Annotated[int, Field(ge=0, le=MAX_STEP)], ...] = Field(
            (), description="list of the values of a depth image that mean an unknown depth, in addition to 0"
        )
        depth_kind: Literal["z", "ray"] = Field(
            "z",
            description="quantity that a depth image contains. z: depth along the axis of the face; ray: distance "
            "along the ray",
        )

        @field_validator("picture", "depth")
        @classmethod
        def _has_fields(cls, pattern: str) -> str:
            if pattern.count("{name}") != 1 or pattern.count("{face}") != 1 or pattern.count("{") != 2:
                raise ValueError(
                    f"received {pattern!r}, expected a pattern such as {{name}}_{{face}}.png, with each field once"
                )
            return pattern

    def read(self, source: Path) -> Recording:
        if not source.is_dir():
            raise DataError(f"{source} is not a folder, expected a folder of cubemaps with {self.config.poses}")
        rows = read_pose_table(source / self.config.poses, self.config)
        front = self.config.picture.replace("{face}", self.config.faces[0])
        start, end = front.split("{name}")
        paths = source.rglob(f"{start}*{end}" if "/" not in start else f"*{end}")
        relative = [path.relative_to(source).as_posix() for path in paths]
        names = {name.removeprefix(start).removesuffix(end) for name in relative}
        if not names:
            raise DataError(
                f"{source} has no file {front} ({{name}} stands for the name of a cubemap), expected the front face of "
                "at least one cubemap: check the settings `picture` and `faces`"
            )
        missing = sorted(rows.keys() - names)
        notes = []
        if missing:
            example = front.replace("{name}", missing[0])
            notes.append(
                f"{len(missing)} of {len(rows)} rows of {self.config.poses} name a cubemap that does not exist (such "
                f"as {example})"
            )
        records = tuple(self._record(source, name, rows.get(name)) for name in sorted(names))
        return Recording(records, notes=tuple(notes))

    def _record(self, source: Path, name: str, row: PoseRow | None) -> PanoramaRecord:
        pose = np.eye(4) if row is None else row.T_world_pano
        has_depth = (source / self._file(self.config.depth, name, self.config.faces[0])).exists()
        encoding = RangeEncoding(self.config.depth_unit_m, self.config.depth_missing, RangeKind(self.config.depth_kind))
        places = {} if row is None else dict(row.places)
        if (folder := Path(name).parent.as_posix()) != ".":
            places[PlaceSource.FOLDER] = folder
        faces = []
        for face, spelling in zip(FACES, self.config.faces, strict=True):
            picture = source / self._file(self.config.picture, name, spelling)
            depth = source / self._file(self.config.depth, name, spelling)
            lens = Camera.of_field_of_view(512, 512, 90.0)
            T_pano_camera = np.eye(4)
            T_pano_camera[:3, :3] = np.stack(_AXES[face], 1)
            faces.append(
                PosedImage(
                    str(picture),
                    PosedCamera(lens, pose @ T_pano_camera),
                    partial(images.read_color, picture),
                    partial(read_depth, depth, encoding, lens) if has_depth else None,
                    None if row is None else row.t_s,
                    places=places,
                    sources=(picture, depth) if has_depth else (picture,),
                )
            )
        return station_record(
            name, faces, self.config.height, T_world_pano=pose, is_posed=row is not None, check=seam_note
        )

    @staticmethod
    def _file(pattern: str, name: str, face: str) -> str:
        return pattern.replace("{name}", name).replace("{face}", face)


def seam_note(panorama: Panorama) -> str | None:
    """Return a warning if neighbouring faces of a cubemap do not join at their common edges; None if they do.

    The grey values and the ranges on both sides of the twelve edges are compared.

    Args:
        panorama: The panorama. Its axes are the axes of the cube.
    """
    step = 3.0 / len(np.asarray(panorama.rgb))
    along = np.linspace(-0.95, 0.95, 41)
    first, second = [], []
    for axis in range(3):
        one, two = np.delete(np.eye(3), axis, 0)
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            edge = along[:, None] * np.eye(3)[axis] + signs[0] * one + signs[1] * two
            first.append(edge + step * signs[0] * one)
            second.append(edge + step * signs[1] * two)
    rays = [np.concatenate(side) for side in (first, second)]
    grey = [sample_nearest(np.asarray(panorama.rgb), side).mean(-1) for side in rays]
    shares = [float((np.abs(grey[0] - grey[1]) <= MAX_SEAM_GREY).mean())]
    if panorama.range_m is not None:
        one_m, other_m = (sample_nearest(panorama.range_m, side) for side in rays)
        is_known = np.isfinite(one_m) & np.isfinite(other_m)
        agrees = np.abs(one_m - other_m) <= 2 * AGREEING * np.fmax(one_m, other_m)
        shares += [float(agrees[is_known].mean())] if is_known.any() else []
    if min(shares) >= MIN_SEAM_AGREEMENT:
        return None
    return SEAMS
