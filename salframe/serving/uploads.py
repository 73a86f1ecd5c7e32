"""Read the query of a request: an uploaded panorama or photograph, or detections as JSON."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, TypeVar

import numpy as np
from pydantic import BaseModel, Field, ValidationError
from starlette.datastructures import FormData, UploadFile
from starlette.requests import Request

from salframe.framework.errors import DataError, one_line
from salframe.framework.files.bounded import parse_json
from salframe.framework.validation import Settings, describe_faults
from salframe.graphs.detections import Detections
from salframe.panoramas.camera import Camera
from salframe.panoramas.camera_file import CameraFile
from salframe.panoramas.panorama import UNNAMED_ID, Panorama
from salframe.panoramas.panorama_files import load_panorama
from salframe.panoramas.range_encoding import MILLIMETRE, RangeEncoding, RangeKind
from salframe.panoramas.shot import missing_depth_note, open_photograph
from salframe.serving.limits import ServiceLimits
from salframe.serving.problems import Problem
from salframe.serving.schemas import DetectedObject, Motion

MULTIPART, JSON = "multipart/form-data", "application/json"
FILES = ("image", "range")
"""Names of the file fields of a multipart query."""
MAX_FIELDS, MAX_FIELD_BYTES = 12, 1 << 16
_Model = TypeVar("_Model", bound=BaseModel)


@dataclass(frozen=True, eq=False)
class ServedQuery:
    """A query that was read and checked.

    Attributes:
        panorama: The panorama; None if the query consists of detections.
        detections: The detections; None if the query is a panorama or photograph.
        camera: The camera of a photograph; None for other queries.
        rgb: (H, W, 3) uint8, the uploaded image as it was read; None if there is no colour image.
        notes: Notes on the images, one line each.
    """

    panorama: Panorama | None = None
    detections: Detections | None = None
    camera: Camera | None = None
    rgb: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    @property
    def position_m(self) -> np.ndarray:
        """Position of the camera in the base frame of the robot, in metres, (3,) float64; the origin if it is
        unknown."""
        return np.zeros(3) if self.camera is None else self.camera.position_m


class UploadFields(Settings):
    """The text fields of a multipart query. Images are in the file fields `image` and `range`."""

    range_unit_m: float = Field(
        MILLIMETRE, gt=0, description="length (m) of one unit of the range image (0.001: the values are in millimetres)"
    )
    range_missing: list[int] = Field(
        [],
        max_length=20,
        description="list of the values of the range image that mean an unknown range, in addition to 0",
    )
    range_kind: RangeKind | None = Field(
        None,
        description="quantity that the range image contains. ray: distance along the ray; z: depth along the optical "
        "axis; cube: depth along the axis of the cube face that shows the pixel; null: z for photographs, ray for "
        "panoramas",
    )
    fov_deg: float | None = Field(
        None,
        description="horizontal field of view (degrees) of a photograph by a level camera; null: the image is a "
        "panorama, or `camera` is set",
    )
    camera: CameraFile | None = Field(
        None, description="calibration of the camera of a photograph, as JSON in the format of camera files"
    )


class ObservationFields(UploadFields):
    """The text fields of a multipart observation."""

    t_s: float = Field(description="time of the view in seconds, later than that of the previous observation")
    odometry: Motion | None = Field(None, description="motion since the previous observation; absent: unknown")


_JSON_FIELDS = ("range_missing", "camera", "odometry")
"""Names of the text fields that contain JSON."""


def content_type(request: Request) -> str:
    """Return the media type of a body: MULTIPART or JSON.

    Raises:
        Problem: 415 for other types.
    """
    received = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if received not in (MULTIPART, JSON):
        raise Problem(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
            f"the header Content-Type is {received!r}, expected {MULTIPART} with an image, or {JSON} with detections",
        )
    return received


async def read_json_body(request: Request, model: type[_Model], limits: ServiceLimits) -> _Model:
    """Return the validated JSON body of a request.

    Raises:
        Problem: 400 if the body is not JSON, 413 if it is too large, 415 if it has another media type, 422 if its
            content is invalid.
    """
    if content_type(request) != JSON:
        raise Problem(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"the header Content-Type is {MULTIPART!r}, expected {JSON!r}")
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > limits.max_json_bytes:
            raise Problem(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                f"the JSON body has more than {limits.max_json_bytes} bytes, expected at most {limits.max_json_bytes}",
            )
    return _validate(model, _parse(bytes(body), "the body"))


async def read_form(request: Request, model: type[_Model]) -> tuple[_Model, FormData]:
    """Return the validated text fields of a multipart body, and the form with its files. The caller closes the form.

    Raises:
        HTTPException: 400 for a malformed body.
        Problem: 400 for a JSON field that is not JSON, 422 for invalid fields.
    """
    form = await request.form(max_files=len(FILES), max_fields=MAX_FIELDS, max_part_size=MAX_FIELD_BYTES)
    try:
        return _validate(model, _text_fields(form)), form
    except BaseException:
        await form.close()
        raise


def open_upload(fields: UploadFields, form: FormData, limits: ServiceLimits) -> ServedQuery:
    """Read the images of a multipart query in the same way as image files.

    Raises:
        Problem: 413 for an image with too many pixels.
        DataError: There is no image, or an image is malformed.
    """
    files = {name: part for name in FILES if isinstance(part := form.get(name), UploadFile)}
    if not files:
        raise DataError("received no image, expected the file field `image`, `range` or both")
    with TemporaryDirectory(prefix="salframe-") as folder:
        paths = {name: _store(part.file, Path(folder) / name, limits) for name, part in files.items()}
        try:
            return _read_images(fields, paths.get("image"), paths.get("range"))
        except DataError as error:
            raise DataError(str(error).replace(f"{folder}/", "").replace(f"{folder}\\", "")) from None


def to_detections(objects: Sequence[DetectedObject], limits: ServiceLimits) -> ServedQuery:
    """Return a query that consists of detections.

    Raises:
        Problem: 413 for too many objects.
    """
    if len(objects) > limits.max_objects:
        raise Problem(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            f"the query has {len(objects)} detections, expected at most {limits.max_objects}",
        )
    count, unknown = len(objects), [np.nan] * 3
    centroid_m = np.array([thing.centroid_m or unknown for thing in objects], float).reshape(count, 3)
    azimuth, elevation = np.radians(
        [[_or_nan(thing.azimuth_deg), _or_nan(thing.elevation_deg)] for thing in objects] or np.zeros((0, 2))
    ).T
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1
    )
    length = np.linalg.norm(centroid_m, axis=1, keepdims=True)
    is_ranged = np.isfinite(length) & (length > 0)
    return ServedQuery(
        detections=Detections(
            tuple(thing.label for thing in objects),
            np.array([thing.score for thing in objects], float),
            centroid_m,
            np.array([thing.size_m or unknown for thing in objects], float).reshape(count, 3),
            np.radians(np.array([thing.yaw_deg if thing.centroid_m else np.nan for thing in objects], float)) % np.pi,
            bearing=np.where(is_ranged, centroid_m / np.where(is_ranged, length, 1), direction),
            solid_angle_sr=np.array([_or_nan(thing.solid_angle_sr) for thing in objects], float),
        )
    )


def _read_images(fields: UploadFields, image: Path | None, range_image: Path | None) -> ServedQuery:
    is_photograph = fields.camera is not None or fields.fov_deg is not None
    kind = fields.range_kind or (RangeKind.Z if is_photograph else RangeKind.RAY)
    encoding = RangeEncoding(fields.range_unit_m, tuple(fields.range_missing), kind)
    if not is_photograph:
        panorama = load_panorama(UNNAMED_ID, rgb=image, range_image=range_image, encoding=encoding)
        return ServedQuery(panorama, rgb=panorama.rgb, notes=panorama.notes)
    if image is None:
        raise DataError(
            "received a camera or field of view without a photograph: send the photograph as the field `image`"
        )
    camera = None if fields.camera is None else Camera(**fields.camera.model_dump())
    shot = open_photograph(image, range_image, camera=camera, fov_deg=fields.fov_deg, encoding=encoding)
    note = missing_depth_note(shot, encoding)
    camera_notes = () if camera is None else camera.notes
    notes = (*camera_notes, *shot.panorama.notes, *([note] if note else []))
    return ServedQuery(shot.panorama, camera=shot.camera, rgb=shot.rgb, notes=notes)


def _store(source: BinaryIO, path: Path, limits: ServiceLimits) -> Path:
    """Write an uploaded image to a file, and check the number of pixels in the header of the image. Raises Problem 413
    if there are too many."""
    from PIL import Image

    source.seek(0)
    with path.open("wb") as file:
        shutil.copyfileobj(source, file)
    try:
        with Image.open(path, formats=("JPEG", "PNG")) as picture:
            width, height = picture.size
    except Exception:  # Pillow raises many types of exceptions; the image reader reports the error later
        return path
    if width * height > limits.max_pixels:
        raise Problem(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            f"{path.name} has {width} x {height} pixels, expected at most {limits.max_pixels} in total: reduce the "
            "image",
        )
    return path


def _text_fields(form: FormData) -> dict[str, Any]:
    """Return the text fields of a form. The fields that contain JSON are parsed."""
    fields: dict[str, Any] = {}
    for name, value in form.multi_items():
        if isinstance(value, UploadFile) != (name in FILES):
            expected = "a file" if name in FILES else "text"
            received = "a file" if isinstance(value, UploadFile) else "text"
            raise Problem(HTTPStatus.UNPROCESSABLE_ENTITY, f"the field {name!r} is {received}, expected {expected}")
        if name in fields:
            raise Problem(HTTPStatus.UNPROCESSABLE_ENTITY, f"received the field {name!r} twice, expected it once")
        if isinstance(value, str):
            fields[name] = _parse(value.encode("utf-8", "replace"), name) if name in _JSON_FIELDS else value
    return fields


def _parse(content: bytes, where: str) -> Any:
    try:
        return parse_json(content)
    except (ValueError, RecursionError) as error:
        raise Problem(HTTPStatus.BAD_REQUEST, f"{where} is not JSON: {one_line(error)}") from None


def _validate(model: type[_Model], content: Any) -> _Model:
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise Problem(HTTPStatus.UNPROCESSABLE_ENTITY, describe_faults(error, "the body:", model)) from None


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value
