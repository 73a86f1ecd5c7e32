"""The engine `processes`: an interruption ends its own processes, at once, and no other; what one may use, and what its
end costs."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from salframe_engines import Processes
from work_items import answer

from salframe.framework.engines.worker import ONE_THREAD
from salframe.framework.errors import SalframeError, WorkerDied
from salframe.framework.files.writing import atomic_path


def sleep(marker: Path) -> None:
    with atomic_path(marker.with_suffix(".half")):
        marker.touch()
        time.sleep(60)


def hang(marker: Path) -> None:
    """As a library does that no signal reaches."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sleep(marker)


def die_once(marker: Path) -> str:
    if marker.exists():
        return marker.name
    marker.touch()
    os._exit(3)


def die(marker: Path) -> None:
    with marker.open("a") as file:
        file.write("tried\n")
    os._exit(3)


def process_of(item: object) -> int:
    time.sleep(0.05)
    return os.getpid()


def threads_added(size: int) -> int:
    """How many threads libraries start for work that would be shared between several."""
    import cv2
    import torch

    rng = np.random.default_rng(0)
    before = len(os.listdir("/proc/self/task"))
    image = rng.random((size, size), np.float32)
    tensor = torch.from_numpy(image @ image)
    cv2.GaussianBlur(image, (0, 0), 5.0)
    (tensor @ tensor).sum()
    return len(os.listdir("/proc/self/task")) - before


def environment(item: object) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in ONE_THREAD}


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


@pytest.mark.parametrize(("begun", "function"), [(0, sleep), (1, sleep), (2, sleep), (2, hang)])
def test_an_interruption_ends_its_own_processes_alone(interruptible, foreign, tmp_path, begun, function):
    """Also where none has begun its work yet: a process that is just starting is ended or never started."""
    sent: list[float] = []

    def interrupt() -> None:
        while len(list(tmp_path.glob("?"))) < begun:
            time.sleep(0.01)
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.02, interrupt)

    def interrupted() -> None:
        timer.start()
        map_all([tmp_path / str(number) for number in range(4)], 2, function)

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - sent[0] < 2  # the work of each would have taken 60
    assert multiprocessing.active_children() == [foreign]
    if function is sleep:  # what can be told to end leaves no file half written
        assert list(tmp_path.glob(".*")) == []
    timer.join()


def test_an_item_costs_only_itself():
    first, died, left, locked, last = map_all(["a", "die", "leave", "lock", "b"], 2, answer)
    assert (first, last) == ("a", "b")
    assert isinstance(died, SalframeError)
    assert "the worker process died" in str(died)
    assert isinstance(left, SystemExit)
    assert "cannot pickle '_thread.lock' object" in str(locked)


def test_what_cannot_be_pickled_is_its_items_exception():
    (error,) = map_all([threading.Lock()], function=answer)
    assert "Could not pickle the task" in str(error)


def test_a_worker_takes_item_after_item_and_no_more_than_asked_for_work():
    processes = map_all(range(12), 2, process_of)
    assert len(set(processes)) == 2
    assert os.getpid() not in processes
    assert not set(processes) & set(map_all(range(4), 2, process_of))


def test_an_item_whose_worker_died_is_tried_once_more(tmp_path):
    items = [tmp_path / name for name in "abc"]
    engine = Processes(Processes.Config(workers=2))
    assert sorted(engine.try_all(die_once, items)) == ["a", "b", "c"]
    (died,) = engine.try_all(die, [tmp_path / "d"])
    assert isinstance(died, WorkerDied)
    assert (tmp_path / "d").read_text() == "tried\ntried\n"


def test_so_many_workers_have_one_thread_each_and_one_alone_by_default_has_all(monkeypatch):
    for name in ONE_THREAD:
        monkeypatch.delenv(name, raising=False)
    for workers in (1, 2):
        assert map_all([0, 1], workers, environment) == [ONE_THREAD] * 2
    assert map_all([0], 2, environment) == [ONE_THREAD]
    assert map_all([0], None, environment) == [dict.fromkeys(ONE_THREAD)]


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="the system does not tell the threads of a process")
@pytest.mark.parametrize("workers", [1, 2])
def test_libraries_of_so_many_workers_start_no_threads(workers, monkeypatch):
    pytest.importorskip("torch")
    for name in ONE_THREAD:
        monkeypatch.delenv(name, raising=False)
    assert map_all([500, 500], workers, threads_added) == [0, 0]
