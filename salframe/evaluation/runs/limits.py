"""Pieces of work that hang, take all memory or end the process: each costs its own answer, and the rest goes on."""

from __future__ import annotations

import faulthandler
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.evaluation.runs import memory_watch
from salframe.evaluation.runs.memory_watch import TOO_LARGE
from salframe.framework.errors import WorkerDied
from salframe.framework.files.reading import read_json
from salframe.framework.files.writing import write_json

AT_WORK, LOG = "at-work.json", "watch.log"
"""In a method's folder: the piece that is being worked on, and what ended the process."""
TOO_LONG = "Timeout ("
"""What the log says of a process whose time was over: the words of faulthandler."""


@dataclass(frozen=True)
class Limits:
    """Of a piece of work: seconds, and megabytes (1e6 bytes) of resident memory of the process; None: none."""

    timeout_s: float | None = None
    memory_mb: float | None = None

    def __bool__(self) -> bool:
        return self.timeout_s is not None or self.memory_mb is not None


NO_LIMITS = Limits()


class Guard:
    """Names the piece that a process works on, and ends the process where that takes too much. `folder`: the method's.

    Memory is limited from the beginning, time while there is a piece. A process that hangs in a library cannot raise:
    it is ended from outside Python, and `Death.of` tells why.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self._folder, self._limits = folder, limits
        (folder / AT_WORK).unlink(missing_ok=True)
        self._log = (folder / LOG).open("w", encoding="utf-8")
        self._watcher: subprocess.Popen[bytes] | None = None
        if limits.memory_mb is not None:
            # In a session of its own: an interrupt from the terminal is not for it.
            command = [sys.executable, "-I", "-S", memory_watch.__file__, str(os.getpid()), str(limits.memory_mb)]
            self._watcher = subprocess.Popen([*command, str(folder / LOG)], start_new_session=True)

    @contextmanager
    def watch(self, key: Mapping[str, Any]) -> Iterator[None]:
        """The block is the work on the piece that is known by `key`."""
        write_json(self._folder / AT_WORK, dict(key))
        if self._limits.timeout_s is not None:
            faulthandler.dump_traceback_later(self._limits.timeout_s, exit=True, file=self._log)
        try:
            yield
        finally:
            if self._limits.timeout_s is not None:
                faulthandler.cancel_dump_traceback_later()
            (self._folder / AT_WORK).unlink(missing_ok=True)

    def close(self) -> None:
        """Nothing is being worked on any more."""
        if self._watcher is not None:
            self._watcher.kill()
            self._watcher.wait()
        self._log.close()
        for name in (AT_WORK, LOG):
            (self._folder / name).unlink(missing_ok=True)


@dataclass(frozen=True)
class Death:
    """A process that died: the piece that it was at work on, by what that is known by, None where it was at none; why;
    and whether a limit ended it."""

    piece: dict[str, Any] | None
    reason: str
    by_limit: bool = False

    @classmethod
    def of(cls, folder: Path, limits: Limits, error: WorkerDied) -> Death:
        """The death that an engine tells of, by what the process left in its folder."""
        piece = read_json(folder / AT_WORK) if (folder / AT_WORK).exists() else None
        log = (folder / LOG).read_text(encoding="utf-8", errors="replace") if (folder / LOG).exists() else ""
        if log.startswith(TOO_LONG):
            return cls(piece, f"took over {limits.timeout_s:g} s, the limit of --timeout", by_limit=True)
        if log.startswith(TOO_LARGE):
            return cls(piece, f"took over {limits.memory_mb:g} MB, the limit of --memory", by_limit=True)
        return cls(piece, str(error))
