"""Record the answers of some runs, and compare two records: what a change of the code does to statuses, places, poses
and probabilities.

    python tests/equivalence/answers.py record SALFRAME FOLDER [--data-dir DIR]
    python tests/equivalence/answers.py compare BEFORE AFTER [--json]

`record` runs the command SALFRAME (of any version) and writes one compressed file per run to FOLDER; `--data-dir` adds
the runs on Matterport annotations, whose files may not be committed. `compare` prints the number of differences of each
run and method and exits with status 1 where there are any; RENAMED maps names of older versions to today's.
"""

from __future__ import annotations

import argparse
import gzip
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

TOLERANCE = 1e-4
"""Maximum difference of two poses (metres, elements of rotation matrices) and of two probabilities."""
DIGITS = 7
"""Number of decimals that a record keeps."""
GRAPHS = "proposed,saliency-graph,objects,sovs,usg,paper,paper-signed"
RUNS = {
    "house-42-seed-200": [
        "--methods",
        GRAPHS,
        "--data",
        "house-42",
        "--set",
        "data.rgb=false",
        "--set",
        "data.seed=200",
    ],
    "house-42-seed-7919": [
        *["--methods", GRAPHS, "--data", "house-42"],
        *["--set", "data.rgb=false", "--set", "data.seed=7919"],
    ],
    "house-106-seed-0": ["--methods", "proposed", "--data", "house-106", "--set", "data.rgb=false"],
    "house-12-colour": ["--methods", "proposed,sift,lines", "--data", "house-12", "--set", "proposed.detector=panoseg"],
}
REAL = {"matterport": ["--methods", "proposed,usg", "--data", "matterport-annotations"]}
"""Runs on data that may not be copied into the project."""
RENAMED: Mapping[str, str] = {"not_here": "out_of_map_probability", "not-here": "out-of-map"}
"""Row keys, statuses and method names of older versions, and the names that replace them."""
COUNTED = ("missing", "status", "place", "ranking", "pose", "probabilities")
FIELDS = ("fold", "query", "status", "places", "pose", "probabilities", "out_of_map_probability")


def record(command: str, folder: Path, data_dir: Path | None) -> None:
    """Run all comparisons with `command` and write their answers to `folder`. Raises CalledProcessError."""
    folder.mkdir(parents=True, exist_ok=True)
    runs = dict(RUNS)
    if data_dir is not None:
        runs |= {name: [*arguments, "--data-dir", str(data_dir)] for name, arguments in REAL.items()}
    for name, arguments in runs.items():
        with tempfile.TemporaryDirectory() as work:
            print(f"{name}: {command} compare {' '.join(arguments)}", flush=True)
            subprocess.run(
                [command, "compare", *arguments, "--runs", work, "--json"],
                check=True,
                stdout=subprocess.DEVNULL,
                cwd=work,
            )
            answers = {
                path.parent.name: list(_rows(path)) for path in sorted(Path(work).glob("*/methods/*/rows.jsonl"))
            }
        with gzip.GzipFile(folder / f"{name}.json.gz", "wb", mtime=0) as file:
            file.write(json.dumps(answers, separators=(",", ":")).encode())


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the recorded fields of each row of a run's method."""
    for line in path.read_text(encoding="utf-8").splitlines():
        row = _renamed(json.loads(line))
        yield {key: _rounded(row[key]) for key in FIELDS}


def _renamed(value: Any) -> Any:
    """Replace older names at every depth."""
    if isinstance(value, dict):
        return {RENAMED.get(key, key): _renamed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_renamed(item) for item in value]
    return RENAMED.get(value, value) if isinstance(value, str) else value


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return round(value, DIGITS) if isinstance(value, float) else value


def compare(before: Path, after: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the counts of differences by run and method; a run that only one folder has counts as `missing`."""
    report: dict[str, dict[str, dict[str, Any]]] = {}
    for name in sorted({path.name for folder in (before, after) for path in folder.glob("*.json.gz")}):
        if not all((folder / name).exists() for folder in (before, after)):
            report[name] = {"": {"missing": 1}}
            continue
        old, new = (_renamed(json.loads(gzip.decompress((folder / name).read_bytes()))) for folder in (before, after))
        report[name.removesuffix(".json.gz")] = {
            method: _differences(old.get(method, []), new.get(method, [])) for method in sorted(old.keys() | new.keys())
        }
    return report


def _differences(old: Sequence[Mapping[str, Any]], new: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return counts of queries whose status, first place, ranking, pose or probabilities differ, and the deviations."""
    by_query = {(row["fold"], row["query"]): row for row in new}
    counts = dict.fromkeys(COUNTED, 0)
    counts["missing"] = abs(len(old) - len(new))
    off = {"pose": 0.0, "probabilities": 0.0}
    examples = []
    for a in old:
        b = by_query.get((a["fold"], a["query"]))
        if b is None:
            counts["missing"] += 1
            continue
        places = [[(frame, place) for frame, place, _ in row["places"]] for row in (a, b)]
        different = {
            "status": a["status"] != b["status"],
            "place": [place for _, place in places[0][:1]] != [place for _, place in places[1][:1]],
            "ranking": places[0] != places[1],
        }
        for name in off:
            one, two = (_numbers(row, name) for row in (a, b))
            same = len(one) == len(two)
            apart = float(np.abs(one - two).max(initial=0)) if same else np.inf
            off[name] = max(off[name], apart)
            different[name] = apart > TOLERANCE
        for name, is_different in different.items():
            counts[name] += is_different
        if any(different.values()):
            examples.append(a["query"])
    return {"queries": len(old), **counts, "max_deviation": off, "examples": examples[:5]}


def _numbers(row: Mapping[str, Any], name: str) -> np.ndarray:
    """Return the pose of a row, or the probabilities of its places and of being out of the map."""
    if name == "pose":
        return np.array(row["pose"] or [])
    outside = row["out_of_map_probability"]
    return np.array([*(row["probabilities"] or []), *([] if outside is None else [outside])])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True, dest="command")
    recording = commands.add_parser("record")
    recording.add_argument("salframe", help="the command to run, such as .venv/bin/salframe")
    recording.add_argument("folder", type=Path)
    recording.add_argument("--data-dir", type=Path, help="folder of the Matterport annotations")
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    if arguments.command == "record":
        record(str(Path(arguments.salframe).absolute()), arguments.folder, arguments.data_dir)
        return 0
    report = compare(arguments.before, arguments.after)
    if arguments.json:
        print(json.dumps(report, indent=1))
    else:
        for name, methods in report.items():
            for method, row in methods.items():
                counts = ", ".join(f"{key} {row.get(key, 0)}" for key in COUNTED)
                deviation = {key: f"{value:.1e}" for key, value in row.get("max_deviation", {}).items()}
                examples = row.get("examples", "")
                print(f"{name:20} {method:16} {row.get('queries', 0):5} queries: {counts}; {deviation} {examples}")
    return int(any(row.get(key) for methods in report.values() for row in methods.values() for key in COUNTED))


if __name__ == "__main__":
    sys.exit(main())
