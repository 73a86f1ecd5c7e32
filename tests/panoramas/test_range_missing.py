"""Values without a reading that nobody declared: rendered buildings, drawn rooms, and real range images."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from salframe.framework.components.registry import registry
from salframe.panoramas import images
from salframe.panoramas.geometry import row_elevation
from salframe.panoramas.opening import configure_dataset
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_encoding import RangeEncoding
from salframe.panoramas.range_missing import missing_note, missing_values
from salframe.testing.rooms import map_frames

SHARED = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))
VALUES = 65535, 1, 100, 255, 8000, 10000


@cache
def ranges_of_rooms() -> list[np.ndarray]:
    return [frame.load().range_m for frame in map_frames()]


def steps_of_rooms(encoding: RangeEncoding) -> list[np.ndarray]:
    return [encoding.panorama_steps(range_m) for range_m in ranges_of_rooms()]


def speckles(rng: np.random.Generator, shape: tuple[int, int], share: float) -> np.ndarray:
    return rng.random(shape) < share


def blobs(rng: np.random.Generator, shape: tuple[int, int], share: float) -> np.ndarray:
    """Return rectangles, such as windows and mirrors, between the poles."""
    height, width = shape
    mask = np.zeros(shape, bool)
    while (missing := share - mask.mean()) > 0:
        sides = rng.uniform(0.05, 0.25, 2) * height
        rows, columns = np.maximum(2, sides * min(1, np.sqrt(1.2 * missing * mask.size / sides.prod()))).astype(int)
        row, column = rng.integers(height // 5, 4 * height // 5 - 1), rng.integers(width)
        mask[row : row + rows, np.arange(column, column + columns) % width] = True
    return mask


def detected(steps: np.ndarray) -> list[int]:
    return list(missing_values(steps, np.cos(row_elevation(len(steps)))[:, None]))


def panoramas(steps: list[np.ndarray], encoding: RangeEncoding) -> list[Panorama]:
    return [Panorama(f"p{i}", range_m=encoding.panorama_range(s), range_encoding=encoding) for i, s in enumerate(steps)]


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("pattern", [speckles, blobs])
@pytest.mark.parametrize("encoding", [RangeEncoding(), RangeEncoding(kind="cube"), RangeEncoding(1 / 512)])
def test_the_note_names_value_share_and_key(value, pattern, encoding):
    rng, steps = np.random.default_rng(1), steps_of_rooms(encoding)
    for image in steps:
        image[pattern(rng, image.shape, 0.1)] = value
    note = missing_note(panoramas(steps, encoding))
    assert note is not None
    assert note.startswith(f"the value {value} fills ")
    assert 0.08 < float(note.split("fills ")[1].split("%")[0]) / 100 < 0.16  # by solid angle
    assert f'set "range_missing": [{value}] in manifest.json' in note
    assert "\n" not in note


def test_nothing_is_reported_of_clean_or_declared_ranges():
    encoding = RangeEncoding(missing=(65535,))
    steps = steps_of_rooms(encoding)
    assert missing_note(panoramas(steps, encoding)) is None
    for image in steps:
        image[: len(image) // 6] = 0  # a tripod, sky
        image[speckles(np.random.default_rng(0), image.shape, 0.05)] = 65535
    assert missing_note(panoramas(steps, encoding)) is None
    assert missing_note([]) is missing_note([Panorama("blind", np.zeros((8, 16, 3), np.uint8))]) is None


def test_declared_values_stay_in_the_advice():
    encoding = RangeEncoding(missing=(65535,))
    steps = steps_of_rooms(encoding)
    for image in steps:
        image[blobs(np.random.default_rng(0), image.shape, 0.1)] = 1
    assert '"range_missing": [1, 65535]' in missing_note(panoramas(steps, encoding))
    arrays = [replace(panorama, range_encoding=None) for panorama in panoramas(steps, encoding)]
    note = missing_note(arrays)
    assert note.startswith("the value 0.001 m fills")
    assert note.endswith("set the range of these pixels to NaN")


@pytest.mark.parametrize("limit", [2000, 3000, 4000])
def test_ranges_at_the_limit_of_a_sensor_are_no_missing_value(limit):
    for image in steps_of_rooms(RangeEncoding()):
        assert detected(np.minimum(image, limit)) == []
        assert detected(np.where(image > 0, np.maximum(image, 1000), 0)) == []


@pytest.mark.skipif(not (SHARED / "matterport3d" / "rgbd").is_dir(), reason="no real range images")
def test_nothing_is_reported_of_real_range_images():
    assert detected(images.read_ids(SHARED / "matterport3d" / "rgbd" / "reference_range.png")) == []
    photographs = sorted((SHARED.parent / "photos" / "nyu" / "depth").glob("*.png"))
    assert photographs
    for path in photographs:
        assert missing_values(images.read_ids(path)) == {}


def rendered_steps(name: str, seed: int, count: int) -> list[np.ndarray]:
    """Return range images of `count` reference frames of a rendered building, in millimetres."""
    _, config = configure_dataset(name, None, [{"seed": seed, "rgb": False}])
    house = registry().build("dataset", config)
    frames = [frame for frame in house.list_frames() if not frame.is_query]
    chosen = np.linspace(0, len(frames) - 1, count).round().astype(int)
    return [RangeEncoding().panorama_steps(house.render(frames[i]).range_m) for i in chosen]


@pytest.mark.slow
@pytest.mark.parametrize("pattern", [speckles, blobs])
def test_missing_values_of_rendered_folders_are_found(pattern):
    """Prints the curve: the number of 20 folders with a report, by value and share of the pixels."""
    shares = 0.01, 0.02, 0.05, 0.1, 0.2, 0.5
    folders = [rendered_steps("house-6", seed, 3) for seed in range(1, 21)]
    rng = np.random.default_rng(0)
    print(f"\n{pattern.__name__:>10}", *(f"{share:6.0%}" for share in shares))
    for value in VALUES:
        reported = [
            sum(
                any(detected(np.where(pattern(rng, image.shape, share), value, image)) == [value] for image in folder)
                for folder in folders
            )
            for share in shares
        ]
        print(f"{value:10}", *(f"{count:6}" for count in reported))
        assert min(reported) >= 19


@pytest.mark.slow
@pytest.mark.parametrize("name", ["house-6", "house-12", "house-42", "house-106"])
def test_nothing_is_reported_of_rendered_buildings(name):
    for seed in range(5):
        for image in rendered_steps(name, seed, 5):
            for steps in (image, np.minimum(image, 5000), np.round(image * 0.512).astype(int), image // 10):
                assert detected(steps) == []
