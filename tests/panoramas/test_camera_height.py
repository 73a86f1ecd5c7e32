"""Cameras over floors at known heights, and ranges in wrong units."""

from __future__ import annotations

import os
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas.camera_height import camera_height, units_note
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.images import read_range
from salframe.panoramas.panorama import Panorama
from salframe.testing.rooms import EYE_M, ROOMS, Box, FurnishedRoom, look, map_frames, stand

REAL = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")) / "matterport3d"


def box_range(height_m: float, side_m: float = 5.0, above_m: float = 1.2, rows: int = 256) -> np.ndarray:
    """Range to the inside of a square room whose floor lies height_m below the camera in its middle."""
    rays = np.abs(equirectangular_rays(rows)).astype(np.float64)
    down = np.where(equirectangular_rays(rows)[..., 2] < 0, height_m, above_m)
    return np.minimum(down / rays[..., 2], side_m / 2 / rays[..., :2].max(-1)).astype(np.float32)


def frames(range_m: np.ndarray) -> list[QueryFrame]:
    return [QueryFrame("q", partial(Panorama, "q", range_m=range_m))]


@pytest.mark.parametrize("height_m", [0.3, 0.5, 1.0, 1.5, 2.5, 6.0])
@pytest.mark.parametrize("rows", [64, 256, 1000])
def test_the_height_is_that_of_the_floor(height_m, rows):
    assert camera_height(box_range(height_m, rows=rows)) == pytest.approx(height_m, rel=0.02)


def test_noise_and_holes_do_not_matter():
    rng = np.random.default_rng(0)
    range_m = box_range(1.4, rows=512)
    range_m *= 1 + rng.normal(0, 0.01, range_m.shape).astype(np.float32)
    range_m[rng.random(range_m.shape) < 0.05] = np.nan
    assert camera_height(range_m) == pytest.approx(1.4, rel=0.03)


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
@pytest.mark.parametrize("x_share", [0.35, 0.5, 0.65])
def test_furniture_is_no_floor(room, x_share):
    assert camera_height(look(room, "a", stand(room, x_share)).range_m) == pytest.approx(EYE_M, rel=0.02)


def test_the_floor_beside_a_table_under_the_camera_counts():
    table = FurnishedRoom("canteen", (6.0, 5.0, 2.6), (Box("table", (3.0, 2.5, 0.36), (2.0, 1.2, 0.72)),))
    assert camera_height(look(table, "a", stand(table)).range_m) == pytest.approx(EYE_M, rel=0.02)


def test_where_no_floor_is_seen_there_is_no_height():
    range_m = box_range(1.5)
    range_m[128:] = np.nan
    assert camera_height(range_m) is None
    narrow = np.full_like(range_m, np.nan)
    narrow[118:138] = box_range(1.5)[118:138]  # a partial panorama of 14 degrees about the horizon
    assert camera_height(narrow) is None
    assert camera_height(np.full((64, 128), np.nan, np.float32)) is None
    assert units_note(frames(narrow)) is None


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (4.0, "the floor lies 6 m below .* about 4 times too large, likely quarter millimetres read as millimetres"),
        (1 / 0.3048, "about 3.28 times too large, likely feet read as metres"),
        (10.0, "about 10 times too large, likely tenths of a millimetre read as millimetres"),
        (1000.0, "about 1000 times too large, likely millimetres read as metres"),
        (0.25, "about 4 times too small, likely millimetres read as quarter millimetres"),
        (0.2, "the floor lies 0.3 m below .* about 5 times too small, likely millimetres read as fifths"),
        (0.1, "about 10 times too small, likely centimetres read as millimetres"),
        (0.001, "about 1000 times too small, likely metres read as millimetres"),
    ],
)
def test_a_wrong_unit_is_named(factor, said):
    note = units_note(frames(box_range(1.5) * np.float32(factor)))
    assert re.search(said, note), note
    assert "\n" not in note


@pytest.mark.parametrize("height_m", [0.5, 1.0, 1.7, 2.5])
def test_no_handheld_camera_is_warned_of(height_m):
    assert units_note(frames(box_range(height_m))) is None


def test_frames_that_tell_nothing_are_passed_over():
    def broken():
        raise DataError("no image")

    silent = [QueryFrame("a", broken), QueryFrame("b", lambda: Panorama("b", rgb=np.zeros((8, 16, 3), np.uint8)))]
    assert units_note([]) is units_note(silent) is None
    assert "(in q)" in units_note([*silent, *frames(box_range(1.5) * 4)])
    assert units_note(map_frames()) is None


def test_only_a_few_frames_are_loaded():
    loaded = []

    def load(name):
        loaded.append(name)
        return Panorama(name, range_m=box_range(6.0))

    units_note([QueryFrame(str(i), partial(load, str(i))) for i in range(100)])
    assert loaded == ["0", "50", "99"]


@pytest.mark.skipif(not (REAL / "rgbd").exists(), reason=f"the shared RGB-D viewpoint is not at hand: no {REAL}")
def test_a_real_viewpoint_in_quarter_millimetres():
    read_as_mm = read_range(REAL / "rgbd" / "reference_range.png")
    assert "4 times too large, likely quarter millimetres" in units_note(frames(read_as_mm))
    assert units_note(frames(read_as_mm / 4)) is None
