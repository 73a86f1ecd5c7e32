"""Floor masks that contradict the places of the frames: refused where a map is built, reported by `data info`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run
from tiny_folder import write_tiny_folder

from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder_format import write_floor, write_manifest
from salframe.panoramas.folder_reader import Folder

BEGIN = "3 of 3 reference frames (panoramas of the map) stand outside the region of their place in the floor masks: "
CAUSE = "names in `regions` may be swapped"


@pytest.fixture
def swapped(tmp_path, monkeypatch):
    """Three rooms, each 4 m around its frame, with the names of the regions exchanged."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    root = write_tiny_folder(tmp_path / "data")
    folder = Folder(root)
    references = [frame for frame in folder.manifest.frames if frame.role == "map"]
    xy_m = np.array([[frame.pose[3], frame.pose[7]] for frame in references])
    left_m, top_m = xy_m[:, 0].min() - 3, xy_m[:, 1].max() + 3
    columns, rows = np.ceil((np.ptp(xy_m, axis=0) + 6) / 0.1).astype(int)
    region = np.zeros((rows, columns), np.int32)
    for label, (x_m, y_m) in enumerate(xy_m, 1):
        row, column = round((top_m - y_m) / 0.1), round((x_m - left_m) / 0.1)
        region[row - 20 : row + 20, column - 20 : column + 20] = label
    names = [frame.place for frame in references]
    masks = FloorMasks(region > 0, region, region < 0, 0.1, (left_m, top_m), dict(enumerate(names[1:] + names[:1], 1)))
    floor = write_floor(root, "floor", masks)
    truth = json.loads((root / "truth.json").read_text())["queries"]
    write_manifest(root, folder.manifest.frames, truth, objects="objects.parquet", floors=[floor])
    return root


@pytest.mark.parametrize("command", [("build",), ("map", "build")])
def test_a_map_with_wrong_masks_is_refused(swapped, tmp_path, command):
    built = run(*command, "data", "-o", "map")
    assert built.code == 2
    (line,) = [line for line in built.err.splitlines() if "selected the detector" not in line]
    assert line.startswith(f"error: {BEGIN}bedroom-map (place bedroom, region ")
    assert CAUSE in line
    assert not (tmp_path / "map").exists()


def test_compare_refuses_and_data_info_reports(swapped):
    compared = run("compare", "--methods", "objects", "--data", "data", "--engine", "inline")
    assert compared.code == 2
    assert BEGIN in compared.err
    info = run("data", "info", "data")
    assert info.code == 0
    assert info.err.startswith(f"warning: {BEGIN}")
    assert info.err.count("\n") == 1
    assert "mapped places: 3" in info.out


def test_right_names_are_silent(swapped):
    path = swapped / "manifest.json"
    content = json.loads(path.read_text())
    names = list(content["floors"][0]["regions"].values())
    content["floors"][0]["regions"] = dict(zip("123", names[-1:] + names[:-1], strict=True))
    path.write_text(json.dumps(content))
    assert run("data", "info", "data").err == ""
    assert run("build", "data", "-o", "map").code == 0
