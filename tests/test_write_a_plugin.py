"""The code of docs/how-to/write-a-plugin.md, run as it stands there."""

from __future__ import annotations

import csv
import re
import shutil
import sys
from pathlib import Path

import pytest
import yaml
from command_line import run
from conformance import conforms
from tiny_folder import write_tiny_folder

from salframe.framework.components.registry import registry
from salframe.panoramas.frames import FrameKind, QueryFrame
from salframe.testing.rooms import map_frames, query_frames

REPOSITORY = Path(__file__).parent.parent
EXAMPLE = REPOSITORY / "examples" / "third_party"
BLOCKS = re.findall(
    r"```(\w+)\n(.*?)```", (REPOSITORY / "docs" / "how-to" / "write-a-plugin.md").read_text(), re.DOTALL
)
DETECTOR, CHECK, LOCALIZER, DATASET, COMMAND, ROLE = (code for language, code in BLOCKS if language == "python")
ENTRY_POINTS = [code for language, code in BLOCKS if language == "toml"]
(METHOD,) = (code for language, code in BLOCKS if language == "yaml")
MODULES = {
    "page_detector": DETECTOR,
    "page_localizer": LOCALIZER,
    "page_dataset": DATASET,
    "page_command": COMMAND,
    "my_compass": ROLE,
}


@pytest.fixture
def plugins(tmp_path, monkeypatch):
    """The modules of the page as plugins, beside our own."""
    for name, code in MODULES.items():
        (tmp_path / f"{name}.py").write_text(code)
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    ours = ("salframe_annotations", "salframe_graphs", "salframe_engines")
    monkeypatch.setenv("SALFRAME_PLUGINS", ",".join([*ours, *MODULES]))
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    yield
    registry.cache_clear()


@pytest.fixture
def robot_log(tmp_path) -> Path:
    """The conformance suite's rooms as the page's dataset reads them."""
    tiny, log = write_tiny_folder(tmp_path / "tiny"), tmp_path / "log"
    log.mkdir()
    with (log / "frames.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["id", "place", "x_m", "y_m", "yaw_rad", "role"])
        for frame in (*map_frames(), *query_frames()):
            place, _, role = frame.id.partition("-")
            writer.writerow([frame.id, place, 0.5, 0.0, 0.3, "doorway" if frame.id == "lounge-map" else role])
            shutil.copy(tiny / "frames" / f"{frame.id}.rgb.png", log / f"{frame.id}.png")
    return log


def class_of(code: str, name: str) -> str:
    return code[code.index(f"class {name}") :].partition("\n\n\n")[0].strip()


def test_what_the_page_shows_of_the_example_is_what_it_holds():
    source = EXAMPLE / "src" / "salframe_rangefinder"
    assert class_of((source / "detector.py").read_text(), "HeightBands") == class_of(DETECTOR, "HeightBands")
    assert all(lines in (EXAMPLE / "pyproject.toml").read_text() for lines in ENTRY_POINTS)
    assert yaml.safe_load((source / "presets" / "methods" / "bands.yaml").read_text()) == yaml.safe_load(METHOD)


def test_the_components_of_the_page_conform(plugins, robot_log):
    assert registry().failures == []
    exec(CHECK, {"HeightBands": registry().get("detector", "height-bands")})
    assert conforms(registry().get("localizer", "colour-profile"))
    assert conforms(registry().get("compass", "dark-side"))
    dataset = registry().get("dataset", "robot-log")
    assert conforms(dataset, dataset.Config(root=robot_log))


def test_the_dataset_tells_doorways_from_places_and_nothing_of_queries(plugins, robot_log):
    (fold,) = registry().build("dataset", registry().get("dataset", "robot-log").Config(root=robot_log)).folds()
    assert [frame.kind for frame in fold.references] == [FrameKind.SCENE, FrameKind.SCENE, FrameKind.TRANSITION]
    assert {type(frame) for frame in fold.queries} == {QueryFrame}


def test_the_localizer_is_compared_on_the_dataset(plugins, robot_log):
    found = run(
        "compare",
        "--methods",
        "colour-profile",
        "--data",
        "robot-log",
        "--data-dir",
        robot_log,
        "--engine",
        "inline",
        "--json",
    )
    (row,) = found.json["rows"]
    assert (row["queries"], row["accuracy"]) == (3, 1.0)


def test_the_command_is_one_of_salframes(plugins, tmp_path):
    data = write_tiny_folder(tmp_path / "tiny")
    found = run("places", data)
    assert (found.code, found.out) == (0, "bedroom\nkitchen\nlounge\n")
