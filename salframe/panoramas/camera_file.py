"""Read a camera from CAMERA.json."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_model
from salframe.framework.validation import Settings
from salframe.panoramas.camera import LEVEL, Camera


class CameraFile(Settings):
    """The content of CAMERA.json: the fields of `Camera`."""

    width: int = Field(gt=0, strict=True)
    height: int = Field(gt=0, strict=True)
    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: str
    distortion: list[float]
    T_base_camera: list[list[float]] = LEVEL.tolist()


def read_camera(path: str | Path) -> Camera:
    """Read a camera from a JSON file with the fields of `Camera`; T_base_camera may be left out.

    Raises:
        DataError: The file cannot be read, a field is missing or unknown, or the camera is invalid or implausible.
    """
    path = Path(path)
    content = read_model(path, CameraFile)
    try:
        return Camera(**content.model_dump())
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
