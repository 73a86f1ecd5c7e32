"""The core with no plugin of ours: what a stranger's plugin has to stand on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from salframe.panoramas.folder_format import FrameEntry, TruthEntry, write_manifest, write_panorama
from salframe.panoramas.geometry import pose_2d

CODE = """
import json, sys
from pathlib import Path
from salframe.framework.components.registry import registry
from salframe.localization.map import open_map
from salframe.topology.building_map import build_map
from salframe.panoramas.opening import find_dataset, find_frame

build_map("data", Path("map"), "reader")
answer = open_map(Path("map")).localize(find_frame(find_dataset("data"), "query"))
print(json.dumps({
    "components": [[component.role, component.name, package] for component, package in registry()],
    "failures": [failure.reason for failure in registry().failures],
    "roles": list(registry().roles),
    "presets": registry().list_presets("methods"),
    "modules": sorted(name for name in sys.modules if name.startswith("salframe_")),
    "heavy": [name for name in ("torch", "onnxruntime", "open3d", "kornia") if name in sys.modules],
    "places": [place.place for place in answer.places],
    "x_m": answer.T_world_query[0, 3],
}))
"""


def write_rooms(root: Path) -> None:
    """Three rooms 5 m apart whose panoramas are of the colour that fake_plugin's localizer takes for their number."""
    entries = [
        FrameEntry(
            id=f"map-{room}",
            role="map",
            rgb=f"{room}.png",
            place=f"room-{room}",
            pose=tuple(pose_2d(5.0 * room, 0, 0).ravel().tolist()),
        )
        for room in range(3)
    ]
    entries.append(FrameEntry(id="query", role="query", rgb="query.png"))
    for entry, colour in zip(entries, (0, 1, 2, 1), strict=True):
        write_panorama(root, entry, rgb=np.full((8, 16, 3), colour, np.uint8))
    write_manifest(root, entries, {"query": TruthEntry(place="room-1")})


def test_a_map_is_built_and_asked_without_any_plugin_of_ours(tmp_path):
    write_rooms(tmp_path / "data")
    here = str(Path(__file__).parent)
    environment = {**os.environ, "SALFRAME_PLUGINS": "fake_plugin", "SALFRAME_CACHE": str(tmp_path / "cache")}
    environment["PYTHONPATH"] = os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["failures"] == []
    fakes = ["clear", "greedy", "ranger", "reader", "suicidal", "unbuildable", "weightless"]
    assert found["components"] == [
        ["dataset", "folder", "salframe"],
        ["dataset", "rooms", "fake_plugin"],
        *(["localizer", name, "fake_plugin"] for name in fakes),
    ]
    assert {"dataset", "detector", "saliency", "matcher", "positioner", "planner", "localizer"} <= set(found["roles"])
    assert found["presets"] == {}
    assert found["modules"] == []
    assert found["heavy"] == []
    assert found["places"][0] == "room-1"
    assert found["x_m"] == 5.0
