"""Ranges in a wrong unit are told wherever panoramas are looked at, and stop nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import run
from tiny_folder import write_tiny_folder

from salframe.panoramas.images import read_range, write_range

SAID = "the floor lies 6 m below the camera ({}), expected 0.45 to 2.8 m: "
MAPPED = "median of 3 panoramas, the first: bedroom-map"
LIKELY = (
    "ranges may be about 4 times too large, likely quarter millimetres read as millimetres. "
    "Check the unit of the ranges: range_unit_m in manifest.json, or --range-unit for single images\n"
)


@pytest.fixture
def quarters(tmp_path, monkeypatch) -> Path:
    """A folder whose depth is in quarter millimetres."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    folder = write_tiny_folder(tmp_path / "data")
    for path in (folder / "frames").glob("*.range.png"):
        write_range(path, read_range(path) * 4)
    return folder


def test_a_wrong_unit_is_told_on_stderr(quarters, tmp_path):
    of_map = "warning: " + SAID.format(MAPPED) + LIKELY
    info = run("data", "info", quarters)
    assert (info.code, info.err) == (0, of_map)
    build = run("build", quarters, "-o", "map")
    assert build.code == 0
    assert of_map in build.err
    found = run("localize", "map", quarters / "frames" / "bedroom-query.range.png", "--json")
    assert found.err.partition("\n")[0] + "\n" == "warning: " + SAID.format("in bedroom-query") + LIKELY
    assert found.json["places"][0]["place"] == "bedroom"


def test_a_wrong_unit_is_told_under_the_table_and_in_the_report(quarters):
    arguments = ("compare", "--methods", "objects", "--data", quarters, "--engine", "inline")
    result = run(*arguments, "--json").json
    (note,) = [note for note in result["notes"] if "floor" in note]
    assert f"{note}\n" == SAID.format(MAPPED) + LIKELY
    assert note in run(*arguments).out
    assert note in Path(result["report"]).read_text()


def test_of_a_right_unit_nothing_is_said(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    folder = write_tiny_folder(tmp_path / "data")
    assert run("data", "info", folder).err == ""
    arguments = ("compare", "--methods", "objects", "--data", folder, "--engine", "inline", "--runs", tmp_path)
    assert not any("floor" in note for note in run(*arguments, "--json").json["notes"])
