"""Files that once ended in a traceback, a hang or a wrong answer: each is one clear line."""

from __future__ import annotations

import io
import json
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run
from tiny_folder import write_tiny_folder

from salframe.framework.files.array_files import pack_arrays

sys.path.insert(0, str(Path(__file__).parent))

from commands import write_place
from readers import reseal

Spoil = Callable[[Path], object]
ROUTE = ("map", "route", "ways", "a", "c")
LOCALIZE = ("localize", "map", "kitchen-query", "--data", "./data")
IMAGES = ("localize", "map", "--instances", "data/frames/kitchen-query.instances.png", "--labels", "labels.json")
EVALUATE = ("evaluate", "runs/sound-*")
COMPARE = ("compare", "--methods", "objects", "--engine", "inline")
SCORE = ("score", "reverie", "reverie/answers.json", "--data", "reverie")


def json_file(name: str, change: Callable[[Any], Any]) -> Spoil:
    """Change the value in a JSON file, whose name may be a pattern, in the place or give another."""

    def spoil(root: Path) -> None:
        path = next(root.glob(name))
        value = json.loads(path.read_text())
        new = change(value)
        path.write_text(json.dumps(value if new is None else new))

    return spoil


def array_file(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Change the array in a .npy file of a map, and write the map's hashes anew."""

    def spoil(root: Path) -> None:
        path = next(root.glob(name))
        np.save(path, change(np.load(path)))
        reseal(path.parent.parent.parent)

    return spoil


def archive(change: Callable[[dict[str, np.ndarray]], dict[str, np.ndarray] | bytes]) -> Spoil:
    """Change the arrays of the floors of a map, or put bytes in their place, and write the map's hashes anew."""

    def spoil(root: Path) -> None:
        path = next(root.glob("ways/parts-*/floors.npz"))
        new = change(dict(np.load(path)))
        if isinstance(new, bytes):
            path.write_bytes(new)
        else:
            with path.open("wb") as file:
                np.savez_compressed(file, **new)
        reseal(root / "ways")

    return spoil


def text_file(name: str, text: str) -> Spoil:
    return lambda root: next(root.glob(name)).write_text(text)


def as_npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def with_other_compression(content: bytes) -> bytes:
    """Declare compression method 99 for the first part of a zip archive."""
    at = content.index(b"PK\x01\x02") + 10
    return content[:at] + b"\x63\x00" + content[at + 2 :]


HUGE = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (100000000000,), }".ljust(127) + b"\n"
"""The header of an array of 745 GiB."""

