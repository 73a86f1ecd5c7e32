"""Strange words on the command line get one clear line."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from tiny_folder import write_tiny_folder

from salframe.framework.errors import DataError
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.writing import write_json
from salframe.panoramas.folder_format import write_objects
from salframe.panoramas.folder_reader import Folder
from salframe.topology.store import open_topology

sys.path.insert(0, str(Path(__file__).parent))

from small_map import write_small_map

DEEP = "[" * 5000 + "]" * 5000
COMPARE = ("compare", "--methods", "objects", "--engine", "inline")
WORDS = {
    "kind null": ((*COMPARE, "--data", "./data", "--set", "detector.kind=null"), "None|null"),
    "deep setting": ((*COMPARE, "--data", "./data", "--set", f"detector.noise={DEEP}"), "levels of nested lists"),
    "long number": ((*COMPARE, "--data", "./data", "--set", "detector.seed=" + "9" * 5000), "detector.seed"),
    "nan": ((*COMPARE, "--data", "./data", "--set", "detector.seed=.nan"), "finite"),
    "long name": ((*COMPARE, "--data", "./data", "--name", "n" * 300), "run name of 300 bytes, expected at most"),
    "half a character": ((*COMPARE, "--data", "./data", "--name", "\udcff"), r"the argument .* is not UTF-8 text"),
    "no path": ((*COMPARE, "--data", "./" + "d" * 5000), "name too long|not a dataset"),
    "half a path": ((*COMPARE, "--data", "./\udcff"), "the argument .* is not UTF-8 text"),
    "heading": (
        ("map", "route", "map", "a", "b", "--heading", "nan"),
        "--heading 'nan', expected a number from -3600.0 to 3600.0",
    ),
    "pipe": (("ablate", "pipe.yaml", "--data", "./data"), "pipe.yaml: the path is a pipe.*expected a regular file"),
    "device": (("ablate", "/dev/zero", "--data", "./data"), "expected a regular file"),
    "base of itself": (("ablate", "self.yaml"), "self.yaml inherits from itself"),
    "base is a list": (("ablate", "list.yaml"), r"the key `base` is \['a'\], expected the name of a file"),
    "binary": (("ablate", "binary.yaml"), "tag .*binary, expected values without tags"),
    "alias of itself": (("ablate", "alias.yaml"), r"\*a refers to a value that contains this alias"),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("commands")
    write_tiny_folder(root / "data")
    write_small_map(root / "map")
    os.mkfifo(root / "pipe.yaml")
    texts = {
        "self": "base: self.yaml\n",
        "list": "base: [a]\n",
        "binary": "method: objects\nvary: {labels: [!!binary aGk=]}\n",
        "alias": "method: objects\nvary: &a {labels: [*a]}\n",
    }
    for name, text in texts.items():
        (root / f"{name}.yaml").write_text(text)
    return root


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no FIFOs")
@pytest.mark.parametrize(("words", "message"), WORDS.values(), ids=WORDS.keys())
def test_strange_words_are_one_line(place, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(place)
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    result = run(*words)
    assert (result.code, result.out) == (2, "")
    assert re.fullmatch(f"error: .*({message}).*\n", result.err), result.err
    assert len(result.err) < 12_000


def test_a_table_of_objects_that_says_nothing_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(write_tiny_folder(tmp_path / "data"))
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    cases = {
        r"objects\.parquet has no row, expected one for each object": {"instance_id": range(0), "label": []},
        r"objects\.parquet: key 0\.instance_id: received '1', expected an integer": {
            "instance_id": ["1"],
            "label": ["bed"],
        },
        r"instance_id, expected a different value in each row": {"instance_id": [1, 1], "label": ["bed", "lamp"]},
    }
    for message, columns in cases.items():
        write_objects(Path("objects.parquet"), columns)
        result = run("build", ".", "-o", tmp_path / "map", "--method", "objects", "--set", "detector.kind=annotations")
        assert result.code == 2
        assert re.search(message, result.err), result.err


@pytest.mark.parametrize(("at", "number"), [(3, "NaN"), (3, float("nan")), (3, float("inf")), (3, None), (0, 1.1)])
@pytest.mark.parametrize("file", ["manifest.json", "truth.json"])
def test_a_pose_that_is_no_rigid_motion_is_refused(tmp_path, monkeypatch, file, at, number):
    path = write_tiny_folder(tmp_path / "data") / file
    content = json.loads(path.read_text())
    pose = np.eye(4).ravel().tolist()
    pose[at] = number
    entries = content["frames"] if file == "manifest.json" else list(content["queries"].values())
    next(entry for entry in entries if entry.get("role") != "query")["pose"] = pose
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=rf"{file}.*(pose|finite)"):
        Folder(path.parent).truth("kitchen-query")


def test_edges_that_do_not_lead_between_their_nodes_are_refused(tmp_path):
    def spoil(name: str, change) -> None:
        root = tmp_path / f"{name}-{len(list(tmp_path.iterdir()))}"
        write_small_map(root)
        manifest = json.loads((root / "map.json").read_text())
        path = root / manifest["parts"] / "edges" / f"{name}.npy"
        values = change(np.load(path))
        np.save(path, values)
        manifest["sha256"][f"edges/{name}.npy"] = file_sha256(path)
        write_json(root / "map.json", manifest)
        with pytest.raises(DataError, match="edges"):
            open_topology(root)

    spoil("length_m", lambda lengths: lengths[::-1])
    spoil("length_m", lambda lengths: lengths + 0.5)
    spoil("length_m", lambda lengths: lengths > 0)
    spoil("start", lambda numbers: numbers[::-1])
    spoil("azimuth_rad", lambda angles: angles + 1)
    spoil("azimuth_rad", lambda angles: angles * np.nan)
