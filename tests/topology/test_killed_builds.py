"""Killed `salframe build` processes, with and without topology: the folder holds the old map or the new one."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
from killing import kill_at, killed, start

from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError
from salframe.localization.map import open_map
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.opening import find_dataset, find_frame
from salframe.topology.building_map import ask_map, build_map

NO_MAP = "contains no map: build one with salframe"


EITHER = pytest.mark.parametrize(
    "topology", [pytest.param(False, id="no topology"), pytest.param(True, id="topology", marks=pytest.mark.slow)]
)


@dataclass(frozen=True)
class Site:
    """A folder to which maps of two buildings are written in turn, and a query that they answer differently."""

    topology: bool
    folder: Path
    data: str
    method: str
    buildings: tuple[tuple[str, ...], tuple[str, ...]]
    query: QueryFrame

    def build(self, building: int) -> None:
        build_map(self.data, self.folder, self.method, topology=self.topology, overrides=self.buildings[building])

    def ask(self) -> str:
        """The answer of the map, with all digits; with a topological map it includes the nearest node."""
        try:
            if self.topology:
                return str(ask_map(self.folder, self.query))
            return str(open_map(self.folder).localize(self.query))
        except DataError as error:
            if NO_MAP in str(error):
                return NO_MAP
            raise

    def answers(self) -> list[str]:
        """The answers of the maps of both buildings; the second map stays in the folder."""
        answers = []
        for building in (0, 1):
            self.build(building)
            answers.append(self.ask())
        assert answers[0] != answers[1]
        return answers

    def is_complete(self) -> bool:
        """Whether the folder holds one complete map, and no parts of another."""
        return sorted(path.name.partition("-")[0] for path in self.folder.iterdir()) == ["map.json", "parts"]

    def parts(self) -> set[Path]:
        return set(self.folder.glob("parts-*"))


@pytest.fixture
def rooms(fakes, monkeypatch, tmp_path) -> Callable[..., Site]:
    """A function that returns a site with three or five rooms in a row."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,doored_plugin")
    registry.cache_clear()
    query = find_frame(find_dataset("doored"), "query-1-0")
    buildings = ("data.rooms=3",), ("data.rooms=5", "offset=1")
    return lambda topology: Site(topology, tmp_path / "map", "doored", "reader", buildings, query)


def steps(site: Site, building: int) -> Iterator[int]:
    """Build once for each step that changes the folder, and kill the build at that step."""
    step = 1
    while killed(start(partial(be_killed, step, site, building))):
        yield step
        step += 1


def be_killed(step: int, site: Site, building: int) -> None:
    kill_at(step, site.folder)
    site.build(building)


@EITHER
def test_a_map_that_is_replaced_is_the_old_or_the_new_at_every_step(rooms, topology):
    site = rooms(topology)
    new, old = site.answers()
    after_kill = []
    for _ in steps(site, 0):
        after_kill.append(site.ask())
        site.build(1)
        assert site.ask() == old
        assert site.is_complete()
    assert site.ask() == new
    assert after_kill == [old] * after_kill.count(old) + [new] * after_kill.count(new)  # it changes once
    assert min(after_kill.count(old), after_kill.count(new)) >= 2


@EITHER
def test_a_first_build_that_is_killed_leaves_none_and_is_repeated(rooms, topology):
    site = rooms(topology)
    new, _ = site.answers()
    shutil.rmtree(site.folder)
    after_kill = []
    for _ in steps(site, 0):
        after_kill.append(site.ask())
        site.build(0)
        assert site.ask() == new
        assert site.is_complete()
        shutil.rmtree(site.folder)
    assert site.ask() == new
    assert set(after_kill) == {NO_MAP}
    assert len(after_kill) >= 10


@pytest.mark.slow
@EITHER
def test_fifty_kills_at_any_time(topology, tmp_path):
    """Homes of 6 rooms by `proposed`: half of the kills at any time of the build, half while the map is being written;
    every fifth of a first build."""
    buildings = tuple(("data.rgb=false", f"data.seed={seed}") for seed in (1, 2))
    query = find_frame(find_dataset("house-6", overrides=buildings[0]), "query-0020")
    site = Site(topology, tmp_path / "map", "house-6", "proposed", buildings, query)
    answers, rng, counts = site.answers(), random.Random(0), Counter[str]()
    began = time.monotonic()
    site.build(1)
    whole_s = time.monotonic() - began
    began = time.monotonic()
    open_map(site.folder).save(tmp_path / "copy")
    writing_s = time.monotonic() - began
    kill = 0
    while kill < 50:
        old, new = answers[(kill + 1) % 2], answers[kill % 2]
        if first := kill % 5 == 0:
            shutil.rmtree(site.folder)
        before = site.parts()
        child = start(partial(site.build, kill % 2))
        if kill % 2:
            while site.parts() <= before:  # the folder of the new parts is the first that it makes
                pass
            time.sleep(rng.uniform(0, writing_s))
        else:
            time.sleep(rng.uniform(0, whole_s))
        os.kill(child, signal.SIGKILL)
        if not killed(child):  # it had ended
            assert site.ask() == new
            site.build((kill + 1) % 2)
            continue
        answer = site.ask()
        assert answer in (new, NO_MAP if first else old)
        counts[f"{ {new: 'new', old: 'old', NO_MAP: 'no'}[answer] } map, {len(site.parts() - before)} new parts"] += 1
        site.build(kill % 2)
        assert site.ask() == new
        assert site.is_complete()
        kill += 1
    print(dict(counts))
