"""Black bands at the poles of panoramas: which rows are blank, and what the file reader masks."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_photo_sphere import CROP, packet, write
from tiny_folder import write_tiny_folder

from salframe.panoramas import images
from salframe.panoramas.blank_rows import blank_rows
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.geometry import equirectangular_rays, row_elevation
from salframe.panoramas.line_segments import find_segments
from salframe.panoramas.shot import open_panorama, read_panorama

HEIGHT = 360
"""Height of the pictures: two rows a degree."""
ZENITH_ROWS, NADIR_ROWS = 30, 50
"""Rows of a cap with a radius of 15 degrees at the zenith and of one with a radius of 25 degrees at the nadir."""


def picture(seed: int = 0) -> np.ndarray:
    """A smooth picture with values from 60 to 220."""
    cells = np.random.default_rng(seed).integers(60, 220, (12, 24, 3)).astype(np.uint8)
    return cv2.resize(cells, (2 * HEIGHT, HEIGHT), interpolation=cv2.INTER_LINEAR)


def capped() -> np.ndarray:
    """The picture with black caps at both poles."""
    elevation_deg = np.degrees(row_elevation(HEIGHT))
    return np.where(((elevation_deg < 75) & (elevation_deg > -65))[:, None, None], picture(), np.uint8(0))


def caps() -> np.ndarray:
    """The rows of the caps."""
    return np.r_[np.ones(ZENITH_ROWS, bool), np.zeros(HEIGHT - 80, bool), np.ones(NADIR_ROWS, bool)]


def test_caps_of_both_poles_are_blank() -> None:
    np.testing.assert_array_equal(blank_rows(capped()), caps())
    assert not blank_rows(picture()).any()


@pytest.mark.parametrize(("rows", "is_blank"), [(7, False), (8, True)])
def test_a_band_has_at_least_a_fiftieth_of_the_rows(rows: int, is_blank: bool) -> None:
    """A fiftieth of 360 rows is 7.2."""
    rgb = picture()
    rgb[-rows:] = 0
    assert blank_rows(rgb).sum() == rows * is_blank


def test_one_brighter_pixel_ends_a_band() -> None:
    rgb = capped()
    rgb[-20, 100, 1] = 41
    assert blank_rows(rgb)[-19:].all()
    assert not blank_rows(rgb)[ZENITH_ROWS:-19].any()


def test_a_dark_floor_with_noise_is_not_blank() -> None:
    """Noise of 2 grey levels around 2: some pixels of every row are above 4."""
    noise = np.random.default_rng(0).normal(2, 2, (NADIR_ROWS, 2 * HEIGHT, 3))
    rgb = picture()
    rgb[-NADIR_ROWS:] = np.clip(np.round(noise), 0, 255)
    assert not blank_rows(rgb).any()


@pytest.mark.parametrize("quality", [75, 85, 93])
@pytest.mark.parametrize("rows", [50, 53, 59])
def test_compressed_caps_are_blank_up_to_their_edge(quality: int, rows: int) -> None:
    """The edge of the cap is not at the edge of a JPEG block of 16 rows in each case."""
    rgb = picture()
    rgb[-rows:] = 0
    _, code = cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, quality])
    blank = blank_rows(np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR)))
    np.testing.assert_array_equal(np.flatnonzero(blank), np.arange(HEIGHT - rows, HEIGHT))


def test_rows_with_a_range_are_not_blank() -> None:
    """A single known range in row 340 shows a surface there; only the 19 rows below it are blank."""
    range_m = np.full((HEIGHT, 2 * HEIGHT), np.nan, np.float32)
    range_m[340, 5] = 1.5
    blank = blank_rows(capped(), range_m)
    expected = caps()
    expected[HEIGHT - NADIR_ROWS : 341] = False
    np.testing.assert_array_equal(blank, expected)
    assert not blank_rows(capped(), np.full_like(range_m, 1.5)).any()


def test_a_black_picture_has_no_blank_rows(tmp_path: Path) -> None:
    black = np.full((HEIGHT, 2 * HEIGHT, 3), 4, np.uint8)
    assert not blank_rows(black).any()
    images.write_color(tmp_path / "black.png", black)
    assert read_panorama(tmp_path / "black.png").valid is None


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_read_pictures_are_masked(tmp_path: Path, suffix: str) -> None:
    images.write_color(tmp_path / f"a{suffix}", capped())
    for panorama in (read_panorama(tmp_path / f"a{suffix}"), open_panorama(tmp_path / f"a{suffix}").panorama):
        np.testing.assert_array_equal(panorama.valid, np.broadcast_to(~caps()[:, None], (HEIGHT, 2 * HEIGHT)))
        assert panorama.notes == ("80 black rows at the top or bottom are masked",)
    images.write_color(tmp_path / f"b{suffix}", picture())
    assert (read_panorama(tmp_path / f"b{suffix}").valid, read_panorama(tmp_path / f"b{suffix}").notes) == (None, ())


def test_the_range_file_decides(tmp_path: Path) -> None:
    """With the range of the floor, the rows of the nadir stay. The zenith, without range, is masked."""
    range_m = np.where(caps()[:, None], np.nan, np.full((HEIGHT, 2 * HEIGHT), 2.0))
    range_m[-NADIR_ROWS:] = 1.5
    images.write_color(tmp_path / "a.png", capped())
    images.write_range(tmp_path / "a.range.png", range_m)
    valid = read_panorama(tmp_path / "a.png", tmp_path / "a.range.png").valid
    assert valid is not None
    np.testing.assert_array_equal(valid.all(axis=1), np.arange(HEIGHT) >= ZENITH_ROWS)


def test_the_mask_of_a_folder_is_combined(tmp_path: Path) -> None:
    root = write_tiny_folder(tmp_path)
    manifest = json.loads((root / "manifest.json").read_text())
    entry = manifest["frames"][0]
    half = np.ones((192, 384), bool)
    half[:, :192] = False
    rgb = images.read_color(root / entry["rgb"])
    rgb[-20:] = 0
    images.write_color(root / entry["rgb"], rgb)
    images.write_mask(root / "half.png", half)
    entry |= {"valid": "half.png"}
    del entry["range"], entry["instances"]
    (root / "manifest.json").write_text(json.dumps(manifest))
    folder = Folder(root)
    half[-20:] = False
    panorama = folder.load(folder.manifest.frames[0])
    np.testing.assert_array_equal(panorama.valid, half)
    assert len(panorama.notes) == 1
    images.write_mask(root / "half.png", half)
    assert folder.load(folder.manifest.frames[0]).notes == ()  # the file masks the rows already
    images.write_mask(root / "half.png", np.zeros_like(half))
    np.testing.assert_array_equal(folder.load(folder.manifest.frames[0]).valid, np.zeros_like(half))
    assert folder.load(folder.manifest.frames[1]).valid is None


def test_the_patch_of_a_tilted_camera_is_turned_with_the_picture(tmp_path: Path) -> None:
    """The front of the camera looks 20 degrees up, so that its nadir is tilted by 20 degrees to the front."""
    rgb = np.full((256, 512, 3), 120, np.uint8)
    rgb[-36:] = 0
    path = write(tmp_path / "a.png", rgb, packet(ProjectionType="equirectangular", PosePitchDegrees=20))
    valid = read_panorama(path).valid
    assert valid is not None
    nadir = np.array([np.sin(np.radians(20)), 0, -np.cos(np.radians(20))])
    angle_deg = np.degrees(np.arccos(equirectangular_rays(256) @ nadir))
    border = abs(angle_deg - 36 * 180 / 256) < 1.5
    np.testing.assert_array_equal(valid[~border], (angle_deg > 25)[~border])


def test_the_dark_edge_of_a_crop_is_not_masked(tmp_path: Path) -> None:
    """The rows outside of the crop are black, but its own dark rows are not a fringe of them."""
    rgb = np.full((100, 256, 3), 120, np.uint8)
    rgb[-10:] = 30
    panorama = read_panorama(write(tmp_path / "a.png", rgb, packet(**CROP)))
    assert panorama.valid is not None
    assert panorama.valid.sum() == 100 * 256
    rgb[-10:] = 0
    panorama = read_panorama(write(tmp_path / "b.png", rgb, packet(**CROP)))
    assert panorama.valid is not None
    assert panorama.valid.sum() == 90 * 256


def test_lines_of_the_edge_are_ignored(tmp_path: Path) -> None:
    """The only straight edge of the picture is that of the patch."""
    rgb = np.full((HEIGHT, 2 * HEIGHT, 3), 150, np.uint8)
    rgb[-NADIR_ROWS:] = 0
    images.write_color(tmp_path / "a.jpg", rgb)
    panorama = read_panorama(tmp_path / "a.jpg")
    assert panorama.rgb is not None
    assert len(find_segments(panorama.rgb, None)) > 10
    assert len(find_segments(panorama.rgb, panorama.valid)) == 0
