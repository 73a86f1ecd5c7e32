"""Measure the time of a query of `proposed`, of one or several versions of salframe in turn.

    python tests/benchmarks/query_time.py [--data NAMES] [--data-dir DIR] [--rounds N] COMMAND [COMMAND ...]

Each COMMAND is the `salframe` of an installed version, such as .venv/bin/salframe; without any, this version is
measured. The versions run in turn, in one process and one thread each. A query's time is the best of its rounds,
without describing its panorama. Printed are the mean, median, 95th percentile and maximum over the queries. `first` is
the first query of a saved map in a fresh process, describing included, and `then` the same query again. Run it on an
idle machine.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

HOUSES = ("house-12", "house-42", "house-106")
REAL = "matterport-annotations"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
FIRST = """
import json, sys, time
from salframe import open_map
from salframe.framework.config import parse_override
from salframe.framework.overrides import nest
from salframe.panoramas.opening import configure_dataset, open_dataset
overrides = [nest(*parse_override(word.removeprefix("data."))) for word in sys.argv[4:]]
_, config = configure_dataset(sys.argv[1], sys.argv[2] or None, overrides)
query = open_dataset(config).folds()[0].queries[0]
panorama = query.load()
start = time.perf_counter()
opened = open_map(sys.argv[3])
seconds = [time.perf_counter() - start]
for _ in range(2):
    start = time.perf_counter()
    opened.localize(panorama)
    seconds.append(time.perf_counter() - start)
print(json.dumps(seconds))
"""


def settings(data: str) -> list[str]:
    """Return the settings of a dataset."""
    return ["data.one_map=true"] if data == REAL else ["data.rgb=false", "data.seed=200"]


def query_ms(command: str, data: str, root: Sequence[str]) -> dict[str, float]:
    """Return the milliseconds of each query of a run."""
    with tempfile.TemporaryDirectory() as work:
        sets = [word for setting in settings(data) for word in ("--set", setting)]
        words = [command, "compare", "--methods", "proposed", "--data", data, *root, *sets, "--workers", "1"]
        words += ["--runs", work, "--json"]
        subprocess.run(words, check=True, capture_output=True, env=_environment(), cwd=work)
        (rows,) = Path(work).glob("*/methods/*/rows.jsonl")
        lines = map(json.loads, rows.read_text(encoding="utf-8").splitlines())
        return {f"{row['fold']} {row['query']}": row["query_ms"] for row in lines}


def first_ms(command: str, data: str, root: Sequence[str]) -> tuple[float, float, float]:
    """Return the milliseconds of opening a saved map, of the first query, and of the same query again."""
    with tempfile.TemporaryDirectory() as work:
        sets = [word for setting in settings(data) for word in ("--set", setting)]
        built = [command, "build", data, *root, *sets, "-o", f"{work}/map"]
        subprocess.run(built, check=True, capture_output=True, env=_environment(), cwd=work)
        python = Path(command).with_name("python")
        words = [str(python), "-c", FIRST, data, *(root[1:] or [""]), f"{work}/map", *settings(data)]
        done = subprocess.run(words, check=True, capture_output=True, text=True, env=_environment(), cwd=work)
        opening, first, then = (1e3 * seconds for seconds in json.loads(done.stdout))
        return opening, first, then


def _environment() -> dict[str, str]:
    return {**os.environ, **ONE_THREAD}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default=",".join(HOUSES), help="datasets, comma-separated")
    parser.add_argument("--data-dir", help="folder of the Matterport annotations; adds one map of all its buildings")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("commands", nargs="*", default=[str(Path(sys.executable).with_name("salframe"))])
    options = parser.parse_args()
    commands = [str(Path(command).absolute()) for command in options.commands]
    for data in [*options.data.split(","), *([REAL] if options.data_dir else [])]:
        root = ["--data-dir", options.data_dir] if data == REAL else []
        best: dict[str, dict[str, float]] = {}
        for command in commands * options.rounds:
            for query, ms in query_ms(command, data, root).items():
                known = best.setdefault(command, {})
                known[query] = min(ms, known.get(query, np.inf))
        for command in commands:
            ms = np.array([*best[command].values()])
            opening, first, then = first_ms(command, data, root)
            median, late = np.percentile(ms, [50, 95])
            print(
                f"{data}, {len(ms)} queries, {command}: mean {ms.mean():.2f} ms, median {median:.2f}, p95 {late:.2f}, "
                f"max {ms.max():.2f}; opening {opening:.0f}, first {first:.0f}, then {then:.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
