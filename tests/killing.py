"""Processes that are killed at work."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path


def start(work: Callable[[], object]) -> int:
    """The process id of a fork of this process that does some work."""
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    return child


def killed(child: int) -> bool:
    """Wait for a process; whether it was killed."""
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def kill_at(step: int | None, folder: Path) -> list[str]:
    """Have this process killed just before it changes what is in a folder for the `step`th time, None: never; the
    changes so far, to which each is added."""
    changes: list[str] = []

    def inside(argument: object) -> bool:
        return isinstance(argument, str | Path) and str(folder) in os.path.abspath(argument)

    def count(event: str, arguments: tuple) -> None:
        removes = event in ("os.remove", "os.rmdir")  # of a name in a folder that is open
        writes = event in ("os.mkdir", "os.rename") or (event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR))
        if removes or (writes and any(map(inside, arguments[:2]))):
            changes.append(event)
            if len(changes) == step:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)
    return changes
