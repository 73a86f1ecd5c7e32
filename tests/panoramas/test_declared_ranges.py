"""Encodings of range images that a manifest declares, for a folder or a frame, and heights of floors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tiny_folder import write_tiny_folder

from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas import images
from salframe.panoramas.folder_format import FrameEntry, write_floor, write_panorama
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.range_encoding import RangeEncoding, RangeKind
from salframe.testing.rooms import map_frames

CUBE = RangeEncoding(1 / 512, (65535, 1), RangeKind.CUBE)
DECLARED = {"range_unit_m": 1 / 512, "range_missing": [65535, 1], "range_kind": "cube"}


def edit(root: Path, change) -> Folder:
    path = root / "manifest.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return Folder(root)


def encode(root: Path, frame: FrameEntry) -> np.ndarray:
    """Write the range of a frame in the encoding CUBE, with a window of 65535 and one of 1; return the known range."""
    range_m = images.read_range(root / frame.range)
    steps = CUBE.panorama_steps(range_m)
    steps[60:80, 10:50], steps[90:99, 200:240] = 65535, 1
    images.write_ids(root / frame.range, steps.astype(int))
    range_m[60:80, 10:50] = range_m[90:99, 200:240] = np.nan
    return range_m


def test_a_folder_declares_the_encoding_and_frames_override_it(tmp_path):
    root = write_tiny_folder(tmp_path)
    before = Folder(root)
    first, second, third = before.manifest.frames[:3]
    expected = {frame.id: encode(root, frame) for frame in (first, second)}
    expected[third.id] = images.read_range(root / third.range)

    def declare(content):
        content.update(DECLARED)
        content["frames"][2].update(range_unit_m=0.001, range_missing=[], range_kind="ray")

    folder = edit(root, declare)
    for frame in folder.manifest.frames[:3]:
        panorama = folder.load(frame)
        np.testing.assert_allclose(panorama.range_m, expected[frame.id], atol=0.003)
        assert panorama.range_m.dtype == np.float32
        assert panorama.range_encoding == (RangeEncoding() if frame.id == third.id else CUBE)


@pytest.mark.parametrize("key", DECLARED)
def test_a_declaration_changes_the_fingerprint(tmp_path, key):
    root = write_tiny_folder(tmp_path)
    before = Folder(root).fingerprint
    assert edit(root, lambda content: content.update({key: DECLARED[key]})).fingerprint != before


def test_an_entry_writes_in_its_encoding(tmp_path):
    range_m = map_frames()[0].load().range_m
    entry = FrameEntry(id="a", role="query", range="a.png", **DECLARED)
    write_panorama(tmp_path, entry, range_m=range_m)
    np.testing.assert_allclose(images.read_range(tmp_path / "a.png", CUBE), range_m, atol=0.003)
    np.testing.assert_array_equal(images.read_ids(tmp_path / "a.png"), CUBE.panorama_steps(range_m))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"range_kind": "z"}, r"range_kind.*'cube' \(depth along the axis of the cube face of each pixel\)"),
        ({"range_kind": "depth"}, "range_kind"),
        ({"range_unit_m": 0}, "range_unit_m"),
        ({"range_missing": [70000]}, "range_missing"),
        ({"range_missing": [0.5]}, "range_missing"),
        ({"range_missing": 65535}, "range_missing"),
    ],
)
@pytest.mark.parametrize("of_frame", [False, True])
def test_wrong_declarations_are_one_line(tmp_path, values, message, of_frame):
    root = write_tiny_folder(tmp_path)
    with pytest.raises((DataError, ConfigError), match=message) as error:
        edit(root, lambda content: (content["frames"][0] if of_frame else content).update(values))
    assert "\n" not in str(error.value)


def floors(root: Path, heights_m: list[float | None], cameras_m: list[float]) -> Folder:
    """Return the folder with floors at these heights, and reference frames whose cameras are at these z."""
    from test_region_check import masks

    entries = [write_floor(root, f"floor-{i}", masks()).model_dump(mode="json") for i in range(len(heights_m))]

    def change(content):
        for entry, height_m in zip(entries, heights_m, strict=True):
            entry.pop("z_m")
            content.setdefault("floors", []).append({**entry, **({} if height_m is None else {"z_m": height_m})})
        for frame, camera_m in zip((f for f in content["frames"] if "pose" in f), cameras_m, strict=True):
            frame["pose"][11] = camera_m

    return edit(root, change)


@pytest.mark.parametrize(
    ("cameras_m", "floor_m"),
    [((1.5, 1.4, 1.6), 0.0), ((0.0, 0.0, 0.0), 0.0), ((121.5, 121.4, 122.0), 119.9), ((2.9, 1.0, 2.0), 0.1)],
)
def test_a_floor_without_height_lies_below_the_cameras(tmp_path, cameras_m, floor_m):
    (floor,) = floors(write_tiny_folder(tmp_path), [None], list(cameras_m)).floors()
    assert floor.z_m == pytest.approx(floor_m)


@pytest.mark.parametrize(
    ("heights_m", "cameras_m", "message"),
    [
        ([None, None], (1.5, 1.5, 4.5), "2 of 2 floors have no z_m, expected the height of each floor"),
        ([0.0, None], (1.5, 1.5, 4.5), "1 of 2 floors have no z_m"),
        (
            [None],
            (1.5, 1.5, 4.5),
            "the floor has no z_m, expected .* span more than one storey \\(z = 1.50 to 4.50 m\\)",
        ),
        (
            [3.0, 3.0],
            (1.5, 1.5, 4.5),
            "two floors whose masks overlap or touch have z_m = 3 .*, expected a different z_m for each floor",
        ),
    ],
)
def test_heights_are_required_where_storeys_differ(tmp_path, heights_m, cameras_m, message):
    folder = floors(write_tiny_folder(tmp_path), heights_m, list(cameras_m))
    with pytest.raises(DataError, match=message):
        folder.floors()
