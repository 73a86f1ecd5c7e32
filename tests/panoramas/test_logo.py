"""Logos at the bottom of panoramas: which rows show one, and what the reader of a folder masks."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_blank_rows import HEIGHT, picture

from salframe.panoramas import images
from salframe.panoramas.folder_format import FrameEntry, write_manifest
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.logo import find_logo, num_logo_rows

ROWS = 50
"""Rows of the logo: a disc with a radius of 25 degrees around the nadir."""
NUM_FRAMES = 5


def with_logo(seed: int, rows: int = ROWS) -> np.ndarray:
    """A picture of its own place with the logo of the camera."""
    rgb = picture(seed)
    rgb[-rows:] = 235
    for column in range(20, 2 * HEIGHT, 180):
        cv2.putText(rgb, "MAKER", (column, HEIGHT - 15), cv2.FONT_HERSHEY_SIMPLEX, 1.0, (20, 60, 160), 3)
    return rgb


def compressed(rgb: np.ndarray, quality: int) -> np.ndarray:
    _, code = cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))


def write_folder(root: Path, pictures: list[np.ndarray], suffix: str = ".png", **manifest: object) -> Path:
    """Write a folder whose frames r0, r1, ... have these pictures."""
    entries = []
    for index, rgb in enumerate(pictures):
        pose = np.eye(4)
        pose[0, 3] = index
        entries.append(
            FrameEntry(
                id=f"r{index}",
                role="map",
                place="room",
                pose=tuple(pose.ravel().tolist()),
                rgb=f"frames/r{index}{suffix}",
            )
        )
        (root / "frames").mkdir(parents=True, exist_ok=True)
        images.write_color(root / f"frames/r{index}{suffix}", rgb)
    write_manifest(root, entries, {}, **manifest)
    return root


def load_all(root: Path):
    folder = Folder(root)
    return [folder.load(entry) for entry in folder.manifest.frames]


def test_the_rows_that_all_pictures_share_are_the_logo() -> None:
    logo = find_logo(with_logo(seed) for seed in range(NUM_FRAMES))
    np.testing.assert_array_equal(logo, with_logo(0)[-ROWS:])
    assert find_logo(picture(seed) for seed in range(NUM_FRAMES)) is None


@pytest.mark.parametrize("quality", [60, 75, 93])
@pytest.mark.parametrize("rows", [50, 53, 59])
def test_a_compressed_logo_has_all_its_rows(quality: int, rows: int) -> None:
    """The edge of the logo is not at the edge of a JPEG block of 16 rows in each case."""
    logo = find_logo(compressed(with_logo(seed), quality) for seed in range(NUM_FRAMES))
    assert logo is not None
    assert ROWS - 16 <= len(logo) <= ROWS


@pytest.mark.parametrize(("count", "has_logo"), [(3, False), (4, True)])
def test_three_pictures_are_not_enough(count: int, has_logo: bool) -> None:
    assert (find_logo(with_logo(seed) for seed in range(count)) is not None) == has_logo


@pytest.mark.parametrize(("rows", "is_logo"), [(7, False), (8, True), (90, True), (91, False)])
def test_the_height_of_a_logo_is_limited(rows: int, is_logo: bool) -> None:
    """A fiftieth of 360 rows is 7.2, and a quarter is 90."""
    assert (find_logo(with_logo(seed, rows) for seed in range(NUM_FRAMES)) is not None) == is_logo


def test_a_camera_that_does_not_move_has_no_logo() -> None:
    noise = np.random.default_rng(0).integers(0, 4, (NUM_FRAMES, HEIGHT, 2 * HEIGHT, 3)).astype(np.uint8)
    assert find_logo(picture() + part for part in noise) is None


def test_a_plain_floor_with_noise_is_no_logo() -> None:
    """The noise of a camera, 3 grey levels, differs between pictures by more than the limit in many pixels."""
    rng = np.random.default_rng(0)
    pictures = []
    for seed in range(NUM_FRAMES):
        rgb = picture(seed)
        rgb[-ROWS:] = np.clip(rng.normal(120, 3, (ROWS, 2 * HEIGHT, 3)), 0, 255)
        pictures.append(rgb)
    assert find_logo(pictures) is None


def test_pictures_of_two_sizes_have_no_common_logo() -> None:
    large = cv2.resize(with_logo(4), (3 * HEIGHT, HEIGHT * 3 // 2), interpolation=cv2.INTER_NEAREST)
    assert find_logo([*(with_logo(seed) for seed in range(4)), large]) is None
    assert num_logo_rows(large, with_logo(0)[-ROWS:]) == 0


def test_a_picture_without_the_logo_has_no_row_of_it() -> None:
    assert num_logo_rows(picture(9), with_logo(0)[-ROWS:]) == 0
    assert num_logo_rows(with_logo(9), with_logo(0)[-ROWS:]) == ROWS


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_folder_masks_the_logo(tmp_path: Path, suffix: str) -> None:
    for panorama in load_all(write_folder(tmp_path, [with_logo(seed) for seed in range(NUM_FRAMES)], suffix)):
        assert panorama.valid is not None
        masked = np.flatnonzero(~panorama.valid.all(axis=1))
        assert len(masked) == ROWS if suffix == ".png" else ROWS - 16 <= len(masked) <= ROWS
        assert (masked == np.arange(HEIGHT - len(masked), HEIGHT)).all()
        assert not panorama.valid[masked].any()
        assert panorama.notes == (
            f"{len(masked)} rows at the bottom are masked: they show the same logo in all panoramas",
        )


def test_frames_of_another_camera_stay_whole(tmp_path: Path) -> None:
    """Eight of twelve frames are compared. The frame r1, which is not among them, has no logo."""
    pictures = [with_logo(seed) for seed in range(12)]
    pictures[1] = picture(1)
    panoramas = load_all(write_folder(tmp_path, pictures))
    assert (panoramas[1].valid, panoramas[1].notes) == (None, ())
    assert all(panorama.valid is not None for index, panorama in enumerate(panoramas) if index != 1)


def test_an_unreadable_picture_costs_only_its_own_frame(tmp_path: Path) -> None:
    root = write_folder(tmp_path, [with_logo(seed) for seed in range(NUM_FRAMES)])
    (root / "frames/r2.png").write_bytes(b"no picture")
    folder = Folder(root)
    panorama = folder.load(folder.manifest.frames[0])
    assert panorama.valid is not None
    assert not panorama.valid[-ROWS:].any()


def test_rendered_panoramas_have_no_logo(tmp_path: Path) -> None:
    root = write_folder(tmp_path, [with_logo(seed) for seed in range(NUM_FRAMES)])
    manifest = json.loads((root / "manifest.json").read_text())
    (root / "manifest.json").write_text(json.dumps({**manifest, "rendered": True}))
    assert all(panorama.valid is None for panorama in load_all(root))


def test_rows_with_a_range_show_a_surface(tmp_path: Path) -> None:
    root = write_folder(tmp_path, [with_logo(seed) for seed in range(NUM_FRAMES)])
    range_m = np.full((HEIGHT, 2 * HEIGHT), np.nan)
    range_m[-20:] = 1.5
    images.write_range(root / "frames/r0.range.png", range_m)
    manifest = json.loads((root / "manifest.json").read_text())
    manifest["frames"][0]["range"] = "frames/r0.range.png"
    (root / "manifest.json").write_text(json.dumps(manifest))
    valid = load_all(root)[0].valid
    assert valid is not None
    np.testing.assert_array_equal(np.flatnonzero(~valid.any(axis=1)), np.arange(HEIGHT - ROWS, HEIGHT - 20))
