"""Limits of time and memory: a piece of work that exceeds one loses its answer, and the other pieces continue."""

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
"""Files in a method's folder: the current piece of work, and the log of the process that enforces the limits."""
TOO_LONG = "Timeout ("
"""Start of the log of a process that exceeded the time limit, as faulthandler writes it."""


@dataclass(frozen=True)
class Limits:
    """Limits of a piece of work: time in seconds, memory of the process in megabytes (1e6 bytes); None: no limit."""

    timeout_s: float | None = None
    memory_mb: float | None = None

    def __bool__(self) -> bool:
        return self.timeout_s is not None or self.memory_mb is not None


NO_LIMITS = Limits()


class Guard:
    """Records the piece that a process works on, and kills the process where it exceeds the limits.

    The memory limit holds from the start, the time limit during a piece. A process that hangs in a library cannot
    raise, so it is killed from outside Python. `Death.of` returns the reason.

    Args:
        folder: The method's folder.
        limits: The limits.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self._folder, self._limits = folder, limits
        (folder / AT_WORK).unlink(missing_ok=True)
        self._log = (folder / LOG).open("w", encoding="utf-8")
        self._watcher: subprocess.Popen[bytes] | None = None
        if limits.memory_mb is not None:
            # In a separate session, so that an interrupt from the terminal does not reach it.
            command = [sys.executable, "-I", "-S", memory_watch.__file__, str(os.getpid()), str(limits.memory_mb)]
            self._watcher = subprocess.Popen([*command, str(folder / LOG)], start_new_session=True)

    @contextmanager
    def watch(self, key: Mapping[str, Any]) -> Iterator[None]:
        """Apply the time limit to the block, which works on the piece with this key."""
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
        """Stop watching, and remove the files."""
        if self._watcher is not None:
            self._watcher.kill()
            self._watcher.wait()
        self._log.close()
        for name in (AT_WORK, LOG):
            (self._folder / name).unlink(missing_ok=True)


@dataclass(frozen=True)
class Death:
    """The death of a process.

    Attributes:
        piece: Key fields of the piece that the process worked on; None where it worked on none.
        reason: Why the process died.
        by_limit: Whether it exceeded a limit.
    """

    piece: dict[str, Any] | None
    reason: str
    by_limit: bool = False

    @classmethod
    def of(cls, folder: Path, limits: Limits, error: WorkerDied) -> Death:
        """Return the death that an engine reports, with what the process left in its folder."""
        piece = read_json(folder / AT_WORK) if (folder / AT_WORK).exists() else None
        log = (folder / LOG).read_text(encoding="utf-8", errors="replace") if (folder / LOG).exists() else ""
        if log.startswith(TOO_LONG):
            return cls(piece, f"took over {limits.timeout_s:g} s, the limit of --timeout", by_limit=True)
        if log.startswith(TOO_LARGE):
            return cls(piece, f"took over {limits.memory_mb:g} MB, the limit of --memory", by_limit=True)
        return cls(piece, str(error))
