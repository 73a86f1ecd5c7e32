"""Processes that work: a plain script may start them, and they end with whoever started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from loky.backend.queues import Queue

from salframe.framework.engines.process_pool import ProcessPool

SCRIPT = """
import sys
from salframe.framework.engines.process_pool import ProcessPool

print("main", flush=True)

def double(number):
    return 2 * number, "__main__" in sys.modules

with ProcessPool(2) as pool:
    print([future.result()[0] for future in [pool.submit(double, number) for number in (1, 2, 3)]])
"""
"""It runs at once, without `if __name__ == "__main__":`, and what it sends is its own."""
ORPHAN = """
import os, sys, time
from salframe.framework.engines.process_pool import ProcessPool

def work(path):
    open(path, "w").write(str(os.getpid()))
    time.sleep(60)

with ProcessPool(1) as pool:
    pool.submit(work, sys.argv[1]).result()
"""


@pytest.mark.parametrize("way", ["a file", "stdin", "-c", "-m"])
def test_a_plain_script_needs_no_guard(way, tmp_path):
    (tmp_path / "plain.py").write_text(SCRIPT)
    given = {"a file": ["plain.py"], "stdin": ["-"], "-c": ["-c", SCRIPT], "-m": ["-m", "plain"]}[way]
    done = subprocess.run(
        [sys.executable, *given],
        cwd=tmp_path,
        input=SCRIPT if way == "stdin" else None,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "main\n[2, 4, 6]\n", "")


def wait_for(condition, seconds: float = 30.0) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


def gone(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    stat = Path(f"/proc/{process}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] == "Z"


def orphan(tmp_path: Path) -> tuple[subprocess.Popen, int]:
    """A script whose worker works, and the worker."""
    marker = tmp_path / "worker"
    script = subprocess.Popen(
        [sys.executable, "-c", ORPHAN, marker], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert wait_for(lambda: marker.exists() and marker.read_text())
    return script, int(marker.read_text())


def test_workers_end_with_a_parent_that_was_killed(tmp_path):
    script, worker = orphan(tmp_path)
    script.kill()
    script.communicate()
    assert wait_for(lambda: gone(worker))


def test_an_interrupt_of_the_terminal_ends_all_at_once_and_is_told_once(interruptible, tmp_path):
    """Ctrl-C goes to all processes of the terminal."""
    script, worker = orphan(tmp_path)
    os.killpg(script.pid, signal.SIGINT)
    _, said = script.communicate(timeout=30)  # the work would have taken 60
    assert said.count("Traceback") == said.count("KeyboardInterrupt") == 1
    assert gone(worker)


@pytest.mark.parametrize("end", [ProcessPool.stop, ProcessPool.shutdown])
def test_a_pool_that_ended_has_no_threads(end, monkeypatch):
    """A thread that is left may print a warning about leaked semaphores when Python exits."""
    send = Queue._feed

    def send_and_linger(*given):
        send(*given)
        time.sleep(0.2)

    monkeypatch.setattr(Queue, "_feed", staticmethod(send_and_linger))
    before = threading.enumerate()
    pool = ProcessPool(1)
    assert pool.submit(abs, -3).result() == 3
    end(pool)
    assert threading.enumerate() == before
