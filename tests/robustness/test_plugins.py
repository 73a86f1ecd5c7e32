"""Other people's code that goes wrong costs its own row: the other methods, its other queries and the output go on."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

TESTS = Path(__file__).parent.parent
DIED = "the worker process died: it was killed, ran out of memory, or crashed in a library"
RAISED = {
    "raise": "ValueError: this is too much",
    "leave": "SystemExit: the network wants to leave",
    "recurse": "RecursionError: maximum recursion depth exceeded.*",
}
DEAD = {"exit": DIED, "fault": DIED, "hoard": "the worker process used more than 450 MB, the limit of --memory"}
LONG = "the worker process took more than 10 s, the limit of --timeout"
ALL = {(when, how): reason for when in ("init", "map") for how, reason in (RAISED | DEAD).items()}
QUERY = {
    **{("query", how): reason for how, reason in (RAISED | DEAD).items()},
    ("query", "hang"): LONG,
    ("query", "spin"): LONG,
}
FAULTS = {
    "inline": {key: reason for key, reason in (ALL | QUERY).items() if key[1] in RAISED},
    "processes": ALL | QUERY,
}
LIMITS = {"inline": (), "processes": ("--timeout", "10", "--memory", "450", "--set", "engine.workers=2")}
ENGINES = [pytest.param("inline"), pytest.param("processes", marks=pytest.mark.slow)]

PLUGIN = (
    "import salframe\nfrom fake_plugin import Reader\n{}\n@salframe.hookimpl\ndef salframe_provides(): return [{}]\n"
)
MODULES = {
    "fails": ("1 / 0", "", "ZeroDivisionError: division by zero"),
    "leaves": ("raise SystemExit(3)", "", "SystemExit: 3"),
    "prints": ("print('{')", "", None),
    "twin": (
        "class Other(Reader):\n    name = 'reader'",
        "Other",
        "the package twin registers the localizer 'reader', a name that the package fake_plugin already uses",
    ),
    "careless": (
        "from salframe.framework.component import ComponentConfig\nclass Careless(Reader):\n    name = 'careless'\n"
        "    class Config(ComponentConfig):\n        depth: int",
        "Careless",
        "Careless.Config has no default for depth, expected a default for every setting",
    ),
    "wild": (
        "class Wild(Reader):\n    name = 'wild'\n    Config = 3",
        "Wild",
        "AttributeError: 'int' object has no attribute 'component'",
    ),
}
"""A line or more of a module, what it provides, and why it is not loaded."""


def salframe(folder: Path, *words: str, plugins: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {
        "SALFRAME_PLUGINS": plugins,
        "SALFRAME_CACHE": str(folder / "cache"),
        "PYTHONPATH": os.pathsep.join([str(TESTS), str(folder)]),
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-c", "from salframe.cli import main; main()", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def rows_of(process: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """The rows by method; what plugins print is on stderr, and so is no traceback."""
    assert not re.search("Traceback|Fatal Python error", process.stderr), process.stderr
    return {row["method"]: row for row in json.loads(process.stdout)["rows"]}


@pytest.mark.parametrize("engine", ENGINES)
def test_each_fault_costs_its_own_row(tmp_path, engine):
    faults = FAULTS[engine]
    for when, how in (*faults, ("query", "print")):
        (tmp_path / f"{when}-{how}.yaml").write_text(yaml.safe_dump({"kind": "deadly", "when": when, "how": how}))
    methods = [*(f"{when}-{how}.yaml" for when, how in faults), "query-print.yaml", "reader"]
    command = ("compare", "--methods", ",".join(methods), "--data", "rooms", "--engine", engine, "--json")
    rooms = ("--set", "data.rooms=3", "--set", "data.queries=1")
    process = salframe(
        tmp_path, *command, *rooms, *LIMITS[engine], plugins="fake_plugin,faulty_plugin,salframe_engines"
    )
    assert process.returncode == 1
    rows = rows_of(process)
    for (when, how), reason in faults.items():
        row = rows[f"{when}-{how}"]
        if when == "query" and how != "leave":
            assert row["status"] == {"ok": 2, "crashed": 1}, row
            assert row["accuracy"] == pytest.approx(2 / 3)
            assert re.fullmatch(reason, row["errors"]["crashed"]), row
        else:
            assert (row["ended"], row["accuracy"]) == ("crashed", None), row
            assert re.fullmatch(reason, row["reason"]), row
    for method in ("query-print", "reader"):
        assert (rows[method]["accuracy"], rows[method]["status"]) == (1.0, {"ok": 3})
    assert "{" in process.stderr


def test_a_module_that_cannot_be_loaded_is_told_and_stops_nothing(tmp_path):
    for name, (code, provided, _) in MODULES.items():
        (tmp_path / f"{name}.py").write_text(PLUGIN.format(code, provided))
    plugins = ",".join(("fake_plugin", "salframe_engines", *MODULES))
    command = ("compare", "--methods", "reader", "--data", "rooms", "--set", "data.rooms=3", "--engine", "inline")
    process = salframe(tmp_path, *command, "--json", plugins=plugins)
    assert process.returncode == 0
    assert rows_of(process)["reader"]["accuracy"] == 1.0
    check = salframe(tmp_path, "doctor", "--json", plugins=plugins)
    assert check.returncode == 1
    reasons = {failure["plugin"]: failure["reason"] for failure in json.loads(check.stdout)["failures"]}
    expected = {name: reason for name, (_, _, reason) in MODULES.items() if reason}
    assert reasons.keys() == expected.keys()
    for name, reason in expected.items():
        assert re.search(reason, reasons[name]), reasons[name]
