"""`colmap`: a model of COLMAP with its pictures."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.errors import ConfigError, DataError, describe_error
from salframe.panoramas.camera import LEVEL, Camera
from salframe.panoramas.camera_height import PLAUSIBLE_M
from salframe.panoramas.geometry import invert_pose
from salframe.panoramas.images import read_color
from salframe.panoramas.importer import ImageFiles, Importer, PanoramaRecord, PlaceSource, Recording
from salframe.panoramas.range_encoding import MILLIMETRE, RangeEncoding, RangeKind
from salframe.panoramas.stitching import PosedCamera
from salframe_import.colmap_model import Model, ModelPicture, find_model, read_model
from salframe_import.colmap_world import floor_height, up_direction, upright_rotation
from salframe_import.stations import PosedImage, StationSettings, group_by_motion, read_depth, station_record, thinned

DENSE_SUFFIXES = (".geometric.bin", ".photometric.bin")
"""Suffixes of the depth maps that COLMAP computes, in order of preference."""


class ColmapImporter(Importer):
    """COLMAP models (text or binary) with equirectangular cameras, other cameras, or rigs of cameras.

    The world is rotated so that the mean up direction of the pictures becomes z. The pictures that a rig took at the
    same time are stitched to one panorama.
    """

    name = "colmap"
    version = "1"
    requires = ("pycolmap",)
    extra = "salframe[colmap]"

    class Config(StationSettings):
        scale: float | None = Field(
            None,
            gt=0,
            allow_inf_nan=False,
            description="length (m) of one unit of the COLMAP model. Set either scale or camera_height, not both",
        )
        camera_height: float | None = Field(
            None,
            gt=0,
            le=100,
            description="median height (m) of the cameras above the floor, which determines the scale of the COLMAP "
            "model. The floor is detected in the points of the model, and gets z = 0. Set either scale or "
            "camera_height, not both",
        )
        images: str | None = Field(
            None,
            min_length=1,
            description="path of the folder with the pictures; null: the folder `images` in the folder of the model, "
            "or in one of the two folders above it",
        )
        depth: str | None = Field(
            None,
            min_length=1,
            description="path of a folder with depth images: 16-bit PNG files with the names of the pictures, or the "
            "folder stereo/depth_maps of COLMAP; null: no depth is imported",
        )
        depth_unit_m: float = Field(
            MILLIMETRE,
            gt=0,
            description="length (m) of one unit of a PNG depth image (0.001: the values are in millimetres)",
        )
        depth_kind: Literal["ray", "z", "cube"] | None = Field(
            None,
            description="quantity that a PNG depth image contains. ray: distance along the ray; z: depth along the "
            "optical axis; cube: depth along the axis of the face, for equirectangular pictures that were stitched "
            "from the faces of a cube; null: ray for "
            "equirectangular pictures, z for other pictures",
        )
        group_by: Literal["frame", "motion"] = Field(
            "frame",
            description="pictures that are stitched to one panorama. frame: pictures that a rig of cameras took at "
            "the same time; motion: successive pictures of a camera that turns without moving away, in the order of "
            "their names",
        )

    def read(self, source: Path) -> Recording:
        folder = find_model(source)
        model = read_model(folder)
        world, notes = self._world(model)
        images = _image_folder(None if self.config.images is None else Path(self.config.images), folder)
        if num_unused := _num_unused(images, model):
            notes.append(f"{num_unused} pictures in {images} are left out: the COLMAP model has no pose for them")
        frames: dict[int, list[ModelPicture]] = {}
        for picture in model.pictures:
            frames.setdefault(picture.frame, []).append(picture)
        pictures = _Pictures(images, world, self.config)
        if self.config.group_by == "motion":
            groups, note = group_by_motion([pictures.posed(picture) for picture in model.pictures], self.config)
            records = [
                station_record(id, thinned(group, self.config.min_step_deg), self.config.height)
                for id, group in groups.items()
            ]
            return Recording(tuple(records), notes=(*notes, *([note] if note else [])))
        return Recording(tuple(pictures.record(frame) for frame in frames.values()), notes=tuple(notes))

    def _world(self, model: Model) -> tuple[ModelWorld, list[str]]:
        """Return the transformation from the model to a world in metres with z up, and notes for the user."""
        config = self.config
        if (config.scale is None) == (config.camera_height is None):
            received = "neither scale nor" if config.scale is None else "both scale and"
            raise ConfigError(
                f"received {received} camera_height, expected exactly one: a COLMAP model has no unit. Measure the "
                "height of the camera and pass --set camera_height=METRES, or pass --set scale=METRES_PER_UNIT"
            )
        poses = [picture.T_model_camera for picture in model.pictures]
        rotation = upright_rotation(up_direction(poses))
        cameras_z = np.array([rotation[2] @ pose[:3, 3] for pose in poses])
        points_z = model.points @ rotation[2]
        low_m, high_m = PLAUSIBLE_M
        if config.camera_height is not None:
            floor_z = floor_height(points_z, cameras_z)
            scale = config.camera_height / (float(np.median(cameras_z)) - floor_z)
            note = (
                f"scale: {scale:.4g} m per unit of the model, computed from the camera height of "
                f"{config.camera_height:g} m above the floor"
            )
            if not low_m <= config.camera_height <= high_m:
                note += f". Expected a camera height of {low_m:g} to {high_m:g} m: check camera_height"
            return ModelWorld(rotation, scale, floor_z), [note]
        world = ModelWorld(rotation, config.scale)
        try:
            height_m = config.scale * (float(np.median(cameras_z)) - floor_height(points_z, cameras_z))
        except DataError:  # no floor in the points: the scale cannot be checked
            return world, []
        if low_m <= height_m <= high_m:
            return world, []
        return world, [
            f"the cameras are {height_m:.3g} m above the floor of the model, expected {low_m:g} to {high_m:g} m: check "
            "scale, or set camera_height instead of scale"
        ]


@dataclass(frozen=True, eq=False)
class ModelWorld:
    """The transformation from the world of a model to a world in metres with z up.

    Attributes:
        rotation: (3, 3) from the axes of the model to z up.
        scale: Metres per unit of the model.
        zero_z: Height after the rotation, in the unit of the model, that becomes z = 0.
    """

    rotation: np.ndarray
    scale: float
    zero_z: float = 0.0

    def pose(self, T_model_camera: np.ndarray) -> np.ndarray:
        """Return the pose (4, 4) of a camera in metres."""
        T = np.eye(4)
        T[:3, :3] = self.rotation @ T_model_camera[:3, :3]
        T[:3, 3] = (self.rotation @ T_model_camera[:3, 3] - (0, 0, self.zero_z)) * self.scale
        return T


@dataclass(frozen=True, eq=False)
class _Pictures:
    """The pictures of a model, with their depth."""

    folder: Path
    world: ModelWorld
    config: ColmapImporter.Config

    def record(self, pictures: list[ModelPicture]) -> PanoramaRecord:
        """Return the panorama of the pictures that one rig, or one camera, took at the same time.

        Raises:
            DataError: A depth image is missing, or a rig has an equirectangular camera and others.
        """
        names = [Path(picture.name) for picture in pictures]
        folder = Path(os.path.commonpath([name.parent for name in names]))
        stems = {name.stem for name in names}
        id = (folder / stems.pop() if len(stems) == 1 else names[0].with_suffix("")).as_posix()
        places = {} if folder == Path() else {PlaceSource.FOLDER: folder.as_posix()}
        if all(picture.camera is not None for picture in pictures):
            record = station_record(id, [self.posed(picture) for picture in pictures], self.config.height)
            return replace(record, places=places)
        if len(pictures) > 1:
            raise DataError(
                f"the rig of the pictures {', '.join(name.as_posix() for name in names)} has an equirectangular camera "
                "and other cameras, expected the equirectangular camera alone"
            )
        encoding = RangeEncoding(self.config.depth_unit_m, (), self.config.depth_kind or RangeKind.RAY)
        encoding.check_panorama()
        files = ImageFiles(self.folder / names[0], self._depth_file(names[0], ("png",)), encoding=encoding)
        T_world_pano = self.world.pose(pictures[0].T_model_camera) @ invert_pose(LEVEL)
        return PanoramaRecord(id, files, T_world_pano=T_world_pano, places=places)

    def posed(self, picture: ModelPicture) -> PosedImage:
        """Return a picture with its pose. Raises DataError if it is equirectangular, or if its depth is missing."""
        if picture.camera is None:
            raise DataError(
                f"the picture {picture.name} is equirectangular, expected a perspective picture for group_by=motion: "
                "set group_by=frame"
            )
        path = self.folder / picture.name
        depth = self._depth_file(Path(picture.name), ("bin", "png"))
        return PosedImage(
            picture.name,
            PosedCamera(picture.camera, self.world.pose(picture.T_model_camera)),
            partial(read_color, path),
            None if depth is None else partial(self._depth_m, depth, picture.camera),
            sources=(path,) if depth is None else (path, depth),
        )

    def _depth_m(self, path: Path, camera: Camera) -> np.ndarray:
        """Return the depth along the optical axis in metres, (h, w) float32, NaN where unknown."""
        if path.suffix == ".bin":
            return read_dense_depth(path) * np.float32(self.world.scale)
        encoding = RangeEncoding(self.config.depth_unit_m, (), self.config.depth_kind or RangeKind.Z)
        return read_depth(path, encoding, camera)

    def _depth_file(self, name: Path, endings: tuple[str, ...]) -> Path | None:
        """Return the depth image of a picture; None without depth. Raises DataError if it is missing."""
        if self.config.depth is None:
            return None
        folder = Path(self.config.depth)
        names = [name.as_posix() + suffix for suffix in DENSE_SUFFIXES if "bin" in endings]
        names.append(name.with_suffix(".png").as_posix())
        for candidate in names:
            if (folder / candidate).is_file():
                return folder / candidate
        raise DataError(f"{folder} has no depth image of the picture {name.as_posix()}, expected {' or '.join(names)}")


def read_dense_depth(path: Path) -> np.ndarray:
    """Read a depth map of COLMAP, (h, w) float32 along the optical axis in the unit of the model, NaN where unknown.

    Raises:
        DataError: The file cannot be read.
    """
    import pycolmap

    depth = pycolmap.DepthMap()
    try:
        depth.read(str(path))
        values = depth.to_array()
    except Exception as error:  # pycolmap raises several types
        raise DataError(f"{path} is not a depth map of COLMAP: {describe_error(error)}") from None
    return np.where(values > 0, values, np.nan).astype(np.float32)


def _image_folder(images: Path | None, model: Path) -> Path:
    """Return the folder of the pictures. Raises DataError if it is missing."""
    if images is not None:
        if not images.is_dir():
            raise DataError(
                f"the setting images is {images}, which is not a folder; expected the folder of the pictures of the "
                "COLMAP model"
            )
        return images
    parents = (model, *model.absolute().parents[:2])
    folder = next((parent / "images" for parent in parents if (parent / "images").is_dir()), None)
    if folder is None:
        raise DataError(
            f"the pictures of the model are missing, expected a folder `images` in {model} or in one of its two parent "
            "folders: pass --set images=FOLDER"
        )
    return folder


def _num_unused(images: Path, model: Model) -> int:
    """Return the number of pictures in a folder that are not in the model."""
    names = {picture.name for picture in model.pictures}
    suffixes = {Path(name).suffix for name in names}
    files = [path.relative_to(images).as_posix() for path in images.rglob("*") if path.suffix in suffixes]
    return len(set(files) - names)
