"""The code of docs/how-to/write-a-plugin.md, run as it stands there."""

from __future__ import annotations

import csv
import re
import shutil
import sys
from pathlib import Path

import pytest
from command_line import run
from tiny_folder import write_tiny_folder

from salframe.framework.registry import registry
from salframe.testing import check_component
from salframe.testing.rooms import map_frames, query_frames

REPOSITORY = Path(__file__).parent.parent
BLOCKS = re.findall(
    r"```(\w+)\n(.*?)```", (REPOSITORY / "docs" / "how-to" / "write-a-plugin.md").read_text(), re.DOTALL
)
DETECTOR, CHECK, LOCALIZER, DATASET = (code for language, code in BLOCKS if language == "python")
(ENTRY_POINT,) = (code for language, code in BLOCKS if language == "toml")


@pytest.fixture
def plugins(tmp_path, monkeypatch):
    """The three modules of the page as plugins, beside our own."""
    for name, code in (("page_detector", DETECTOR), ("page_localizer", LOCALIZER), ("page_dataset", DATASET)):
        (tmp_path / f"{name}.py").write_text(code)
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv(
        "SALFRAME_PLUGINS",
        "salframe_annotations,salframe_graphs,salframe_engines,page_detector,page_localizer,page_dataset",
    )
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
            writer.writerow([frame.id, place, 0.5, 0.0, 0.3, role])
            shutil.copy(tiny / "frames" / f"{frame.id}.rgb.png", log / f"{frame.id}.png")
    return log


def test_the_detector_is_the_examples():
    example = REPOSITORY / "examples" / "third_party_detector"
    assert (example / "src" / "salframe_height_bands" / "__init__.py").read_text() == DETECTOR
    assert ENTRY_POINT in (example / "pyproject.toml").read_text()


def test_the_components_of_the_page_conform(plugins, robot_log):
    exec(CHECK, {"HeightBands": registry().get("detector", "height-bands")})
    check_component(registry().get("localizer", "colour-histogram"))
    dataset = registry().get("dataset", "robot-log")
    check_component(dataset, dataset.Config(root=robot_log))


def test_the_localizer_is_compared_on_the_dataset(plugins, robot_log):
    found = run(
        "compare",
        "--methods",
        "colour-histogram",
        "--data",
        "robot-log",
        "--data-dir",
        robot_log,
        "--engine",
        "inline",
        "--json",
    )
    (row,) = found.json["rows"]
    assert (row["queries"], row["accuracy"], row["bytes_per_scene"]) == (3, 1.0, 512.0)
