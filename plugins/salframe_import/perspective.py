"""`perspective`: posed images of pinhole or fisheye cameras, in the transforms.json of nerfstudio and instant-ngp."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, Field, PositiveFloat

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_as
from salframe.panoramas import images
from salframe.panoramas.camera import LEVEL, Camera, DistortionModel
from salframe.panoramas.frames import POSE_TOLERANCE
from salframe.panoramas.geometry import is_rigid
from salframe.panoramas.importer import Importer, PlaceSource, Recording
from salframe.panoramas.pose_conventions import PoseConvention, convert_pose
from salframe.panoramas.range_encoding import MAX_STEP, MILLIMETRE, RangeEncoding, RangeKind
from salframe.panoramas.stitching import PosedCamera
from salframe_import.stations import (
    PosedImage,
    StationSettings,
    check_upright,
    group_by_motion,
    group_by_station,
    group_by_time,
    other_conventions,
    read_depth,
    station_record,
    thinned,
)

Number = Annotated[float, Field(allow_inf_nan=False)]
_MODELS = {
    "OPENCV": DistortionModel.PLUMB_BOB,
    "OPENCV_FISHEYE": DistortionModel.FISHEYE,
    "PINHOLE": DistortionModel.NONE,
    "SIMPLE_PINHOLE": DistortionModel.NONE,
    "perspective": DistortionModel.PLUMB_BOB,
}
"""Mapping from the camera_model of the file to the distortion model."""


class _Intrinsics(BaseModel):
    """Intrinsics of all frames or of one frame. The centre of the first pixel is at (0.5, 0.5), as in COLMAP."""

    camera_model: str | None = None
    w: int | None = None
    h: int | None = None
    fl_x: Number | None = None
    fl_y: Number | None = None
    cx: Number | None = None
    cy: Number | None = None
    camera_angle_x: Number | None = None
    k1: Number | None = None
    k2: Number | None = None
    k3: Number | None = None
    k4: Number | None = None
    p1: Number | None = None
    p2: Number | None = None


class _FrameOfFile(_Intrinsics):
    file_path: str
    depth_file_path: str | None = None
    transform_matrix: tuple[tuple[Number, Number, Number, Number], ...] = Field(min_length=3, max_length=4)
    station: str | None = None
    place: str | None = None
    time: Number | None = None


class _Transforms(_Intrinsics):
    frames: tuple[_FrameOfFile, ...]


class PerspectiveImporter(Importer):
    """Perspective images with poses, intrinsics and optional depth, from a transforms.json in the format of nerfstudio.

    The source is the folder that contains transforms.json. The images of one station (a position of the camera) are
    stitched to one panorama. Each entry of `frames` in this file may have the additional keys station, place and time.
    Lens distortion is removed.
    """

    name = "perspective"
    version = "1"

    class Config(StationSettings):
        transforms: str = Field(
            "transforms.json",
            min_length=1,
            description="name of the JSON file that lists the images, in the imported folder",
        )
        pose_convention: PoseConvention = Field(
            "opengl-z-up",
            description="convention of transform_matrix: the axes of world and camera, and the direction of the "
            "transformation; `salframe docs folder-format` explains each value. nerfstudio uses opengl-z-up",
        )
        position_unit_m: PositiveFloat = Field(
            1.0, description="length (m) of one unit of the positions (0.001: the positions are in millimetres)"
        )
        depth_unit_m: PositiveFloat = Field(
            MILLIMETRE, description="length (m) of one unit of a depth image (0.001: the values are in millimetres)"
        )
        depth_missing: tuple[Annotated[int, Field(ge=0, le=MAX_STEP)], ...] = Field(
            (), description="list of the values of a depth image that mean an unknown depth, in addition to 0"
        )
        depth_kind: Literal["z", "ray"] = Field(
            "z",
            description="quantity that a depth image contains. z: depth along the optical axis; ray: distance along "
            "the ray",
        )
        group_by: Literal["auto", "station", "time", "motion"] = Field(
            "auto",
            description="images that are stitched to one panorama. station: images with the same value of the key "
            "station; time: consecutive images with gaps of at most max_gap_s; motion: successive images of a camera "
            "that turns without moving away; auto: station if a frame has the key station, otherwise motion",
        )
        max_gap_s: PositiveFloat = Field(
            1.0, description="maximum time (s) between consecutive images of one panorama. Only used if group_by=time"
        )

    def read(self, source: Path) -> Recording:
        path = source / self.config.transforms if source.is_dir() else source
        content: _Transforms = read_as(path, _Transforms)
        if not content.frames:
            raise DataError(f"{path}: the list `frames` is empty, expected at least one frame")
        raw = [self._matrix(path, frame) for frame in content.frames]
        self._check_axes(raw)
        folders = {Path(frame.file_path).parent for frame in content.frames}
        posed = [
            self._image(path, content, frame, pose, has_folders=len(folders) > 1)
            for frame, pose in zip(content.frames, raw, strict=True)
        ]
        groups, note = self._groups(posed)
        records = (
            station_record(id, thinned(group, self.config.min_step_deg), self.config.height, (path,))
            for id, group in groups.items()
        )
        return Recording(tuple(records), notes=(note,) if note else ())

    def _groups(self, posed: list[PosedImage]) -> tuple[dict[str, list[PosedImage]], str | None]:
        group_by = self.config.group_by
        if group_by == "station" or (group_by == "auto" and any(image.station is not None for image in posed)):
            return group_by_station(posed), None
        if group_by == "time":
            return group_by_time(posed, self.config.max_gap_s), None
        return group_by_motion(posed, self.config)

    def _matrix(self, path: Path, frame: _FrameOfFile) -> np.ndarray:
        pose = np.eye(4)
        pose[: len(frame.transform_matrix)] = frame.transform_matrix
        if not is_rigid(pose, POSE_TOLERANCE):
            raise DataError(
                f"{path}: the transform_matrix of {frame.file_path} is not a rigid motion, expected a rotation "
                "without scale or reflection, a translation, and the last row 0 0 0 1"
            )
        return pose

    def _camera_pose(self, raw: np.ndarray, convention: PoseConvention) -> np.ndarray:
        return convert_pose(raw, convention, self.config.position_unit_m) @ LEVEL

    def _check_axes(self, raw: list[np.ndarray]) -> None:
        convention = self.config.pose_convention
        others = {
            f"pose_convention={name}": [self._camera_pose(pose, name) for pose in raw]  # type: ignore[arg-type]
            for name in other_conventions(convention)
        }
        check_upright([self._camera_pose(pose, convention) for pose in raw], others)

    def _image(
        self, path: Path, content: _Transforms, frame: _FrameOfFile, raw: np.ndarray, *, has_folders: bool
    ) -> PosedImage:
        picture = path.parent / frame.file_path
        depth = None if frame.depth_file_path is None else path.parent / frame.depth_file_path
        lens = _camera(path, content, frame, picture)
        places = {} if frame.place is None else {PlaceSource.COLUMN: frame.place}
        if has_folders:
            places[PlaceSource.FOLDER] = Path(frame.file_path).parent.as_posix()
        encoding = RangeEncoding(self.config.depth_unit_m, self.config.depth_missing, RangeKind(self.config.depth_kind))
        return PosedImage(
            str(picture),
            PosedCamera(lens, self._camera_pose(raw, self.config.pose_convention)),
            partial(images.read_color, picture),
            None if depth is None else partial(read_depth, depth, encoding, lens),
            frame.time,
            frame.station,
            places,
            (picture,) if depth is None else (picture, depth),
        )


def _camera(path: Path, content: _Transforms, frame: _FrameOfFile, picture: Path) -> Camera:
    """Return the camera of a frame. Intrinsics that the frame lacks are taken from the file.

    Raises:
        DataError: The focal length is missing, or the camera model or a value is not supported.
    """
    names = _Intrinsics.model_fields
    values = {name: getattr(content, name) if getattr(frame, name) is None else getattr(frame, name) for name in names}
    if values["w"] is None or values["h"] is None:
        values["h"], values["w"] = images.read_color(picture).shape[:2]
    width, height = values["w"], values["h"]
    if values["fl_x"] is None and values["camera_angle_x"] is not None:
        values["fl_x"] = width / 2 / np.tan(values["camera_angle_x"] / 2)
    if values["fl_x"] is None:
        raise DataError(
            f"{path} has neither fl_x nor camera_angle_x for {frame.file_path}, expected one of them for the focal "
            "length"
        )
    fx = float(values["fl_x"])
    fy = fx if values["fl_y"] is None else float(values["fl_y"])
    cx, cy = (
        size / 2 if value is None else float(value) for value, size in ((values["cx"], width), (values["cy"], height))
    )
    kind = values["camera_model"] or "OPENCV"
    if kind not in _MODELS:
        other = (
            ": import equirectangular pictures with `salframe data import pictures`"
            if kind == "EQUIRECTANGULAR"
            else ""
        )
        raise DataError(f"{path} has the camera_model {kind!r}, expected one of {', '.join(_MODELS)}{other}")
    k1, k2, k3, k4, p1, p2 = (float(values[name] or 0.0) for name in ("k1", "k2", "k3", "k4", "p1", "p2"))
    model = _MODELS[kind]
    distortion = {
        DistortionModel.NONE: (),
        DistortionModel.FISHEYE: (k1, k2, k3, k4),
        DistortionModel.PLUMB_BOB: (k1, k2, p1, p2, k3),
    }[model]
    if model is DistortionModel.PLUMB_BOB and k4:
        raise DataError(f"{path} has k4 = {k4:g} for the camera_model {kind}, expected k4 = 0")
    try:
        return Camera(width, height, fx, fy, cx - 0.5, cy - 0.5, model, distortion)
    except DataError as error:
        raise DataError(f"{path}: {frame.file_path}: {error}") from None
