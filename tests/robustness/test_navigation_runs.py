"""Damaged runs of navigation are one clear line, and nothing that hangs."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from command_line import run

sys.path.insert(0, str(Path(__file__).parent))

from commands import UNFORESEEN
from mutator import damage
from test_once_failing_files import json_file, text_file

from salframe.framework.components.registry import registry
from salframe.framework.config import read_yaml

TESTS = Path(__file__).parent.parent
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="it makes FIFOs")
NAVIGATE = ("navigate", "--methods", "seer", "--data", "apartment", "--episodes", "3", "--engine", "inline")
ROWS = "runs/*/methods/seer/rows.jsonl"
REQUEST = "runs/*/request.yaml"


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Iterator[Path]:
    """A folder with a run of navigation."""
    root = tmp_path_factory.mktemp("navigation")
    folders = [str(TESTS), str(TESTS / "navigation"), os.environ.get("PYTHONPATH", "")]
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(TESTS / "navigation")
        patch.setenv("PYTHONPATH", os.pathsep.join(folders))
        patch.setenv("SALFRAME_PLUGINS", "apartment_plugin,salframe_engines,salframe_planners,salframe_trackers")
        patch.setenv("SALFRAME_CACHE", str(root / "cache"))
        patch.chdir(root)
        registry.cache_clear()
        assert run(*NAVIGATE).code == 0
        yield root
    registry.cache_clear()


def yaml_file(change):
    """Change the content of the request of the run."""

    def spoil(root: Path) -> None:
        import yaml

        path = next(root.glob(REQUEST))
        content = read_yaml(path)
        change(content)
        path.write_text(yaml.safe_dump(content))

    return spoil


FAULTS = {
    "packages": (json_file("runs/*/env.json", lambda env: env.update(packages="NaN")), r"env\.json: key packages"),
    "fingerprint": (
        json_file("runs/*/env.json", lambda env: env.update(dataset_fingerprint=[])),
        r"env\.json: key data",
    ),
    "believed": (json_file(ROWS + ".one", lambda row: row.update(believed=[[[1]]])), r"rows\.jsonl, line 1.*believed"),
    "believed of one": (json_file(ROWS + ".one", lambda row: row.update(believed=[[1.0]])), r"rows\.jsonl, line 1"),
    "episode": (json_file(ROWS + ".one", lambda row: row.update(episode=2**63)), r"rows\.jsonl, line 1.*episode"),
    "episodes": (
        yaml_file(lambda content: content["task"].update(episodes=2**63)),
        r"request\.yaml: key task: episodes: received 9",
    ),
    "no episodes": (
        yaml_file(lambda content: content["task"].pop("episodes")),
        r"the required key task\.episodes is missing",
    ),
    "seed": (yaml_file(lambda content: content["task"].update(seed=-1)), r"request\.yaml: key task\.seed"),
    "settings": (yaml_file(lambda content: content["task"].update(settings=[])), r"request\.yaml: key task\.settings"),
    "arrival": (
        yaml_file(lambda content: content["task"]["settings"].update(arrival_m=1e308)),
        r"task: settings\.arrival_m: received 1e\+308, expected a number from -1e\+12 to 1e\+12",
    ),
    "no JSON": (text_file("runs/*/env.json", "[1]"), r"env\.json contains a list, expected a JSON object"),
}


@pytest.fixture
def spoil(sound, tmp_path, monkeypatch):
    """Copy the run to the working folder and spoil it; rows are spoilt as a file of one row."""
    shutil.copytree(sound / "runs", tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("change", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_a_spoilt_run_is_one_line(spoil, change, message):
    rows = next(spoil.glob(ROWS))
    one, *others = rows.read_text().splitlines(keepends=True)
    rows.with_name("rows.jsonl.one").write_text(one)
    change(spoil)
    rows.write_text("".join([rows.with_name("rows.jsonl.one").read_text().rstrip("\n") + "\n", *others]))
    for words in (("evaluate",), ("report", "-o", "page.html")):
        result = run(*words, next(spoil.glob("runs/*")))
        assert (result.code, result.out) == (2, ""), result
        assert re.fullmatch(f"error: .*({message}).*\n", result.err), result.err


def check(folder: Path, cases: int, seed: int) -> None:
    shutil.copytree(folder / "runs", folder / "sound")
    for case in range(cases):
        rng = np.random.default_rng([seed, case])
        shutil.rmtree(folder / "runs")
        shutil.copytree(folder / "sound", folder / "runs")
        files = sorted(path for path in folder.glob("runs/**/*") if path.is_file())
        path = files[rng.integers(len(files))]
        what = f"seed {seed}, case {case}: {damage(path, rng)} of {path}"
        words = (("evaluate",), ("report", "-o", "page.html"))[case % 2]
        result = run(*words, next(folder.glob("runs/*")))
        text = result.out + result.err
        assert result.code in (0, 1, 2), f"{what}: {result}"
        assert not re.search("Traceback", text), f"{what}: {text}"
        assert not UNFORESEEN.search(text), f"{what}: {text}"
        if result.code == 2:
            assert re.fullmatch("(.*\n)?error: .*\n", result.err), f"{what}: {result.err}"


def test_damaged_runs_of_navigation(spoil):
    check(spoil, 60, 0)


@pytest.mark.slow
def test_many_damaged_runs_of_navigation(spoil):
    check(spoil, 1000, 1)
