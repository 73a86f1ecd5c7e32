"""Photo Sphere XMP: the part of the sphere that a picture shows, and the tilt of its camera.

The metadata is defined in https://developers.google.com/streetview/spherical-metadata (namespace GPano). The angles of
the camera are heading, pitch and roll, each about the axes after the preceding rotations. `PosePitchDegrees` is the
elevation of the centre of the full panorama. "As roll increases, the horizon rotates counterclockwise in the image", so
that a positive `PoseRollDegrees` lowers the right side of the camera. The heading is not used: after levelling, the
centre of the picture still has the azimuth 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError, one_line
from salframe.framework.files.image_files import ImageFile
from salframe.panoramas.levelling import turn_image

_NAMESPACE = "http://ns.google.com/photos/1.0/panorama"
_CROP = (
    "CroppedAreaImageWidthPixels",
    "CroppedAreaImageHeightPixels",
    "FullPanoWidthPixels",
    "FullPanoHeightPixels",
    "CroppedAreaLeftPixels",
    "CroppedAreaTopPixels",
)
_MAX_PITCH_DEG, _MAX_ROLL_DEG = 90.0, 180.0
MAX_ROWS = 4096
"""Maximum height of the panorama on which a cropped picture is placed."""
_SIZE_TOLERANCE_PX = 2
"""Maximum rounding error of sizes in the XMP of pictures that were resized."""


@dataclass(frozen=True, eq=False)
class PhotoSphere:
    """Position of the pixels of a picture on the sphere.

    Attributes:
        height: Height H of the panorama.
        top: Row of the panorama at the top of the picture.
        left: Column of the panorama at the left of the picture.
        size: Width and height of the picture in the panorama.
        pitch_deg: Elevation of the centre of the panorama.
        roll_deg: Angle by which the right side of the camera is lowered.
    """

    height: int
    top: int
    left: int
    size: tuple[int, int]
    pitch_deg: float
    roll_deg: float

    @property
    def is_crop(self) -> bool:
        """Whether the picture shows only a part of the sphere."""
        return self.size != (2 * self.height, self.height)

    @property
    def is_tilted(self) -> bool:
        """Whether the tilt of the camera exceeds the angle of half a pixel."""
        return max(abs(self.pitch_deg), abs(self.roll_deg)) > 90 / self.height

    @property
    def rotation(self) -> np.ndarray:
        """Rotation from the frame of the picture to the upright panorama frame, (3, 3) float64."""
        (c, s), (cr, sr) = ((np.cos(angle), np.sin(angle)) for angle in np.radians((self.pitch_deg, self.roll_deg)))
        pitch = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        return pitch @ roll

    def place(self, image: np.ndarray, fill: float = 0) -> np.ndarray:
        """Return the full equirectangular image (H, 2H, ...) that contains an image (h, w, ...) of the picture's size.

        Pixels outside the picture have the value `fill`.
        """
        import cv2

        if not self.is_crop:
            return image
        if image.shape[1::-1] != self.size:
            smooth = cv2.INTER_AREA if image.ndim == 3 else cv2.INTER_NEAREST
            is_mask = image.dtype == bool
            image = cv2.resize(image.view(np.uint8) if is_mask else image, self.size, interpolation=smooth)
            image = image.view(bool) if is_mask else image
        placed = np.full((self.height, 2 * self.height, *image.shape[2:]), fill, image.dtype)
        width, height = self.size
        placed[self.top : self.top + height, self.left : self.left + width] = image
        return placed

    def level(self, image: np.ndarray) -> np.ndarray:
        """Return an image (H, 2H, ...) as a level camera would see it. Only images with channels are interpolated."""
        return turn_image(image, self.rotation) if self.is_tilted else image

    def note(self, *, levelled: bool) -> str | None:
        """Return a note on the changes that the XMP causes, or None. `levelled`: whether `level` was applied."""
        changes = []
        if self.is_crop:
            width, height = self.size
            share = f"{width} x {height} of {2 * self.height} x {self.height} pixels"
            changes.append(f"placed as a crop of the full panorama ({share})")
        if self.is_tilted:
            tilt = f"pitch {self.pitch_deg:g} deg and roll {self.roll_deg:g} deg"
            changes.append(
                f"levelled from {tilt}" if levelled else f"not levelled from {tilt}, because the pose is tilted"
            )
        return f"{' and '.join(changes)}, as the Photo Sphere XMP metadata states" if changes else None


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Replace a ValueError of the `with` block by a DataError that names the picture."""
    try:
        yield
    except ValueError as error:
        raise DataError(
            f"{path}: the Photo Sphere XMP metadata has {one_line(error)}: correct the XMP, or remove it with: "
            f"exiftool -XMP-GPano:all= {path.name}"
        ) from None


