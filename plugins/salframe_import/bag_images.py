"""Decode the image messages of ROS bags: colour, and depth in metres."""

from __future__ import annotations

from typing import Any

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files.image_files import decode_image
from salframe.panoramas.range_encoding import RangeEncoding

_CHANNELS = {
    "mono8": (np.uint8, 1, "COLOR_GRAY2RGB"),
    "8UC1": (np.uint8, 1, "COLOR_GRAY2RGB"),
    "rgb8": (np.uint8, 3, None),
    "8UC3": (np.uint8, 3, "COLOR_BGR2RGB"),
    "bgr8": (np.uint8, 3, "COLOR_BGR2RGB"),
    "rgba8": (np.uint8, 4, "COLOR_RGBA2RGB"),
    "bgra8": (np.uint8, 4, "COLOR_BGRA2RGB"),
    "yuv422": (np.uint8, 2, "COLOR_YUV2RGB_UYVY"),
    "uyvy": (np.uint8, 2, "COLOR_YUV2RGB_UYVY"),
    "yuv422_yuy2": (np.uint8, 2, "COLOR_YUV2RGB_YUYV"),
    "yuyv": (np.uint8, 2, "COLOR_YUV2RGB_YUYV"),
    # OpenCV names the second row of a Bayer pattern, ROS the first.
    "bayer_rggb8": (np.uint8, 1, "COLOR_BayerBG2RGB"),
    "bayer_bggr8": (np.uint8, 1, "COLOR_BayerRG2RGB"),
    "bayer_gbrg8": (np.uint8, 1, "COLOR_BayerGR2RGB"),
    "bayer_grbg8": (np.uint8, 1, "COLOR_BayerGB2RGB"),
}
"""Mapping from each colour encoding to the type of its values, the number of values per pixel, and the OpenCV
conversion to RGB (None: no conversion is needed)."""
_DEPTH = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}
"""Type of the values of each depth encoding. By REP-118, integers are millimetres and floats are metres."""
_COMPRESSED_DEPTH_HEADER = 12
"""Number of bytes before the PNG of compressed_depth_image_transport: an int32 and two float32."""


def is_depth(message: Any) -> bool:
    """Return whether an image message shows depth: 16UC1, mono16 or 32FC1, raw or compressed."""
    return _encoding(message) in _DEPTH


def image_size(message: Any, topic: str) -> tuple[int, int]:
    """Return width and height of an image message of a topic. Raises DataError if a compressed image is damaged."""
    if not _is_compressed(message):
        return message.width, message.height
    image = _decompress(message, topic)
    return image.shape[1], image.shape[0]


def color_image(message: Any, topic: str) -> np.ndarray:
    """Return the colours of an Image or CompressedImage message, (h, w, 3) uint8 RGB.

    Raises:
        DataError: The encoding is not supported, or the data are damaged.
    """
    import cv2

    if _is_compressed(message):
        image = _decompress(message, topic)
        if image.dtype != np.uint8:
            raise DataError(f"the topic {topic} has colour images of type {image.dtype}, expected uint8")
        codes = {2: cv2.COLOR_GRAY2RGB, 3: cv2.COLOR_BGR2RGB}
        return cv2.cvtColor(image, codes[image.ndim])
    if message.encoding not in _CHANNELS:
        raise DataError(
            f"the topic {topic} has the encoding {message.encoding!r}, expected one of {', '.join(_CHANNELS)}"
        )
    dtype, channels, code = _CHANNELS[message.encoding]
    pixels = _pixels(message, dtype, channels, topic)
    return pixels if code is None else cv2.cvtColor(pixels, getattr(cv2, code))


def depth_image(message: Any, topic: str, unit_m: float) -> np.ndarray:
    """Return the depth of an Image or CompressedImage message in metres, (h, w) float32, NaN where unknown.

    Args:
        message: A message of which `is_depth` is true.
        topic: Name of its topic, for error messages.
        unit_m: Metres per unit of 16-bit integers. Floats are metres.

    Raises:
        DataError: The encoding is not depth, or the data are damaged.
    """
    encoding = _encoding(message)
    if encoding not in _DEPTH:
        raise DataError(f"the topic {topic} has the encoding {encoding!r}, expected one of {', '.join(_DEPTH)}")
    if _is_compressed(message):
        values = _decompress(message, topic)
        if values.dtype != np.uint16 or values.ndim != 2:
            raise DataError(
                f"the topic {topic} has depth images of type {values.dtype} and {values.ndim} axes, expected uint16 "
                "with 2 axes"
            )
    else:
        values = _pixels(message, _DEPTH[encoding], 1, topic)
    if encoding != "32FC1":
        return RangeEncoding(unit_m).photograph_depth(values)
    depth_m = _unquantized(message, values) if _is_compressed(message) else values
    return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.nan).astype(np.float32)


def _is_compressed(message: Any) -> bool:
    return hasattr(message, "format")


def _encoding(message: Any) -> str:
    """Return the encoding of the pixels, such as 16UC1; of a compressed image, the first word of its format."""
    if not _is_compressed(message):
        return str(message.encoding)
    return str(message.format.partition(";")[0].strip())


def _pixels(message: Any, dtype: Any, channels: int, topic: str) -> np.ndarray:
    """Return the pixels of an Image message, without the padding of its rows."""
    width = message.width * channels * np.dtype(dtype).itemsize
    data = np.asarray(message.data, np.uint8)
    if message.step < width or len(data) < message.step * message.height or not width:
        raise DataError(
            f"the topic {topic} has an image of {message.width} x {message.height} {message.encoding} with step "
            f"{message.step} and {len(data)} bytes of data, expected a width over 0, step >= {width}, and at least "
            "step * height bytes"
        )
    rows = data[: message.step * message.height].reshape(message.height, message.step)[:, :width]
    order = ">" if message.is_bigendian else "<"
    values = np.ascontiguousarray(rows).view(np.dtype(dtype).newbyteorder(order)).astype(dtype)
    shape = (message.height, message.width) if channels == 1 else (message.height, message.width, channels)
    return values.reshape(shape)


def _decompress(message: Any, topic: str) -> np.ndarray:
    """Return the pixels of a CompressedImage message as OpenCV decodes them."""
    import cv2

    data = np.asarray(message.data, np.uint8)
    if "compressedDepth" in message.format:
        data = data[_COMPRESSED_DEPTH_HEADER:]
    mode = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
    return decode_image(data.tobytes(), mode, f"an image of the topic {topic}, format {message.format!r},").pixels


def _unquantized(message: Any, steps: np.ndarray) -> np.ndarray:
    """Return the depth in metres from quantized inverse depth, the encoding of compressed_depth_image_transport."""
    a, b = np.frombuffer(np.asarray(message.data, np.uint8)[4:_COMPRESSED_DEPTH_HEADER].tobytes(), "<f4")
    with np.errstate(divide="ignore"):
        return np.where(steps > 0, a / (steps.astype(np.float32) - b), np.nan)