FAULTS: dict[str, tuple[Spoil, tuple[str, ...], str]] = {
    "npy for npz": (archive(lambda arrays: as_npy(arrays["0/free"])), ROUTE, r"floors\.npz is not an array archive"),
    "missing array": (
        archive(lambda arrays: {name: part for name, part in arrays.items() if name != "0/free"}),
        ROUTE,
        r"floors\.npz, floor 0 has no array free",
    ),
    "extra array": (archive(lambda arrays: arrays | {"0/roof": np.ones(3)}), ROUTE, r"the unexpected array roof"),
    "745 GiB": (
        lambda root: (next(root.glob("ways/parts-*/edges/length_m.npy")).write_bytes(HUGE), reseal(root / "ways")),
        ROUTE,
        r"length_m\.npy is not .*: the file has an array of shape \(100000000000,\), expected axis lengths from 0",
    ),
    "ragged poses": (
        array_file("map/parts-*/frames/pose.npy", lambda poses: poses.ravel()[:-1]),
        LOCALIZE,
        r"pose\.npy has an array of shape \(14,\), expected \(\d+,\) according to .*columns\.json",
    ),
    "poses of text": (
        array_file("map/parts-*/frames/pose.npy", lambda poses: poses.astype("U9")),
        LOCALIZE,
        r"pose\.npy contains values of dtype <U9, expected",
    ),
    "poses of different shapes": (
        lambda root: (
            json_file("map/parts-*/frames/columns.json", lambda table: _column(table, "pose", [5, None]))(root),
            reseal(root / "map"),
        ),
        LOCALIZE,
        r"shapes\.npy|column pose has arrays of shape \(5, \*\)",
    ),
    "null names": (
        lambda root: (
            json_file("ways/parts-*/nodes/columns.json", lambda table: _words(table, "id", [None, "b", "c"]))(root),
            reseal(root / "ways"),
        ),
        ROUTE,
        r"columns\.json: key columns\.0\.words\.0: received None, expected",
    ),
    "nested names": (
        lambda root: (
            json_file("ways/parts-*/nodes/columns.json", lambda table: _words(table, "id", [["a"], "b", "c"]))(root),
            reseal(root / "ways"),
        ),
        ROUTE,
        r"columns\.json: key columns\.0\.words\.0: received \['a'\], expected",
    ),
    "shuffled edges": (
        array_file("ways/parts-*/edges/azimuth_rad.npy", lambda azimuth: azimuth + 1.0),
        ROUTE,
        "does not match the positions of these nodes",
    ),
    "swapped edges": (
        array_file("ways/parts-*/edges/start.npy", lambda start: start[::-1]),
        ROUTE,
        "does not match the positions of these nodes|expected nodes",
    ),
    "edges of bool": (
        array_file("ways/parts-*/edges/length_m.npy", lambda lengths: lengths > 0),
        ROUTE,
        r"length_m\.npy contains values of dtype bool, expected",
    ),
    "outcome": (text_file("runs/sound-*/methods/objects/outcome.json", "[1]"), EVALUATE, r"outcome\.json"),
    "row": (
        text_file("runs/sound-*/methods/objects/rows.jsonl", '{"a": 1}\n'),
        EVALUATE,
        r"rows\.jsonl, line 1 \(remove this line to compute the result again\)",
    ),
    "NUL in a path": (
        json_file("data/manifest.json", lambda manifest: manifest["frames"][0].update(rgb="a\0b")),
        ("data", "info", "./data"),
        r"frames\.0\.rgb|NUL|null",
    ),
    "NUL in a setting": (
        text_file("data.yaml", 'kind: folder\nroot: "a\\0b"\n'),
        (*COMPARE, "--data", "data.yaml"),
        r"a\\x00b is not a dataset folder",
    ),
    "half a character": (
        text_file("labels.json", '{"1": "\\ud800"}'),
        IMAGES,
        r"labels\.json is not JSON: .*surrogates not allowed",
    ),
    "infinite box": (
        text_file(
            "reverie/reverie/BBox/s_c.json",
            '{"c": {"7": {"name": "x", "visible_pos": [3], "bbox2d": [[Infinity, 1, 2, 3]]}}}',
        ),
        SCORE,
        r"s_c\.json is not JSON: received the number Infinity, expected a finite number",
    ),
    "deep JSON": (text_file("data/manifest.json", "[" * 5000 + "]" * 5000), ("data", "info", "./data"), "5000 levels"),
    "deep YAML": (
        text_file("study.yaml", "- " * 5000),
        ("ablate", "study.yaml"),
        "levels of nested lists and mappings",
    ),
    "long number": (text_file("labels.json", "9" * 5000), IMAGES, "at most 64 bits"),
    "unknown compression": (
        archive(lambda arrays: with_other_compression(pack_arrays(arrays))),
        ROUTE,
        r"floors\.npz is not an array archive: the .npz archive is damaged \(That compression method is not sup",
    ),
    "view of a box": (
        json_file("reverie/reverie/BBox/s_c.json", lambda boxes: boxes["c"]["7"].update(visible_pos=[3, 10**18])),
        SCORE,
        r"s_c\.json: key c\.7\.visible_pos\.1: received 1000000000000000000, expected a number less than 36",
    ),
    "box beyond bounds": (
        json_file("reverie/reverie/BBox/s_c.json", lambda boxes: boxes["c"]["7"]["bbox2d"][0].__setitem__(0, 1e300)),
        SCORE,
        r"s_c\.json: key c\.7\.bbox2d\.0\.0: received 1e\+300, expected",
    ),
    "step of text": (
        json_file("reverie/answers.json", lambda answers: answers[0]["trajectory"][1].__setitem__(2, "north")),
        SCORE,
        r"answer 1 of \d+ is invalid \(the heading and elevation of a step are \[0\.0, 'north'\], not numbers\)",
    ),
    "stored row twice": (
        json_file(
            "results/experiment.json",
            lambda results: results["whole"]["half"]["rows"].append(results["whole"]["half"]["rows"][0]),
        ),
        ("experiment", "experiment.yaml", "--engine", "inline", "--results", "results"),
        r"experiment\.json: key whole\.half: the table has 2 `rows`, 1 `settings` and 1 different "
        "pairs .*",
    ),
    "complex outlines": (
        array_file("building/parts-*/scenes/outline_mm.npy", lambda outlines: outlines.astype(np.complex64)),
        ("map", "query", "building", "kitchen-query", "--data", "./data"),
        r"building/parts-\w+ is damaged: the method 'saliency-places' cannot read the arrays",
    ),
    "base is a mapping": (
        text_file("study.yaml", "base: {a: 1}\n"),
        ("ablate", "study.yaml"),
        "the key `base` is .*name of a",
    ),
    "set": (
        text_file("study.yaml", "vary: {a: !!set {b}}\n"),
        ("ablate", "study.yaml"),
        "tag .*set, expected values without tags",
    ),
}


def _column(table: dict[str, Any], name: str, shape: list[int | None]) -> None:
    next(column for column in table["columns"] if column["name"] == name)["shape"] = shape


def _words(table: dict[str, Any], name: str, words: list[Any]) -> None:
    next(column for column in table["columns"] if column["name"] == name)["words"] = words


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("faults")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SALFRAME_CACHE", str(root / "cache"))
        write_place(root / "place", write_tiny_folder(root / "data"))
    return root / "place"


@pytest.mark.parametrize(("spoil", "words", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_a_fault_that_once_passed_is_one_line(sound, tmp_path, monkeypatch, spoil, words, message):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(shutil.copytree(sound, tmp_path / "place"))
    spoil(Path())
    result = run(*(next(Path().glob(word)) if "*" in word else word for word in words))
    assert (result.code, result.out) == (2, ""), result
    assert re.fullmatch(f"error: .*({message}).*\n", result.err), result.err
