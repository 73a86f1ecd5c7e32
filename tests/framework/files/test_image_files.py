"""Whole pictures are read and cut ones refused, whatever follows them; large ones are reduced."""

from __future__ import annotations

import io
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from salframe.framework.errors import DataError
from salframe.framework.files import image_files
from salframe.framework.files.image_files import read_image, read_image_file

RNG = np.random.default_rng(38)
PICTURE = cv2.resize(RNG.integers(0, 255, (16, 32, 3), np.uint8), (256, 128), interpolation=cv2.INTER_CUBIC)
TRAILERS = {
    "nothing": b"",
    "end of image": b"\xff\xd9",
    "zeros": b"\0" * 200 + b"\xff\xd9",
    "start of scan": b"\xff\xda\0\0",
    "video": b"\0\0\0\x18ftypmp42" + RNG.bytes(3000),
    "text": b"SEFT camera information " * 4,
}


def jpeg(image=PICTURE, **options) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "JPEG", quality=92, **options)
    return stream.getvalue()


WHOLE = {
    "baseline": jpeg(),
    "progressive": jpeg(progressive=True),
    "grey": jpeg(PICTURE[..., 0]),
    "restarts": jpeg(restart_marker_blocks=4),
}


@pytest.mark.parametrize("trailer", [*TRAILERS.values(), WHOLE["baseline"]], ids=[*TRAILERS, "another picture"])
@pytest.mark.parametrize("whole", WHOLE.values(), ids=WHOLE)
def test_bytes_after_a_picture_are_ignored(tmp_path, whole, trailer):
    (tmp_path / "a.jpg").write_bytes(whole)
    (tmp_path / "b.jpg").write_bytes(whole + trailer)
    one, other = (read_image(tmp_path / name, cv2.IMREAD_COLOR) for name in ("a.jpg", "b.jpg"))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("trailer", [*TRAILERS.values(), WHOLE["baseline"]], ids=[*TRAILERS, "another picture"])
@pytest.mark.parametrize("whole", WHOLE.values(), ids=WHOLE)
def test_a_cut_picture_is_refused_whatever_follows(tmp_path, whole, trailer):
    for share in (0.5, 0.7, 0.9):
        (tmp_path / "a.jpg").write_bytes(whole[: int(share * len(whole))] + trailer)
        with pytest.raises(DataError, match=r"a\.jpg is not a readable image .*expected a complete JPEG or PNG"):
            read_image(tmp_path / "a.jpg", cv2.IMREAD_COLOR)


def test_pictures_of_two_images_are_read(tmp_path):
    """The multi-picture format (MPO) of cameras with two lenses: the first picture counts."""
    first, second = Image.fromarray(PICTURE), Image.fromarray(255 - PICTURE)
    first.save(tmp_path / "a.jpg", "MPO", save_all=True, append_images=[second], quality=92)
    read = read_image(tmp_path / "a.jpg", cv2.IMREAD_COLOR)[..., ::-1]
    assert np.abs(read.astype(int) - PICTURE).mean() < 5


@pytest.mark.parametrize("trailer", [b"", b"\0\0\0\0IEND\xaeB`\x82"])
def test_a_cut_png_is_refused_and_a_trailer_ignored(tmp_path, trailer):
    whole = cv2.imencode(".png", RNG.integers(0, 65535, (64, 128), np.uint16))[1].tobytes()
    (tmp_path / "a.png").write_bytes(whole + trailer)
    assert read_image(tmp_path / "a.png", cv2.IMREAD_UNCHANGED).shape == (64, 128)
    (tmp_path / "a.png").write_bytes(whole[: len(whole) // 2] + trailer)
    with pytest.raises(DataError, match=r"a\.png is not a readable image"):
        read_image(tmp_path / "a.png", cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("format", ["TIFF", "WEBP"])
def test_other_formats_are_refused(tmp_path, format):
    Image.fromarray(PICTURE).save(tmp_path / "a.jpg", format)
    with pytest.raises(DataError, match="expected a complete JPEG or PNG"):
        read_image(tmp_path / "a.jpg", cv2.IMREAD_COLOR)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_large_picture_is_halved(tmp_path, suffix, monkeypatch):
    """1158 x 579: odd numbers of rows stay in the ratio of the file."""
    monkeypatch.setattr(image_files, "MAX_DECODED_PIXELS", 1 << 19)
    smooth = cv2.resize(RNG.integers(0, 255, (8, 16, 3), np.uint8), (1158, 579), interpolation=cv2.INTER_LINEAR)
    cv2.imwrite(str(tmp_path / f"a{suffix}"), smooth)
    file = read_image_file(tmp_path / f"a{suffix}", cv2.IMREAD_COLOR)
    assert file.pixels.shape == (289, 578, 3)
    assert file.note == "reduced from 1158 x 579 to 578 x 289 pixels while reading"
    assert np.abs(cv2.resize(file.pixels, (1158, 579)).astype(int) - smooth).mean() < 2
    ids = np.kron(RNG.integers(0, 65535, (289, 579), np.uint16), np.ones((2, 2), np.uint16))
    cv2.imwrite(str(tmp_path / "ids.png"), ids)
    assert set(np.unique(read_image(tmp_path / "ids.png", cv2.IMREAD_UNCHANGED))) <= set(np.unique(ids))


def test_a_photo_of_72_megapixels_is_read(tmp_path):
    cv2.imwrite(str(tmp_path / "a.jpg"), np.full((5984, 11968, 3), 90, np.uint8))
    assert read_image(tmp_path / "a.jpg", cv2.IMREAD_COLOR).shape == (2992, 5984, 3)


def test_a_bomb_is_refused_with_advice(tmp_path):
    """A PNG of 30000 x 15000 pixels in a few kilobytes."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return len(content).to_bytes(4, "big") + kind + content + zlib.crc32(kind + content).to_bytes(4, "big")

    header = (30000).to_bytes(4, "big") + (15000).to_bytes(4, "big") + b"\x08\x02\0\0\0"
    parts = [chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(b"\0" * 1000)), chunk(b"IEND", b"")]
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    with pytest.raises(
        DataError, match="is 30000 x 15000, expected at most 268435456 pixels in total: reduce the size of the image"
    ):
        read_image(tmp_path / "a.png", cv2.IMREAD_COLOR)
