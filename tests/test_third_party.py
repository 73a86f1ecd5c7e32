"""The example project is installed into a fresh environment and used there, as a stranger would."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from fresh_environment import make_environment, output, pip_install, see_packages

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parent.parent / "examples" / "third_party"
PACKAGE = "salframe-rangefinder"


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """The interpreter of an environment that sees the packages of this one and has the example installed into it, built
    without a network."""
    home = tmp_path_factory.mktemp("fresh")
    python = make_environment(home / "venv")
    see_packages(python)
    shutil.copytree(EXAMPLE, home / "example", ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    pip_install(python, "--no-index", "--no-deps", "--no-build-isolation", home / "example")
    return python


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Where its commands are run: what one of them answers, the next may reuse."""
    return tmp_path_factory.mktemp("work")


def salframe(python: Path, folder: Path, *arguments: str) -> str:
    """What `salframe ARGUMENTS` prints in the fresh environment."""
    return output(folder, python, "-c", "from salframe.cli import main; main()", *arguments)


def test_what_it_brings_is_listed_with_its_package(python, folder):
    found = json.loads(salframe(python, folder, "plugins", "--json"))
    assert found["failures"] == []
    brought = {(entry["role"], entry["name"]) for entry in found["components"] if entry["package"] == PACKAGE}
    assert brought == {
        ("dataset", "box-rooms"),
        ("detector", "height-bands"),
        ("saliency", "apparent-size"),
        ("matcher", "box-sizes"),
        ("positioner", "planar-fit"),
        ("evidence", "range-spectrum"),
        ("planner", "networkx"),
        ("localizer", "range-profile"),
        ("tracker", "confirmed-answers"),
    }
    assert all(entry["available"] for entry in found["components"] if entry["package"] == PACKAGE)
    presets = {(entry["folder"], entry["name"]) for entry in found["presets"] if entry["package"] == PACKAGE}
    assert presets == {("methods", "bands"), ("data", "box-rooms-8"), ("ablations", "bands")}
    assert {"name": "bands", "package": PACKAGE} in found["commands"]
    assert "salframe" in {entry["package"] for entry in found["components"]}


def test_its_methods_are_compared_on_its_data(python, folder):
    methods, data = ("--methods", "bands,range-profile"), ("--data", "box-rooms-8")
    rows = json.loads(salframe(python, folder, "compare", *methods, *data, "--engine", "inline", "--json"))["rows"]
    assert [row["method"] for row in rows] == ["bands", "range-profile"]
    # 8 queries, 0.3 m from the reference frame of their room: by chance, one answer would be correct.
    assert all(row["accuracy"] >= 0.5 and row["median_rotation_deg"] < 5 for row in rows)


def test_its_ablation_has_a_row_a_combination(python, folder):
    found = json.loads(salframe(python, folder, "ablate", "bands", "--engine", "inline", "--json"))
    assert {row["method"] for row in found["rows"]} == {
        f"bands[saliency={saliency},detector.min_pixels={pixels}]"
        for saliency in ("apparent-size", "volumetric")
        for pixels in (100, 400)
    }
    assert all(row["queries"] == 8 for row in found["rows"])


def test_its_command_is_one_of_salframes(python, folder):
    assert "Print the objects that `height-bands` finds" in salframe(python, folder, "bands", "--help")
    lines = salframe(python, folder, "bands", "room-0/query").splitlines()
    assert lines
    for line in lines:
        label, _, where = line.partition(": ")
        assert label in ("low object", "middle object", "tall object")
        # The walls are at most 3.5 m from the middle, and the query 0.3 m beside it.
        assert 0 < float(where.split()[0]) < 5.5


def test_it_passes_its_own_tests(python, folder):
    tests = python.parents[2] / "example" / "tests"
    assert " passed" in output(folder, python, "-m", "pytest", "-q", "-p", "no:cacheprovider", tests)
