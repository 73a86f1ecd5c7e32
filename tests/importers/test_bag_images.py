from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from salframe_import.bag_images import color_image, depth_image, image_size, is_depth

from salframe.framework.errors import DataError

RED, GREEN, BLUE = (200, 30, 20), (10, 180, 40), (30, 20, 220)
PIXELS = np.array([[RED, GREEN, BLUE, RED], [BLUE, RED, GREEN, GREEN]], np.uint8)


def image(pixels: np.ndarray, encoding: str, *, padding: int = 0, big_endian: bool = False) -> Any:
    if big_endian:
        pixels = pixels.astype(pixels.dtype.newbyteorder(">"))
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    return SimpleNamespace(
        height=len(pixels),
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=int(big_endian),
        step=rows.shape[1],
        data=rows.ravel(),
    )


def compressed(data: bytes, format: str) -> Any:
    return SimpleNamespace(format=format, data=np.frombuffer(data, np.uint8))


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", PIXELS),
        ("bgr8", PIXELS[..., ::-1]),
        ("8UC3", PIXELS[..., ::-1]),
        ("rgba8", np.dstack([PIXELS, np.full((2, 4), 9, np.uint8)])),
        ("bgra8", np.dstack([PIXELS[..., ::-1], np.full((2, 4), 9, np.uint8)])),
    ],
)
def test_color_encodings(encoding, pixels, padding):
    assert np.array_equal(color_image(image(pixels, encoding, padding=padding), "/a"), PIXELS)


def test_grey_images():
    grey = np.arange(8, dtype=np.uint8).reshape(2, 4)
    assert np.array_equal(color_image(image(grey, "mono8"), "/a"), np.dstack([grey] * 3))


@pytest.mark.parametrize(
    ("encoding", "pattern"),
    [("bayer_rggb8", "RGGB"), ("bayer_bggr8", "BGGR"), ("bayer_gbrg8", "GBRG"), ("bayer_grbg8", "GRBG")],
)
def test_bayer_patterns(encoding, pattern):
    """A patch of one colour: a sensor pixel has the value of the colour of its filter."""
    values = {"R": RED[0], "G": RED[1], "B": RED[2]}
    cell = np.array([values[letter] for letter in pattern], np.uint8).reshape(2, 2)
    decoded = color_image(image(np.tile(cell, (4, 4)), encoding), "/a")
    assert np.array_equal(decoded[4, 4], RED)


@pytest.mark.parametrize(("encoding", "order"), [("uyvy", "uyvy"), ("yuv422", "uyvy"), ("yuyv", "yuyv")])
def test_yuv_images(encoding, order):
    # Red by BT.601 with the range of video: Y = 16 + 0.257 R + 0.504 G + 0.098 B, U and V around 128.
    r, g, b = RED
    y = 16 + 0.257 * r + 0.504 * g + 0.098 * b
    u, v = 128 - 0.148 * r - 0.291 * g + 0.439 * b, 128 + 0.439 * r - 0.368 * g - 0.071 * b
    two_pixels = {"uyvy": [u, y, v, y], "yuyv": [y, u, y, v]}[order]
    pixels = np.tile(np.rint(two_pixels).astype(np.uint8), (2, 2)).reshape(2, 4, 2)
    assert np.allclose(color_image(image(pixels, encoding), "/a"), RED, atol=3)


def test_compressed_pictures():
    data = cv2.imencode(".png", PIXELS[..., ::-1])[1].tobytes()
    message = compressed(data, "bgr8; png compressed bgr8")
    assert np.array_equal(color_image(message, "/a"), PIXELS)
    assert image_size(message, "/a") == (4, 2)
    assert not is_depth(message)


def test_depth_in_millimetres_and_metres():
    steps = np.array([[0, 1500], [2000, 65535]], np.uint16)
    expected = np.array([[np.nan, 1.5], [2.0, 65.535]], np.float32)
    for message in (image(steps, "16UC1"), image(steps, "mono16", padding=6), image(steps, "16UC1", big_endian=True)):
        assert is_depth(message)
        assert np.allclose(depth_image(message, "/d", 0.001), expected, equal_nan=True)
    assert depth_image(image(steps, "16UC1"), "/d", 0.00025)[0, 1] == pytest.approx(0.375)
    metres = np.array([[0, np.nan], [np.inf, 2.5]], np.float32)
    decoded = depth_image(image(metres, "32FC1"), "/d", 0.001)
    assert np.array_equal(decoded, np.array([[np.nan, np.nan], [np.nan, 2.5]], np.float32), equal_nan=True)


def test_compressed_depth():
    """The format of compressed_depth_image_transport: 12 bytes, then a PNG; floats as quantized inverse depth."""
    steps = np.array([[0, 1500], [2000, 3000]], np.uint16)
    png = cv2.imencode(".png", steps)[1].tobytes()
    message = compressed(struct.pack("<iff", 0, 0, 0) + png, "16UC1; compressedDepth png")
    assert is_depth(message)
    assert np.allclose(depth_image(message, "/d", 0.001), [[np.nan, 1.5], [2, 3]], equal_nan=True)
    a, b = 100.0 * 101.0, 100.0  # depth quantization 100, maximum depth 10 m, as in the transport
    depth_m = np.array([[np.nan, 0.5], [2.0, 8.0]])
    inverse = np.where(np.isnan(depth_m), 0, np.rint(a / depth_m + b)).astype(np.uint16)
    png = cv2.imencode(".png", inverse)[1].tobytes()
    message = compressed(struct.pack("<iff", 0, a, b) + png, "32FC1; compressedDepth png")
    assert np.allclose(depth_image(message, "/d", 0.001), depth_m, rtol=0.001, equal_nan=True)


def test_errors_name_the_topic():
    with pytest.raises(DataError, match=r"the topic /a has the encoding 'bayer_rggb16', expected one of mono8, "):
        color_image(image(PIXELS, "bayer_rggb16"), "/a")
    short = image(PIXELS, "rgb8")
    short.data = short.data[:-1]
    with pytest.raises(DataError, match=r"the topic /a has an image of 4 x 2 rgb8 with step 12 and 23 bytes of data"):
        color_image(short, "/a")
    with pytest.raises(DataError, match=r"an image of the topic /a, format 'jpeg', is not a readable image"):
        color_image(compressed(b"no picture", "jpeg"), "/a")
    with pytest.raises(DataError, match=r"the topic /d has the encoding 'rgb8', expected one of 16UC1, mono16, 32FC1"):
        depth_image(image(PIXELS, "rgb8"), "/d", 0.001)
