"""Commands that read damaged files, called as the command line calls them, in a process that is used again."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from contextlib import chdir
from functools import cache, partial
from pathlib import Path

import pyarrow.parquet as pq
import salframe_annotations
import typer.main
from answers import CommandOutput
from command_line import run, without_times
from readers import Reader, reseal, write_reverie
from small_building import write_floors, write_viewpoints
from small_map import write_small_map

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.components import installation
from salframe.framework.errors import DataError
from salframe.panoramas.geometry import pose_2d
from salframe.topology.building_map import build_map
from salframe.topology.map_changes import remove_from_map

SENSOR = Path(salframe_annotations.__file__).parent / "sensors" / "panoseg.json"
MAPS = ("sift", "sovs", "proposed")
"""Methods of the maps whose damaged content is sealed anew."""
_ASK = ("--engine", "inline", "--json")
_RUN, _WALKS = "runs/sound-*", "runs/walks-*"
_VIEWPOINTS = ("--data", "matterport-annotations", "--data-dir", "viewpoints")
_NAVIGATE = ("navigate", *_VIEWPOINTS, "--methods", "proposed", *_ASK)
_QUERY = ("map", "query", "building", "kitchen-query", "--data", "./data", "--to", "bedroom", "--json")
_EXPERIMENT = ("experiment", "experiment.yaml", *_ASK)
_ROUTE = ("map", "route", "ways", "a", "c", "--json")
_LOCALIZE = ("localize", "map", "kitchen-query", "--data", "./data", "--json")
UNFORESEEN = re.compile(r"\b(?!DataError|TProtocolException)[A-Z]\w*(Error|Exception|Iteration)\b")
"""What a table tells of an exception that no message was written for; the second stands in messages of pyarrow."""


def compute_once() -> None:
    """Compute the tree of commands and the versions of packages once in a process: they do not depend on input."""
    typer.main.get_command = cache(typer.main.get_command)
    installation.installed_version = cache(installation.installed_version)


def command(*words: str) -> Callable[[Path], CommandOutput]:
    """A reader that runs a command in the folder and gives what it prints, but for times. Raises DataError with the
    line that it ends with, and AssertionError where it ends otherwise than by a clear line or a table of such."""

    def read(root: Path) -> CommandOutput:
        with chdir(root):
            result = run(*(str(next(Path().glob(word))) if "*" in word else word for word in words))
        text = result.out + result.err
        assert "Traceback" not in text, text
        assert not UNFORESEEN.search(text), text
        if result.code == 2:
            *notes, error = result.err.splitlines()
            assert error.startswith("error: "), result.err
            assert len(notes) < 2, result.err
            raise DataError(error)
        assert result.code in (0, 1), result.code
        out = without_times(json.loads(result.out)) if "--json" in words else result.out
        if result.code == 1:
            assert result.out, result.err
            raise DataError("reported in the table")
        return CommandOutput(out, result.err)

    return read


def in_turn(
    first: Callable[[Path], CommandOutput], last: Callable[[Path], CommandOutput]
) -> Callable[[Path], CommandOutput]:
    """A reader that runs two commands, the last of which uses what the first wrote."""

    def read(root: Path) -> CommandOutput:
        lines = first(root).err
        output = last(root)
        return CommandOutput(output.out, lines + output.err)

    return read


def _reseal(name: str, root: Path) -> None:
    reseal(root / name)


_MERGE = in_turn(command("map", "merge", "lounge", "others"), command("localize", "lounge", *_LOCALIZE[2:]))
EXPERIMENT = {
    "title": "Views",
    "question": "How much of a view is enough?",
    "tables": {
        name: {"title": name, "data": "./data", "methods": ["objects"], "set": {"data.query_fov_deg": fov_deg}}
        for name, fov_deg in (("half", 180), ("full", 360))
    },
}

COMMANDS = {
    "compare": Reader(
        "place", command("compare", "--methods", "objects", "--data", "./data", *_ASK), files="data/**/*"
    ),
    "compare preset": Reader(
        "place", command("compare", "--methods", "preset.yaml", "--data", "data.yaml", *_ASK), files="*.yaml"
    ),
    "ablate": Reader("place", command("ablate", "study.yaml", "--data", "./data", *_ASK), files="study.yaml"),
    "evaluate": Reader("place", command("evaluate", _RUN, "--json"), files="runs/sound-*/**/*"),
    "resume": Reader(
        "place",
        command("compare", "--methods", "objects", "--data", "./data", "--name", "sound", *_ASK),
        files="runs/sound-*/**/*",
    ),
    "report": Reader("place", command("report", _RUN, "-o", "page.html"), files="runs/sound-*/**/*"),
    "matching": Reader(
        "place", command("matching", "--methods", "proposed", "--data", "./data", *_ASK), files="data/**/*"
    ),
    "detection": Reader(
        "place", command("detection", "--detectors", "annotations", "--data", "./data", *_ASK), files="data/**/*"
    ),
    "sensor": Reader("place", command("sensor", "annotations", "--data", "./data", *_ASK), files="data/**/*"),
    "data info": Reader("place", command("data", "info", "./data", "--json"), files="data/**/*"),
    "build": Reader("place", command("build", "./data", "-o", "built", "--method", "objects"), files="data/**/*"),
    "fit": Reader("place", command("fit", "objects", "--data", "./data", "-o", "fitted.yaml"), files="data/**/*"),
    "experiment": Reader("place", command(*_EXPERIMENT), files="experiment.yaml"),
    "experiment results": Reader("place", command(*_EXPERIMENT, "--results", "results"), files="results/*"),
    "navigate": Reader("place", command(*_NAVIGATE, "--episodes", "2"), files="viewpoints/*/**/*"),
    "navigate regions": Reader("place", command(*_NAVIGATE, "--episodes", "2"), files="viewpoints/vp2room_label.json"),
    "navigate published": Reader(
        "place", command(*_NAVIGATE, "--episodes", "reverie:val"), files="viewpoints/reverie/**/*"
    ),
    "navigate episodes": Reader(
        "place", command(*_NAVIGATE, "--episodes", "viewpoints/episodes.json"), files="viewpoints/episodes.json"
    ),
    "navigate resume": Reader(
        "place", command(*_NAVIGATE, "--episodes", "2", "--name", "walks"), files="runs/walks-*/**/*"
    ),
    "evaluate navigation": Reader("place", command("evaluate", _WALKS, "--json"), files="runs/walks-*/**/*"),
    "report navigation": Reader("place", command("report", _WALKS, "-o", "page.html"), files="runs/walks-*/**/*"),
    "localize": Reader("place", command(*_LOCALIZE), files="map/**/*", sealed=True),
    "localize query": Reader("place", command(*_LOCALIZE), files="data/**/*"),
    "localize views": Reader(
        "place",
        command(
            *("localize", "building", "--views", "kitchen-query", "kitchen-query", "--data", "./data"),
            *("--motion", "motion.csv", "--json"),
        ),
        files="motion.csv",
    ),
    **{
        f"localize {name}": Reader(
            "place",
            command(
                *("localize", "map", "--range", "data/frames/kitchen-query.range.png", "--json"),
                *("--instances", "data/frames/kitchen-query.instances.png", "--labels", "labels.json"),
            ),
            files=files,
        )
        for name, files in (("labels", "labels.json"), ("images", "data/frames/kitchen-query.*.png"))
    },
    **{
        f"edited {method}": Reader(
            "maps",
            command("localize", method, "kitchen-query", "--data", "./data", "--json"),
            files=f"{method}/parts-*/**/*",
            reseal=partial(_reseal, method),
        )
        for method in MAPS
    },
    "edited route": Reader("place", command(*_ROUTE), files="ways/parts-*/**/*", reseal=partial(_reseal, "ways")),
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
    "map route": Reader("place", command(*_ROUTE), files="ways/**/*", sealed=True),
    "map show": Reader("place", command("map", "show", "ways", "-o", "ways.png"), files="ways/**/*", sealed=True),
    "map export": Reader("place", command("map", "export", "ways", "ways.geojson"), files="ways/**/*"),
    "map build": Reader(
        "place",
        in_turn(
            command("map", "build", "./data", "-o", "built", "--method", "proposed"),
            command("map", "query", "built", "kitchen-query", "--data", "./data", "--to", "bedroom", "--json"),
        ),
        files="data/**/*",
    ),
    "map query": Reader("place", command(*_QUERY), files="building/**/*", sealed=True),
    "map query data": Reader("place", command(*_QUERY), files="data/**/*"),
    "edited map query": Reader(
        "place", command(*_QUERY), files="building/parts-*/**/*", reseal=partial(_reseal, "building")
    ),
    "map add": Reader(
        "place", in_turn(command("map", "add", "building", "./data"), command(*_QUERY)), files="data/**/*"
    ),
    "map merge": Reader("place", _MERGE, files="others/**/*", sealed=True),
    "edited map merge": Reader("place", _MERGE, files="others/parts-*/**/*", reseal=partial(_reseal, "others")),
    "score data": Reader(
        "place",
        command("score", "reverie", "reverie/answers.json", "--data", "reverie", "--json"),
        files="reverie/*/**/*",
    ),
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
    """Write the sound files of the commands: data with floors, maps, viewpoints, runs, and settings."""
    shutil.copytree(data, root / "data")
    write_floors(root / "data")
    truth = json.loads((root / "data" / "truth.json").read_text())
    for entry in truth["queries"].values():
        entry["pose"] = pose_2d(1.5, 1.5, 0.5, 1.5).ravel().tolist()
    (root / "data" / "truth.json").write_text(json.dumps(truth))
    labels = pq.read_table(root / "data" / "objects.parquet")["label"].to_pylist()
    (root / "labels.json").write_text(json.dumps(dict(enumerate(labels, 1))))
    (root / "preset.yaml").write_text("kind: objects\nlabels: set\ndetector: {kind: annotations, noise: none}\n")
    (root / "data.yaml").write_text("kind: folder\nroot: data\nquery_fov_deg: 270\n")
    (root / "study.yaml").write_text("method: objects\nset: {detector.noise: none}\nvary: {labels: [set, multiset]}\n")
    (root / "experiment.yaml").write_text(json.dumps(EXPERIMENT))
    (root / "motion.csv").write_text("t_s,x_m,y_m,z_m,yaw_deg\n0,0,0,0,0\n1,0.1,0,0,0.5\n")
    write_small_map(root / "ways")
    write_reverie(root / "reverie")
    write_viewpoints(root / "viewpoints")
    shutil.copy(SENSOR, root / "sensor.json")
    with chdir(root):
        annotations = ("detector.kind=annotations",)
        build_map("./data", Path("map"), "objects", overrides=annotations)
        build_map("./data", Path("building"), "proposed", overrides=annotations)
        for name, places in (("lounge", ["bedroom", "kitchen"]), ("others", ["lounge"])):
            shutil.copytree("map", name)
            remove_from_map(name, places)
        compare(Request(("objects",), "./data", name="sound", engine="inline"))
        for words in ((*_NAVIGATE, "--episodes", "2", "--name", "walks"), (*_EXPERIMENT, "--results", "results")):
            result = run(*words)
            assert result.code == 0, result
