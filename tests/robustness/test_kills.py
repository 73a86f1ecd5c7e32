"""Commands that write, killed at any time: what they wrote is whole, and the same command ends as if nothing was."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import sys
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from command_line import without_times

from salframe.framework.files.image_files import read_image

sys.path.insert(0, str(Path(__file__).parent))

from sites import INLINE, PLUGINS, ROOMS, Site, SiteResult

SEED = int(os.environ.get("SALFRAME_TEST_SEEDS", "1").split(",")[0])
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="it forks")


@dataclass(frozen=True)
class Job:
    """A command; the pattern of the files that it writes, each of which is whole as soon as it is there; the command
    that looks at what it wrote, which may say in one line that nothing is there; its plugins."""

    words: tuple[str, ...]
    files: str = "nothing"
    look: tuple[str, ...] = ()
    plugins: str = PLUGINS


RUNS = ("evaluate", "runs/*", "--json")
JOBS = {
    "compare": Job(("compare", "--methods", "reader,greedy", *ROOMS, *INLINE), look=RUNS),
    "compare, processes": Job(("compare", "--methods", "reader", *ROOMS, "--json"), look=RUNS),
    "ablate": Job(("ablate", "study.yaml", *INLINE)),
    "evaluate": Job(("evaluate", "done/*", "--json"), "done/*/methods/*/metrics.json"),
    "experiment": Job(("experiment", "rooms.yaml", "--results", "results", *INLINE), "results/*.json"),
    "matching": Job(
        ("matching", "--methods", "points", "--data", "furnished", *INLINE),
        look=RUNS,
        plugins="matching_plugin,salframe_engines",
    ),
    "detection": Job(("detection", "--detectors", "annotations", "--data", "./data", *INLINE), look=RUNS),
    "navigate": Job(
        ("navigate", "--methods", "seer", "--data", "apartment", "--episodes", "4", *INLINE),
        look=RUNS,
        plugins="apartment_plugin,salframe_engines,salframe_planners,salframe_trackers",
    ),
    "report": Job(("report", "done/*", "-o", "page.html"), "page.html"),
    "fit": Job(("fit", "reader", *ROOMS, "-o", "fitted.yaml"), "fitted.yaml"),
    "sensor": Job(
        ("sensor", "annotations", "--data", "./data", "-o", "sensor.json", *INLINE), "sensor.json", look=RUNS
    ),
    "build": Job(
        ("build", "rooms", "-o", "map", "--method", "reader"),
        look=("localize", "map", "query-1-0", "--data", "rooms", "--json"),
    ),
    "map build": Job(
        ("map", "build", "doored", "-o", "map", "--method", "reader"),
        look=("map", "query", "map", "query-1-0", "--data", "doored", "--to", "room-3", "--json"),
        plugins=f"{PLUGINS},salframe_planners",
    ),
    "map show": Job(("map", "show", "ways", "-o", "ways.png"), "ways.png"),
    "map export": Job(("map", "export", "ways", "ways.graphml"), "ways.graphml"),
    "show-objects": Job(
        ("show-objects", "data/frames/kitchen-map.rgb.png", "--detector", "annotations", "-o", "shown"),
        "shown/*.png",
        plugins=f"{PLUGINS},salframe_graphs",
    ),
    "data render": Job(("data", "render", "small"), "cache/small/**/[!.]*.*"),
    "weights fetch": Job(("weights", "fetch", "small"), "cache/weights/*/[!.]*"),
    "cache clear": Job(("cache", "clear")),
}


def read_files(job: Job, place: Path) -> dict[str, Any]:
    """The files of a job that are there, without times; the pictures of objects tell the seconds: their size."""

    def read(path: Path) -> Any:
        if path.suffix == ".json":
            return without_times(json.loads(path.read_text()))
        return read_image(path, 1).shape if path.parent.name == "shown" else path.read_bytes()

    paths = (path for path in place.glob(job.files) if path.is_file() and path.name[0] != ".")
    return {str(path.relative_to(place)): read(path) for path in paths}


def is_part(part: Any, whole: Any) -> bool:
    """Whether this is the whole, or tables of it, each whole."""
    if isinstance(part, dict) and isinstance(whole, dict):
        return all(key in whole and is_part(value, whole[key]) for key, value in part.items())
    return part == whole


def whole_rows(place: Path) -> dict[Path, bytes]:
    """The rows that a kill may not cost: all whole lines."""
    contents = ((path, path.read_bytes()) for path in place.glob("runs/*/methods/*/rows.jsonl"))
    return {path: content[: content.rfind(b"\n") + 1] for path, content in contents}


class Trial:
    """A job, done once without being killed."""

    def __init__(self, site: Site, job: Job) -> None:
        self._site, self._job = site, job
        place = site.fresh()
        result = self._call(job.words, place)
        assert result.code == 0, result
        self._steps, self._content, self._files = result.changes, result.content, read_files(job, place)
        assert self._files or job.files == Job.files
        self._look = self._call(job.look, place).content if job.look else None
        for module in result.modules:  # what this process has imported, its forks need not
            if not module.endswith("_plugin"):
                with suppress(Exception):
                    import_module(module)
        place, began = site.fresh(), time.monotonic()
        assert (self._call(job.words, place).content, read_files(job, place)) == (self._content, self._files)
        self._whole_s = time.monotonic() - began

    def kill(self, rng: random.Random) -> str | None:
        """Begin the job, kill it, at a time or at one of its changes, and do it again; what was lost, "" where nothing
        was, None where it had ended before."""
        place, at_step = self._site.fresh(), self._steps and rng.random() < 0.5
        step = rng.randint(1, self._steps) if at_step else None
        child = self._site.begin(self._job.words, place, self._job.plugins, step)
        if not at_step:
            time.sleep(rng.uniform(0, self._whole_s))
            os.kill(child, signal.SIGKILL)
        if self._site.end(child) is not None:
            return None
        rows, incomplete = whole_rows(place), self._incomplete(place)
        result = self._call(self._job.words, place)
        cost = [str(path) for path, content in rows.items() if not path.read_bytes().startswith(content)]
        other = "" if result.content == self._content else f"printed {result}, not {self._content}"
        files = "" if read_files(self._job, place) == self._files else "other files"
        return "; ".join(filter(None, (incomplete, *cost, other, files)))

    def _call(self, words: tuple[str, ...], place: Path) -> SiteResult:
        return self._site.call(words, place, self._job.plugins)

    def _incomplete(self, place: Path) -> str:
        """What is there and is not whole."""
        files = read_files(self._job, place)
        incomplete = [name for name, part in files.items() if not is_part(part, self._files[name])]
        if self._look is not None:
            result = self._call(self._job.look, place)
            nothing = re.fullmatch(r"error: .+\n", result.err) if result.code == 2 else "unfinished" in result.out
            if result.content != self._look and not nothing:
                incomplete.append(str(result))
        return ", ".join(incomplete)


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Site:
    return Site(tmp_path_factory.mktemp("kills"))


def kill_all(site: Site, jobs: list[str], kills: int) -> None:
    rng, trials = random.Random(SEED), {name: Trial(site, JOBS[name]) for name in jobs}
    losses, count = [], Counter[str]()
    while count.total() < kills:
        name = jobs[count.total() % len(jobs)]
        loss = next(filter(lambda one: one is not None, (trials[name].kill(rng) for _ in range(50))))
        count[name] += 1
        if loss:
            losses.append(f"{name}: {loss}")
    print(f"seed {SEED}, {kills} kills of {len(jobs)} commands: {len(losses)} lost")
    assert not losses, "\n".join(losses)


def test_kills_of_a_comparison_lose_nothing(site):
    kill_all(site, ["compare"], 5)


@pytest.mark.slow
def test_100_kills_of_every_command_that_writes_lose_nothing(site):
    kill_all(site, list(JOBS), 100)
