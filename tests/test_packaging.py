"""The distributions: what they hold, and that each works alone, without the checkout."""

from __future__ import annotations

import fnmatch
import json
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from fresh_environment import make_environment, output, pip_install, see_packages

REPOSITORY = Path(__file__).parent.parent
UNTRACKED = [".git/", *(REPOSITORY / ".gitignore").read_text().split()]
PARTS_TESTED = ("tests/framework", "tests/graphs", "tests/panoramas", "tests/test_docs.py", "tests/test_packaging.py")
"""The part of its own tests that the source distribution runs; its files are those of the checkout."""

WHERE = "import salframe, salframe.configs; print(salframe.__file__, salframe.configs.__file__)"


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    """A copy of the checkout, without what is made in it."""
    folder = tmp_path_factory.mktemp("source") / "salframe"
    shutil.copytree(REPOSITORY, folder, ignore=untracked, symlinks=True)
    return folder


def untracked(folder: str, names: list[str]) -> set[str]:
    """The names in a folder that .gitignore has; a pattern that begins with a slash is of the top folder alone."""
    at_top = Path(folder) == REPOSITORY
    patterns = [pattern.strip("/") for pattern in UNTRACKED if at_top or not pattern.startswith("/")]
    return {name for pattern in patterns for name in fnmatch.filter(names, pattern)}


@pytest.fixture(scope="module")
def source_files(source) -> set[str]:
    """The files of the checkout, listed before anything is built of it."""
    return files_below(source)


@pytest.fixture(scope="module")
def sdist_and_wheel(source, source_files, tmp_path_factory) -> tuple[Path, Path]:
    """The source distribution of the checkout, and the wheel that is built of it."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--outdir", str(folder), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return sdist, wheel


def files_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}


def place_in_wheel(file: str) -> str | None:
    """Where the wheel holds a file of the checkout, None where it does not."""
    folder, _, below = file.partition("/")
    if folder == "salframe":
        return file
    if folder in ("plugins", "baselines"):
        return below
    if folder == "docs":
        return f"salframe/{file}" if file.endswith(".md") else None
    return f"salframe/configs/{below}" if folder == "configs" else None


def test_nothing_in_the_checkout_is_a_link(source):
    """A Windows checkout makes a small text file of each."""
    assert [path for path in source.rglob("*") if path.is_symlink()] == []


@pytest.mark.slow
def test_the_wheel_holds_every_file_of_every_package(sdist_and_wheel, source_files):
    packed = set(zipfile.ZipFile(sdist_and_wheel[1]).namelist())
    information = {name for name in packed if name.startswith("salframe-")}
    assert packed - information == {place for file in source_files if (place := place_in_wheel(file))}
    assert {Path(name).name for name in information} >= {"LICENSE", "entry_points.txt"}


@pytest.mark.slow
def test_the_source_distribution_holds_every_file_of_the_checkout(sdist_and_wheel, source_files):
    with tarfile.open(sdist_and_wheel[0]) as archive:
        packed = {member.name.partition("/")[2] for member in archive if member.isfile()}
    assert packed - {"PKG-INFO"} == source_files


@pytest.mark.slow
def test_the_wheel_alone_runs_the_demo(sdist_and_wheel, tmp_path):
    """Installed from the package index into an empty environment, far from the checkout."""
    python = make_environment(tmp_path / "venv")
    pip_install(python, "--constraint", REPOSITORY / "constraints.txt", sdist_and_wheel[1])
    salframe = python.with_name("salframe")
    assert output(tmp_path, python, "-c", WHERE).count(str(tmp_path / "venv")) == 2
    assert ", no plugin failed" in output(tmp_path, salframe, "doctor")
    assert output(tmp_path, salframe, "docs", "maps").startswith("# ")
    demo = (salframe, "compare", "--methods", "proposed,loftr,objects", "--data", "house-6", "--json")
    accuracy = {row["method"]: row["accuracy"] for row in json.loads(output(tmp_path, *demo))["rows"]}
    assert accuracy.keys() == {"proposed", "loftr-compact", "objects"}
    assert min(accuracy["proposed"], accuracy["loftr-compact"]) >= 0.8
    assert 0.3 < accuracy["objects"] <= accuracy["proposed"]


@pytest.mark.slow
def test_the_source_distribution_passes_its_tests(sdist_and_wheel, tmp_path):
    shutil.unpack_archive(sdist_and_wheel[0], tmp_path, filter="data")
    (unpacked,) = tmp_path.glob("salframe-*")
    python = make_environment(tmp_path / "venv")
    see_packages(python)
    pip_install(python, "--no-deps", "--no-build-isolation", "--editable", unpacked)
    assert output(tmp_path, python, "-c", WHERE).count(str(unpacked)) == 2
    assert " passed" in output(unpacked, python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *PARTS_TESTED)


LOOK = """
import json, sys, salframe
from salframe.framework.components.presets import names
from salframe.framework.components.registry import registry

print(json.dumps({
    "core": salframe.__file__,
    "plugin": sys.modules["salframe_graphs"].__file__ if names("localizer") else None,
    "methods": names("localizer"),
    "presets": [str(path) for path, _ in registry().preset_files()],
    "failures": [str(failure) for failure in registry().failures],
}))
"""


@pytest.fixture(scope="module", params=["installed", "editable"])
def environment(request, source, tmp_path_factory) -> tuple[str, Path]:
    """How the clone was installed into a new environment, and the interpreter of that."""
    python = make_environment(tmp_path_factory.mktemp(request.param))
    see_packages(python)
    editable = ["--editable"] if request.param == "editable" else []
    pip_install(python, "--no-deps", "--no-build-isolation", *editable, source)
    return request.param, python


@pytest.mark.parametrize("place", ["beside the clone", "in the clone", "elsewhere"])
def test_python_finds_salframe_and_its_presets_wherever_it_starts(environment, place, source, tmp_path):
    """The clone is called salframe, as git names it: beside it Python might take it for a namespace package."""
    installation, python = environment
    if place == "beside the clone":
        script = source.parent / "look.py"
        script.write_text(LOOK)
        seen = json.loads(output(source.parent, python, script))
    else:
        seen = json.loads(output(source if place == "in the clone" else tmp_path, python, "-c", LOOK))
    from_clone = installation == "editable" or place == "in the clone"
    home = source if from_clone else python.parents[1]
    assert seen["failures"] == []
    found = (seen["core"], seen["plugin"], *seen["presets"])
    assert [path for path in found if not Path(path).is_relative_to(home)] == []
    assert len(seen["presets"]) == len(list((REPOSITORY / "configs").glob("*/*.yaml")))
    assert {"proposed", "loftr", "sift"} <= set(seen["methods"])


def test_the_import_contracts_are_about_every_package():
    options = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["importlinter"]
    plugins = {path.name for part in ("plugins", "baselines") for path in (REPOSITORY / part).glob("salframe_*")}
    contracts = {contract["type"]: contract for contract in options["contracts"]}
    assert set(options["root_packages"]) == plugins | {"salframe"}
    assert set(contracts["independence"]["modules"]) == set(contracts["forbidden"]["forbidden_modules"]) == plugins
