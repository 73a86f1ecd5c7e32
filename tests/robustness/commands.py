"""Commands that read damaged files, called as the command line calls them, in a process that is used again."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from contextlib import chdir
from functools import partial
from pathlib import Path

import pyarrow.parquet as pq
import salframe_annotations
from answers import Told
from command_line import run, without_times
from readers import Reader, reseal
from small_map import write_small_map

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.errors import DataError
from salframe.panoramas.geometry import pose_2d
from salframe.topology.building_map import build_map

SENSOR = Path(salframe_annotations.__file__).parent / "sensors" / "panoseg.json"
MAPS = ("sift", "sovs", "proposed")
"""Methods of the maps whose damaged content is sealed anew."""
_ASK = ("--engine", "inline", "--json")
_RUN = "runs/sound-*"
UNFORESEEN = re.compile(r"\b(?!DataError|TProtocolException)[A-Z]\w*(Error|Exception|Iteration)\b")
"""What a table tells of an exception that no message was written for; the second stands in messages of pyarrow."""


def command(*words: str) -> Callable[[Path], Told]:
    """A reader that runs a command in the folder and gives what it prints, but for times. Raises DataError with the
    line that it ends with, and AssertionError where it ends otherwise than by a clear line or a table of such."""

    def read(root: Path) -> Told:
        with chdir(root):
            done = run(*(str(next(Path().glob(word))) if "*" in word else word for word in words))
        said = done.out + done.err
        assert "Traceback" not in said, said
        assert not UNFORESEEN.search(said), said
        if done.code == 2:
            *notes, error = done.err.splitlines()
            assert error.startswith("error: "), done.err
            assert len(notes) < 2, done.err
            raise DataError(error)
        assert done.code in (0, 1), done.code
        told = without_times(json.loads(done.out)) if "--json" in words else done.out
        if done.code == 1:
            assert done.out, done.err
            raise DataError("told in the table")
        return Told(told, done.err)

    return read


def _reseal(name: str, root: Path) -> None:
    reseal(root / name)


COMMANDS = {
    "compare": Reader(
        "place", command("compare", "--methods", "objects", "--data", "./data", *_ASK), files="data/**/*"
    ),
    "compare preset": Reader(
        "place", command("compare", "--methods", "preset.yaml", "--data", "data.yaml", *_ASK), files="*.yaml"
    ),
    "ablate": Reader("place", command("ablate", "study.yaml", "--data", "./data", *_ASK), files="study.yaml"),
    "evaluate": Reader("place", command("evaluate", _RUN, "--json"), files="runs/**/*"),
    "resume": Reader(
        "place",
        command("compare", "--methods", "objects", "--data", "./data", "--name", "sound", *_ASK),
        files="runs/**/*",
    ),
    "report": Reader("place", command("report", _RUN, "-o", "page.html"), files="runs/**/*"),
    "matching": Reader(
        "place", command("matching", "--methods", "proposed", "--data", "./data", *_ASK), files="data/**/*"
    ),
    "detection": Reader(
        "place", command("detection", "--detectors", "annotations", "--data", "./data", *_ASK), files="data/**/*"
    ),
    "sensor": Reader("place", command("sensor", "annotations", "--data", "./data", *_ASK), files="data/**/*"),
    "data info": Reader("place", command("data", "info", "./data", "--json"), files="data/**/*"),
    "build": Reader("place", command("build", "./data", "-o", "built", "--method", "objects"), files="data/**/*"),
    "localize": Reader(
        "place",
        command("localize", "map", "kitchen-query", "--data", "./data", "--json"),
        files="map/**/*",
        sealed=True,
    ),
    "localize images": Reader(
        "place",
        command(
            *("localize", "map", "--range", "data/frames/kitchen-query.range.png", "--json"),
            *("--instances", "data/frames/kitchen-query.instances.png", "--labels", "labels.json"),
        ),
        files="labels.json",
    ),
    **{
        f"edited {method}": Reader(
            "maps",
            command("localize", method, "kitchen-query", "--data", "./data", "--json"),
            files=f"{method}/parts-*/**/*",
            reseal=partial(_reseal, method),
        )
        for method in MAPS
    },
    "edited route": Reader(
        "place",
        command("map", "route", "ways", "a", "c", "--json"),
        files="ways/parts-*/**/*",
        reseal=partial(_reseal, "ways"),
    ),
    "edited remove": Reader(
        "place", command("map", "remove", "map", "lounge"), files="map/parts-*/**/*", reseal=partial(_reseal, "map")
    ),
    "noise": Reader(
        "place",
        command(
            *("compare", "--methods", "objects", "--data", "./data", *_ASK),
            *("--set", "detector.kind=annotations", "--set", "detector.noise=sensor.json"),
        ),
        files="sensor.json",
    ),
    "map route": Reader("place", command("map", "route", "ways", "a", "c", "--json"), files="ways/**/*", sealed=True),
    "map export": Reader("place", command("map", "export", "ways", "ways.geojson"), files="ways/**/*"),
    "score": Reader(
        "reverie", command("score", "reverie", "answers.json", "--data", ".", "--json"), files="answers.json"
    ),
    "show-objects": Reader(
        "place",
        command(
            *("show-objects", "data/frames/kitchen-map.rgb.png", "--detector", "annotations", "-o", "shown", "--json")
        ),
        files="data/**/*",
    ),
}


def write_maps(root: Path, data: Path) -> None:
    """Write the data and the maps whose damaged content is sealed anew."""
    shutil.copytree(data, root / "data")
    with chdir(root):
        for method in MAPS:
            detector = () if method == "sift" else ("detector.kind=annotations",)
            build_map("./data", Path(method), method, overrides=detector)


def write_place(root: Path, data: Path) -> None:
    """Write the sound files of the commands: data, its map, the map of ways, a run, and settings."""
    shutil.copytree(data, root / "data")
    truth = json.loads((root / "data" / "truth.json").read_text())
    for entry in truth["queries"].values():
        entry["pose"] = pose_2d(1.5, 1.5, 0.5, 1.5).ravel().tolist()
    (root / "data" / "truth.json").write_text(json.dumps(truth))
    labels = pq.read_table(root / "data" / "objects.parquet")["label"].to_pylist()
    (root / "labels.json").write_text(json.dumps(dict(enumerate(labels, 1))))
    (root / "preset.yaml").write_text("kind: objects\nlabels: set\ndetector: {kind: annotations, noise: none}\n")
    (root / "data.yaml").write_text("kind: folder\nroot: data\nquery_fov_deg: 270\n")
    (root / "study.yaml").write_text("method: objects\nset: {detector.noise: none}\nvary: {labels: [set, multiset]}\n")
    write_small_map(root / "ways")
    shutil.copy(SENSOR, root / "sensor.json")
    with chdir(root):
        build_map("./data", Path("map"), "objects", overrides=("detector.kind=annotations",))
        compare(Request(("objects",), "./data", name="sound", engine="inline"))