def read_photo_sphere(file: ImageFile, path: Path) -> PhotoSphere | None:
    """Return the geometry that the Photo Sphere XMP of a picture declares; None if it has none.

    Args:
        file: The picture.
        path: Path of the picture, for messages.

    Raises:
        DataError: The XMP is malformed, contradicts itself or the picture, or is not equirectangular.
    """
    with _naming(path):
        values = _gpano(file.xmp)
        return _geometry(values, file) if values else None


def declares_panorama(file: ImageFile, path: Path) -> bool:
    """Return whether the Photo Sphere XMP of a picture says that it is a panorama. Raises DataError if malformed."""
    with _naming(path):
        values = _gpano(file.xmp)
    is_shown_flat = values.get("UsePanoramaViewer", "").lower() == "false"
    return values.get("ProjectionType", "").lower() == "equirectangular" and not is_shown_flat


def _gpano(packets: tuple[bytes, ...]) -> dict[str, str]:
    """Return the GPano properties of XMP packets, which are attributes or elements. Raises ValueError."""
    from xml.etree.ElementTree import ParseError

    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    values: dict[str, str] = {}
    for packet in packets:
        if _NAMESPACE.encode() not in packet:
            continue
        try:
            root = fromstring(packet.strip(b" \t\r\n\0"), forbid_dtd=True)
        except (ParseError, DefusedXmlException, LookupError, RecursionError) as error:
            raise ValueError(f"invalid XML ({one_line(error)})") from None
        for element in root.iter():
            for name, value in [(element.tag, element.text or ""), *element.attrib.items()]:
                namespace, _, name = str(name).rpartition("}")
                if namespace.strip("{/") != _NAMESPACE:
                    continue
                if values.setdefault(name, value.strip()) != value.strip():
                    raise ValueError(
                        f"two values of {name}, {values[name][:40]!r} and {value.strip()[:40]!r}, expected one value"
                    )
    return values


def _geometry(values: Mapping[str, str], file: ImageFile) -> PhotoSphere:
    """Return the geometry of a picture. Raises ValueError on a contradiction."""
    projection = values.get("ProjectionType", "equirectangular")
    if projection.lower() != "equirectangular":
        raise ValueError(f"the ProjectionType {projection[:40]!r}, expected 'equirectangular'")
    height, width = file.pixels.shape[:2]
    pitch_deg = _number(values, "PosePitchDegrees", 0, _MAX_PITCH_DEG)
    roll_deg = _number(values, "PoseRollDegrees", 0, _MAX_ROLL_DEG)
    if not any(name in values for name in _CROP):
        return PhotoSphere(height, 0, 0, (width, height), pitch_deg, roll_deg)
    crop_w, crop_h = _number(values, _CROP[0], file.width_px), _number(values, _CROP[1], file.height_px)
    full_w, full_h = _number(values, _CROP[2], crop_w), _number(values, _CROP[3], crop_h)
    is_crop = crop_w < full_w or crop_h < full_h
    left, top = (_number(values, name, None if is_crop else 0) for name in _CROP[4:])
    if min(crop_w, crop_h) < 1 or abs(full_w - 2 * full_h) > _SIZE_TOLERANCE_PX:
        raise ValueError(
            f"a crop of {crop_w:g} x {crop_h:g} and a full panorama of {full_w:g} x {full_h:g} pixels, "
            "expected positive sizes, and a full panorama with width = 2 x height"
        )
    if min(left, top) < 0 or left + crop_w > full_w or top + crop_h > full_h:
        raise ValueError(
            f"a crop of {crop_w:g} x {crop_h:g} pixels at column {left:g} and row {top:g}, expected a "
            f"crop inside the full panorama of {full_w:g} x {full_h:g}"
        )
    if abs(width * crop_h / crop_w - height) > _SIZE_TOLERANCE_PX:
        raise ValueError(
            f"a crop of {crop_w:g} x {crop_h:g} pixels, expected the aspect ratio of the picture, {width} x {height}"
        )
    if not is_crop:
        return PhotoSphere(height, 0, 0, (width, height), pitch_deg, roll_deg)
    rows = round(min(full_h * width / crop_w, MAX_ROWS))
    scale = rows / full_h
    size = (min(max(round(crop_w * scale), 1), 2 * rows), min(max(round(crop_h * scale), 1), rows))
    place = min(round(top * scale), rows - size[1]), min(round(left * scale), 2 * rows - size[0])
    return PhotoSphere(rows, *place, size, pitch_deg, roll_deg)


def _number(values: Mapping[str, str], name: str, default: float | None, limit: float = 1e7) -> float:
    """Return a number of the XMP. Raises ValueError if it is missing without a default, no number or out of range."""
    if name not in values:
        if default is None:
            raise ValueError(f"no property {name}, expected it because the picture is a crop")
        return default
    text = values[name]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= limit:
        raise ValueError(
            f"the property {name} with the value {text[:40]!r}, expected a number from {-limit:g} to {limit:g}"
        )
    return value
