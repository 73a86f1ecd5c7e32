"""The engine `processes`: an interruption ends its own processes, at once, and no other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from pathlib import Path

import pytest
from salframe_engines import Processes

from salframe.framework.errors import SalframeError


def sleep(marker: Path) -> None:
    marker.touch()
    time.sleep(60)


def answer(item: str) -> object:
    if item == "die":
        os._exit(3)
    if item == "leave":
        raise SystemExit("leaving")
    return threading.Lock() if item == "lock" else item


def map_all(items, workers=1, function=sleep):
    return list(Processes(Processes.Config(workers=workers)).map(function, items))


@pytest.fixture
def foreign():
    """A process of whoever uses salframe as a library."""
    process = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
    process.start()
    yield process
    process.kill()
    process.join()


@pytest.mark.parametrize("begun", [0, 1, 2])
def test_an_interruption_ends_its_own_processes_alone(interruptible, foreign, tmp_path, begun):
    """Also where none has begun its work yet: a process that is just starting is ended or never started."""
    sent: list[float] = []

    def interrupt() -> None:
        while len(list(tmp_path.iterdir())) < begun:
            time.sleep(0.01)
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.02, interrupt)

    def interrupted() -> None:
        timer.start()
        map_all([tmp_path / str(number) for number in range(4)], workers=2)

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - sent[0] < 30  # the work of each would have taken 60
    assert multiprocessing.active_children() == [foreign]
    timer.join()


def test_an_item_costs_only_itself():
    first, died, left, locked, last = map_all(["a", "die", "leave", "lock", "b"], 2, answer)
    assert (first, last) == ("a", "b")
    assert isinstance(died, SalframeError)
    assert "its process died" in str(died)
    assert isinstance(left, SystemExit)
    assert "cannot pickle '_thread.lock' object" in str(locked)


def test_what_cannot_be_pickled_is_its_items_exception():
    (error,) = map_all([threading.Lock()], function=answer)
    assert "Could not pickle the task" in str(error)
