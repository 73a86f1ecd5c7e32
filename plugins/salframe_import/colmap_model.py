"""Read a COLMAP model, text or binary, by pycolmap: cameras, poses of the pictures, and rigs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.errors import DataError, describe_error
from salframe.panoramas.camera import Camera, DistortionModel
from salframe.panoramas.geometry import invert_pose

_COEFFICIENTS: dict[str, tuple[DistortionModel, tuple[str, ...]]] = {
    "SIMPLE_PINHOLE": (DistortionModel.NONE, ()),
    "PINHOLE": (DistortionModel.NONE, ()),
    "SIMPLE_RADIAL": (DistortionModel.PLUMB_BOB, ("k", "0", "0", "0", "0")),
    "RADIAL": (DistortionModel.PLUMB_BOB, ("k1", "k2", "0", "0", "0")),
    "OPENCV": (DistortionModel.PLUMB_BOB, ("k1", "k2", "p1", "p2", "0")),
    "FULL_OPENCV": (DistortionModel.RATIONAL_POLYNOMIAL, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "OPENCV_FISHEYE": (DistortionModel.FISHEYE, ("k1", "k2", "k3", "k4")),
    "SIMPLE_FISHEYE": (DistortionModel.FISHEYE, ("0", "0", "0", "0")),
    "FISHEYE": (DistortionModel.FISHEYE, ("0", "0", "0", "0")),
    "SIMPLE_RADIAL_FISHEYE": (DistortionModel.FISHEYE, ("k", "0", "0", "0")),
    "RADIAL_FISHEYE": (DistortionModel.FISHEYE, ("k1", "k2", "0", "0")),
}
"""Distortion model and names of the coefficients of COLMAP's camera models, in the order of OpenCV. "0" stands for a
coefficient that the model lacks."""
EQUIRECTANGULAR = "EQUIRECTANGULAR"
"""COLMAP's model of a 360 camera, since COLMAP 4.1."""


@dataclass(frozen=True, eq=False)
class ModelPicture:
    """A registered picture of a COLMAP model.

    Attributes:
        name: Path of the file, relative to the folder of the pictures.
        frame: Number of its frame: pictures of a rig that were taken together have the same number.
        camera: The intrinsics (T_base_camera has no meaning here); None for an equirectangular picture.
        T_model_camera: (4, 4) float64 pose of the optical frame (x right, y down, z forward) in the world of the model.
            The unit is arbitrary.
    """

    name: str
    frame: int
    camera: Camera | None
    T_model_camera: np.ndarray


@dataclass(frozen=True, eq=False)
class Model:
    """The registered pictures of a COLMAP model and its points, in the arbitrary axes and unit of the model.

    Attributes:
        pictures: The pictures in the order of their names.
        points: (N, 3) float64 points.
    """

    pictures: tuple[ModelPicture, ...]
    points: np.ndarray


def find_model(source: Path) -> Path:
    """Return the folder of the model in a folder: the folder itself, `sparse/0`, `sparse` or the only `sparse/N`.

    Raises:
        DataError: There is no model, or there are several.
    """
    for folder in (source, source / "sparse" / "0", source / "sparse"):
        if _is_model(folder):
            if folder.name == "0" and (others := [other for other in _submodels(source) if other != folder]):
                raise DataError(
                    f"{source} has {len(others) + 1} models in sparse "
                    f"({', '.join(sorted(m.name for m in [folder, *others]))}), expected one: pass the folder of one "
                    "model, such as sparse/0"
                )
            return folder
    raise DataError(
        f"{source} has no COLMAP model, expected cameras and images as .bin or .txt in this folder, sparse/0 or sparse"
    )


def read_model(folder: Path) -> Model:
    """Read a model with its rigs. Models of COLMAP 3.11 and older have no rigs.

    Args:
        folder: The folder with cameras, images and points3D, as .bin or .txt.

    Raises:
        DataError: The files cannot be read, no picture is registered, or a camera model is not supported.
    """
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)  # errors are raised, not printed
    try:
        model = pycolmap.Reconstruction(str(folder))
    except Exception as error:  # pycolmap raises several types
        raise DataError(f"{folder} cannot be read as a COLMAP model: {describe_error(error)}") from None
    cameras = {number: _camera(camera, folder) for number, camera in model.cameras.items()}
    pictures = [
        ModelPicture(image.name, image.frame_id, cameras[image.camera_id], _pose(image.cam_from_world()))
        for image in model.images.values()
        if image.has_pose
    ]
    if not pictures:
        raise DataError(
            f"none of the {model.num_images()} pictures of {folder} has a pose, expected pictures that COLMAP "
            "registered"
        )
    points = np.array([point.xyz for point in model.points3D.values()], np.float64).reshape(-1, 3)
    return Model(tuple(sorted(pictures, key=lambda picture: picture.name)), points)


def _is_model(folder: Path) -> bool:
    return any(
        (folder / f"images.{kind}").is_file() and (folder / f"cameras.{kind}").is_file() for kind in ("bin", "txt")
    )


def _submodels(source: Path) -> list[Path]:
    return [folder for folder in (source / "sparse").iterdir() if _is_model(folder)]


def _pose(cam_from_world: Any) -> np.ndarray:
    """Return the pose (4, 4) of a camera in the world, from a pycolmap.Rigid3d that maps the world to the camera."""
    matrix = np.eye(4)
    matrix[:3] = cam_from_world.matrix()
    return invert_pose(matrix)


def _camera(camera: Any, folder: Path) -> Camera | None:
    """Return a camera of pycolmap; None if it is equirectangular."""
    name = camera.model.name
    if name == EQUIRECTANGULAR:
        if camera.width != 2 * camera.height:
            raise DataError(
                f"{folder}: the {EQUIRECTANGULAR} camera {camera.camera_id} is {camera.width} x {camera.height}, "
                "expected width = 2 x height"
            )
        return None
    if name not in _COEFFICIENTS:
        raise DataError(
            f"{folder}: the camera {camera.camera_id} has the model {name}, expected {EQUIRECTANGULAR} or one of "
            f"{', '.join(_COEFFICIENTS)}: undistort the pictures with `colmap image_undistorter`"
        )
    model, names = _COEFFICIENTS[name]
    values = dict(zip(_parameter_names(camera), camera.params, strict=True))
    try:
        return Camera(
            camera.width,
            camera.height,
            float(camera.focal_length_x),
            float(camera.focal_length_y),
            float(camera.principal_point_x) - 0.5,  # COLMAP: the corner of the first pixel is at 0
            float(camera.principal_point_y) - 0.5,
            model,
            [float(values.get(name, 0.0)) for name in names],
        )
    except DataError as error:
        raise DataError(f"{folder}: the camera {camera.camera_id}: {error}") from None


def _parameter_names(camera: Any) -> Sequence[str]:
    return [name.strip() for name in camera.params_info.split(",")]
