"""Reading of JPEG and PNG files of limited size: pixels, and the metadata that comes with them.

The decoder decides whether a file is complete. Bytes after the end of the image, such as the video of a motion photo,
are ignored.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.bounded import read_bytes
from salframe.framework.files.reading import reading

MAX_DECODED_PIXELS = 1 << 26
"""Maximum number of pixels of the array that is returned. Larger images are reduced to half their width and height."""
MAX_PIXELS = 4 * MAX_DECODED_PIXELS
"""Maximum number of pixels of a file: 23,170 x 11,585 for a panorama."""
_HARMLESS = "Invalid SOS parameters"
"""Warning of libjpeg on complete files that some cameras write. simplejpeg reports only the first warning of a file."""
_XMP, _EXTENDED_XMP = b"http://ns.adobe.com/xap/1.0/\0", b"http://ns.adobe.com/xmp/extension/\0"
_PNG_XMP = "XML:com.adobe.xmp"
_MAX_XMP_BYTES = 1 << 24
"""Maximum size of the extended XMP of an image, in bytes. Extended XMP may hold whole images, which are not needed."""
_GUID_BYTES, _OFFSET_BYTES = 32, 4


@dataclass(frozen=True, eq=False)
class ImageFile:
    """A decoded image file.

    Attributes:
        pixels: (H, W) or (H, W, C) array, reduced to at most MAX_DECODED_PIXELS pixels.
        width_px: Width of the image in the file, after its EXIF orientation was applied.
        height_px: Height of the image in the file.
        xmp: XMP packets of the file, the main one first.
    """

    pixels: np.ndarray
    width_px: int
    height_px: int
    xmp: tuple[bytes, ...] = ()

    @property
    def note(self) -> str | None:
        """A note that the image was reduced, with both sizes. None if it was not reduced."""
        height, width = self.pixels.shape[:2]
        if height == self.height_px:
            return None
        return f"reduced from {self.width_px} x {self.height_px} to {width} x {height} pixels while reading"


def read_image(path: Path, mode: int) -> np.ndarray:
    """Read the pixels of a JPEG or PNG.

    Args:
        path: The file.
        mode: Reading mode of OpenCV. cv2.IMREAD_COLOR gives BGR.

    Returns:
        (H, W) or (H, W, C) array. `decode_image` reduces the size of large images.

    Raises:
        DataError: The file is missing, damaged, truncated or too large.
    """
    return read_image_file(path, mode).pixels


def read_image_file(path: Path, mode: int) -> ImageFile:
    """Read the pixels, the size and the XMP of a JPEG or PNG, as `decode_image` does."""
    with reading(path, "a readable image"):
        content = read_bytes(path)
    return decode_image(content, mode, str(path))


def decode_image(content: bytes, mode: int, name: str) -> ImageFile:
    """Decode the content of a JPEG or PNG.

    An image with more than MAX_DECODED_PIXELS pixels is reduced to half its width and height. Colour and grey values
    are averaged. The mode cv2.IMREAD_UNCHANGED is for ranges and ids: every second pixel is taken.

    Args:
        content: The bytes of the file.
        mode: Reading mode of OpenCV. cv2.IMREAD_COLOR gives BGR.
        name: Name of the image in errors.

    Raises:
        DataError: The image is damaged, truncated or too large.
    """
    import cv2

    try:
        width, height, xmp = _check_complete(content)
    except Exception:  # Pillow raises many types of exceptions
        raise _unreadable(name, content) from None
    if width * height > MAX_PIXELS:
        raise DataError(
            f"{name} is {width} x {height}, expected at most {MAX_PIXELS} pixels in total: reduce the size of the image"
        )
    is_large = width * height > MAX_DECODED_PIXELS
    halved = {cv2.IMREAD_COLOR: cv2.IMREAD_REDUCED_COLOR_2, cv2.IMREAD_GRAYSCALE: cv2.IMREAD_REDUCED_GRAYSCALE_2}
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), halved.get(mode, mode) if is_large else mode)
    if pixels is None:
        raise _unreadable(name, content)
    if (pixels.shape[0] > pixels.shape[1]) != (height > width):  # the EXIF orientation swaps width and height
        width, height = height, width
    if is_large:  # decoders round up, which would change the aspect ratio
        rows = height // 2
        pixels = cv2.resize(pixels, (round(width * rows / height), rows), interpolation=cv2.INTER_NEAREST)
    return ImageFile(pixels, width, height, xmp)


def _unreadable(name: str, content: bytes) -> DataError:
    return DataError(
        f"{name} is not a readable image (file size {len(content)} bytes), expected a complete JPEG or PNG"
    )


def _check_complete(content: bytes) -> tuple[int, int, tuple[bytes, ...]]:
    """Return width, height and XMP packets of a JPEG or PNG. Raises an exception if it is damaged or truncated."""
    if content.startswith(b"\xff\xd8"):
        return _check_jpeg(content)
    return _check_png(content)


def _check_jpeg(content: bytes) -> tuple[int, int, tuple[bytes, ...]]:
    import simplejpeg
    from PIL.JpegImagePlugin import JpegImageFile

    with JpegImageFile(io.BytesIO(content)) as picture:
        (width, height), color = picture.size, "CMYK" if picture.mode == "CMYK" else "GRAY"
        xmp = _jpeg_xmp([segment for name, segment in picture.applist if name == "APP1"])
    if width * height <= MAX_PIXELS:
        try:  # at an eighth of the size only the entropy decoding takes time
            simplejpeg.decode_jpeg(content, color, min_height=1, min_width=1)
        except ValueError as error:
            if _HARMLESS not in str(error):
                raise
    return width, height, xmp


def _check_png(content: bytes) -> tuple[int, int, tuple[bytes, ...]]:
    from PIL.PngImagePlugin import PngImageFile

    with PngImageFile(io.BytesIO(content)) as picture:
        width, height = picture.size
        picture.verify()
    if _PNG_XMP.encode() not in content or width * height > MAX_PIXELS:
        return width, height, ()
    with PngImageFile(io.BytesIO(content)) as picture:
        picture.load()  # most programs write XMP after the pixels
        packet = picture.info.get(_PNG_XMP, "")
    return width, height, (packet.encode(),) if packet else ()


def _jpeg_xmp(segments: list[bytes]) -> tuple[bytes, ...]:
    """Return the main XMP packet of a JPEG and its extended packet, from the APP1 segments."""
    main = next((segment[len(_XMP) :] for segment in segments if segment.startswith(_XMP)), None)
    if main is None:
        return ()
    extended = bytearray()
    for segment in segments:
        guid, offset, start = _extended_header(segment)
        if guid and guid in main and offset == len(extended) and len(extended) < _MAX_XMP_BYTES:
            extended += segment[start:]
    return (main, bytes(extended)) if extended else (main,)


def _extended_header(segment: bytes) -> tuple[bytes, int, int]:
    """Return the GUID, the offset, and the index of the first content byte of an APP1 segment of extended XMP.

    The GUID is empty if the segment is no extended XMP. The header of a segment has the GUID, which the main packet
    also has, the size of the extended packet, and the offset of this segment in it (Adobe XMP specification, part 3,
    1.1.3.1).
    """
    if not segment.startswith(_EXTENDED_XMP):
        return b"", 0, 0
    offset = len(_EXTENDED_XMP) + _GUID_BYTES + _OFFSET_BYTES
    start = offset + _OFFSET_BYTES
    return segment[len(_EXTENDED_XMP) :][:_GUID_BYTES], int.from_bytes(segment[offset:start], "big"), start


def image_notes(path: Path) -> dict[str, Any]:
    """Return the text metadata of a PNG by key, or an empty dictionary if the file is not a PNG."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(read_bytes(path)), formats=("PNG",)) as picture:
            return {str(key): value for key, value in picture.info.items()}
    except Exception:  # Pillow raises many types of exceptions
        return {}
