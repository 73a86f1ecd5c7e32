"""The example project is installed into a fresh environment and used there, as a stranger would."""

from __future__ import annotations

import json
import os
import shutil
import site
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from tiny_folder import write_tiny_folder

EXAMPLE = Path(__file__).parent.parent / "examples" / "third_party_detector"


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """The interpreter of an environment that sees the packages of this one and has the example installed into it, built
    without a network."""
    home = tmp_path_factory.mktemp("fresh")
    venv.create(home / "venv", with_pip=False)
    python = home / "venv" / "bin" / "python"
    (packages,) = (home / "venv" / "lib").glob("python*/site-packages")
    # addsitedir follows the .pth files there too, so that an editable installation of salframe is seen.
    (packages / "outside.pth").write_text(
        "".join(f"import site; site.addsitedir({folder!r})\n" for folder in site.getsitepackages())
    )
    shutil.copytree(EXAMPLE, home / "example", ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "--quiet",
        "--no-index",
        "--no-deps",
        "--no-build-isolation",
    ]
    subprocess.run([*pip, home / "example"], check=True, capture_output=True)
    return python


def salframe(python: Path, cwd: Path, *arguments: str) -> dict:
    """What `salframe ARGUMENTS --json` prints in the fresh environment."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "SALFRAME_PLUGINS")}
    command = [str(python), "-c", "from salframe.cli import main; main()", *arguments, "--json"]
    done = subprocess.run(
        command,
        cwd=cwd,
        env={**environment, "SALFRAME_CACHE": str(cwd / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_plugin_is_listed_with_its_package(python, tmp_path):
    entries = {entry["name"]: entry for entry in salframe(python, tmp_path, "plugins")["components"]}
    found = entries["height-bands"]
    assert (found["role"], found["package"], found["available"]) == ("detector", "salframe-height-bands", True)
    assert entries["annotations"]["package"] == "salframe"


def test_methods_are_compared_with_its_detector(python, tmp_path):
    data = write_tiny_folder(tmp_path / "tiny")
    found = salframe(
        python,
        tmp_path,
        "compare",
        "--methods",
        "proposed,objects",
        "--set",
        "detector=height-bands",
        "--data",
        str(data),
    )
    rows = {row["method"]: row for row in found["rows"]}
    assert all(row["available"] and row["queries"] == 3 for row in rows.values())
    # Bedroom and kitchen show a low, a middle and a tall object each, the lounge no low one: sets of labels cannot tell
    # the former apart.
    assert rows["objects"]["accuracy"] == pytest.approx(2 / 3)
    assert rows["proposed"]["accuracy"] >= rows["objects"]["accuracy"]
    assert rows["proposed"]["bytes_per_scene"] < 100


def test_it_passes_its_own_tests(python):
    command = [
        str(python),
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        str(python.parents[2] / "example" / "tests"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
