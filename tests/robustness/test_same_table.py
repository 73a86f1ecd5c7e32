"""The same table, whatever the order of sets and the number of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from command_line import without_times
from tiny_folder import write_tiny_folder

MACHINES = ({"PYTHONHASHSEED": "0", "OMP_NUM_THREADS": "1"}, {"PYTHONHASHSEED": "1", "OMP_NUM_THREADS": "2"},
            {"PYTHONHASHSEED": "4242", "OMP_NUM_THREADS": "4"})  # fmt: skip
ASKED = ("compare", "--methods", "proposed,paper,objects,sift", "--data", "./data", "--engine", "inline", "--json")


@pytest.mark.slow
def test_hash_seeds_and_threads_change_no_table(tmp_path):
    write_tiny_folder(tmp_path / "data")
    tables = []
    for number, machine in enumerate(MACHINES):
        environment = os.environ | machine | {"SALFRAME_CACHE": str(tmp_path / f"cache-{number}")}
        command = [sys.executable, "-c", "from salframe.cli import main; main()", *ASKED, "--runs", f"runs-{number}"]
        process = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=True, timeout=300)
        rows = [path.read_text() for path in sorted((tmp_path / f"runs-{number}").glob("*/methods/*/rows.jsonl"))]
        answers = [[without_times(json.loads(line)) for line in text.splitlines()] for text in rows]
        tables.append((without_times(json.loads(process.stdout))["rows"], answers))
    assert len(tables[0][1]) == 4
    assert tables[0] == tables[1] == tables[2]
