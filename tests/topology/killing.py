"""Processes that work on a folder and are killed."""

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


def kill_at(step: int, folder: Path) -> None:
    """Have this process killed just before it changes what is in a folder for the `step`th time."""
    changes: list[str] = []

    def count(event: str, arguments: tuple) -> None:
        removes = event in ("os.remove", "os.rmdir")  # of a name in a folder that is open
        writes = event in ("os.mkdir", "os.rename") or (event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR))
        if removes or (writes and any(str(folder) in str(argument) for argument in arguments[:2])):
            changes.append(event)
            if len(changes) == step:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)
