"""Changes of a map that are killed, or read while they are written: the folder holds the old map or the new one."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from doored_maps import build
from killing import kill_at, killed, start

from salframe.panoramas.opening import find_dataset, find_frame
from salframe.topology.building_map import ask_map
from salframe.topology.map_changes import add_to_map, merge_maps, remove_from_map

CHANGES = {
    "add": lambda: add_to_map("map", "upstairs"),
    "remove": lambda: remove_from_map("map", ["room-1", "room-4"]),
    "merge": lambda: merge_maps("map", ["above"]),
}
EACH = pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())


def answer() -> str:
    """The answer of the map, with all digits; it ranks all places."""
    return str(ask_map("map", find_frame(find_dataset("doored"), "query-1-0")))


@pytest.fixture
def old_and_new(doored, request) -> tuple[str, str]:
    """The answers of the map before and after a change. The change is undone; `saved` and `above` are other maps."""
    build("above", "upstairs")
    build("saved")
    both = []
    for change in (lambda: None, request.node.callspec.params["change"]):
        restore()
        change()
        both.append(answer())
    restore()
    assert both[0] != both[1]
    return both[0], both[1]


def restore() -> None:
    shutil.rmtree("map", ignore_errors=True)
    shutil.copytree("saved", "map")


def at_step(step: int, change: Callable[[], object]) -> None:
    kill_at(step, Path("map"))
    change()


@pytest.mark.slow
@EACH
def test_a_map_is_as_before_or_after_a_change_that_is_killed_at_any_step(old_and_new, change):
    old, new = old_and_new
    after_kill = []
    while killed(start(partial(at_step, len(after_kill) + 1, change))):
        after_kill.append(answer())
        restore()
    assert answer() == new
    assert after_kill == [old] * after_kill.count(old) + [new] * after_kill.count(new)  # it changes once
    assert min(after_kill.count(old), after_kill.count(new)) >= 2


@EACH
def test_a_map_is_as_before_or_after_a_change_that_is_killed_at_any_time(old_and_new, change):
    """The next change removes what killed changes left behind."""
    rng, is_new = random.Random(0), Counter[bool]()
    durations_s = []
    for _ in range(2):  # the first change also loads modules
        began = time.monotonic()
        assert not killed(start(change))
        durations_s.append(time.monotonic() - began)
        restore()
    duration_s = min(durations_s)
    for _ in range(15):
        child = start(change)
        time.sleep(rng.uniform(0, duration_s))
        os.kill(child, signal.SIGKILL)
        if not killed(child):  # the machine has become faster
            duration_s *= 0.8
        after_kill = answer()
        assert after_kill in old_and_new
        is_new[after_kill == old_and_new[1]] += 1
        if after_kill == old_and_new[1]:
            restore()
    assert is_new[False]
    change()
    assert answer() == old_and_new[1]
    assert sorted(path.name.partition("-")[0] for path in Path("map").iterdir()) == ["map.json", "parts"]


@pytest.mark.parametrize("change", [CHANGES["add"]])
def test_readers_see_the_map_before_or_after_while_it_is_written(old_and_new, change):
    def write() -> None:
        for _ in range(8):
            change()
            remove_from_map("map", [f"upper-room-{room}" for room in range(5)])

    counts, writer = Counter[str](), start(write)
    while os.waitpid(writer, os.WNOHANG) == (0, 0):
        counts[answer()] += 1
    assert set(counts) == set(old_and_new)
