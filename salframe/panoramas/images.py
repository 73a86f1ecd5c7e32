"""Read and write the images of the folder format: colour as JPEG or PNG, range and ids as 16-bit PNG, masks as PNG."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError, counted
from salframe.framework.files.image_files import ImageFile, read_image, read_image_file
from salframe.framework.files.writing import atomic_path
from salframe.panoramas.panorama import clean_range
from salframe.panoramas.range_encoding import MAX_STEP, RangeEncoding

_PNG_COMPRESSION, _JPEG_QUALITY = 16, 1
"""Values of cv2.IMWRITE_PNG_COMPRESSION and cv2.IMWRITE_JPEG_QUALITY. OpenCV is imported only where it is used."""
_FORMAT_OPTIONS = {".png": [_PNG_COMPRESSION, 2], ".jpg": [_JPEG_QUALITY, 93], ".jpeg": [_JPEG_QUALITY, 93]}


def read_color(path: Path) -> np.ndarray:
    """Read a colour image, (H, W, 3) uint8 RGB. Raises DataError."""
    return read_color_file(path).pixels


def read_color_file(path: Path) -> ImageFile:
    """Read a colour image, (H, W, 3) uint8 RGB, with its size and metadata. Raises DataError."""
    import cv2

    file = read_image_file(path, cv2.IMREAD_COLOR)
    return replace(file, pixels=cv2.cvtColor(file.pixels, cv2.COLOR_BGR2RGB))


def write_color(path: Path, rgb: np.ndarray) -> None:
    """Write (H, W, 3) uint8 RGB as JPEG or PNG, depending on the suffix of the path."""
    import cv2

    _write(path, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))


def read_range(path: Path, encoding: RangeEncoding | None = None) -> np.ndarray:
    """Read the range image of a panorama, (H, W) float32 range along the ray in metres, NaN where unknown.

    Args:
        path: A 16-bit grey image.
        encoding: Encoding of the values of the file; None: millimetres along the ray.

    Raises:
        DataError: The file is not a 16-bit grey image, or the encoding does not apply to a panorama.
    """
    return (encoding or RangeEncoding()).panorama_range(read_ids(path))


def write_range(path: Path, range_m: np.ndarray, encoding: RangeEncoding | None = None) -> None:
    """Write the range along the ray of a panorama, (H, W) in metres, as a 16-bit image.

    NaN, ranges that are not positive, and ranges above the 16-bit limit become 0.

    Args:
        path: The file.
        range_m: (H, W) floating-point range along the ray in metres.
        encoding: Encoding of the values of the file; None: millimetres along the ray, up to 65.535 m.

    Raises:
        DataError: The range is not a floating-point array.
    """
    known_m = clean_range(range_m, f"{path}: the range image")
    _write(path, (encoding or RangeEncoding()).panorama_steps(known_m))


def read_ids(path: Path) -> np.ndarray:
    """Read a 16-bit grey image, (H, W) int32. Raises DataError."""
    import cv2

    image = read_image(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise DataError(
            f"the image {path} has {counted(channels, 'channel')} of {8 * image.itemsize} bits, expected 1 channel of "
            "16 bits"
        )
    return image.astype(np.int32)


def write_ids(path: Path, ids: np.ndarray) -> None:
    """Write (H, W) ids as a 16-bit grey image. Raises DataError on ids outside 0 to 65535."""
    if ids.min(initial=0) < 0 or ids.max(initial=0) > MAX_STEP:
        raise DataError(f"{path}: the object ids are from {ids.min()} to {ids.max()}, expected 0 to {MAX_STEP}")
    _write(path, ids.astype(np.uint16))


def read_mask(path: Path) -> np.ndarray:
    """Read a mask, (H, W) bool, true where the image is not black. Raises DataError."""
    import cv2

    return read_image(path, cv2.IMREAD_GRAYSCALE) > 0


def write_mask(path: Path, mask: np.ndarray) -> None:
    """Write a mask (H, W) bool as an image with the values 0 and 255."""
    _write(path, mask.astype(np.uint8) * 255)


def _write(path: Path, image: np.ndarray) -> None:
    import cv2

    if path.suffix.lower() not in _FORMAT_OPTIONS:
        raise DataError(
            f"cannot write the image {path}: expected a file name that ends in one of {', '.join(_FORMAT_OPTIONS)}"
        )
    with atomic_path(path) as temporary:
        if not cv2.imwrite(str(temporary), image, _FORMAT_OPTIONS[path.suffix.lower()]):
            raise DataError(
                f"cannot write the image {path}: expected a folder that exists, with write access and free space"
            )
