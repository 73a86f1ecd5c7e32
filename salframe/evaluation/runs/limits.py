"""Limits of time and memory. A piece of work, such as a query, that exceeds a limit has no answer; the method continues
with the next piece."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.framework.errors import ConfigError, WorkerDied
from salframe.framework.files.reading import read_json
from salframe.framework.files.writing import write_json, write_text

AT_WORK, LOG, END = "at-work.json", "watch.log", "work-ends"
"""Files in a method's folder: the current piece of work, the log of the process that enforces the limits, and the time
at which the piece must have ended."""


@dataclass(frozen=True)
class Limits:
    """Limits of a piece of work, such as a query; None: no limit.

    Attributes:
        timeout_s: Maximum time in seconds.
        memory_mb: Maximum resident memory of the process and its children in megabytes (1e6 bytes).

    Raises:
        ConfigError: A limit is not positive.
    """

    timeout_s: float | None = None
    memory_mb: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("timeout_s", self.timeout_s), ("memory_mb", self.memory_mb)):
            if value is not None and not value > 0:
                raise ConfigError(f"the limit {name} is {value}, expected a number above 0, or None for no limit")

    def __bool__(self) -> bool:
        return self.timeout_s is not None or self.memory_mb is not None


NO_LIMITS = Limits()


class Guard:
    """Records the current piece of work (such as a query) of a process, and kills the process and its children if they
    exceed the limits.

    The memory limit applies from the start, the time limit to each piece. A process that hangs in a library cannot
    raise an exception, so another process kills it. `Death.of` returns the reason.

    Args:
        folder: The method's folder.
        limits: The limits.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self._folder, self._limits = folder.absolute(), limits  # a plugin may change the working folder
        self._watcher: subprocess.Popen[bytes] | None = None
        self._clean()
        if limits:
            from salframe.evaluation.runs import limit_watch

            max_mb = math.inf if limits.memory_mb is None else limits.memory_mb
            arguments = [str(os.getpid()), str(max_mb), str(self._folder / END), str(self._folder / LOG)]
            # In a separate session, so that an interrupt from the terminal does not reach it.
            command = [sys.executable, "-I", limit_watch.__file__, *arguments]
            self._watcher = subprocess.Popen(command, start_new_session=True)

    @contextmanager
    def watch(self, key: Mapping[str, Any] | None = None) -> Iterator[None]:
        """Apply the time limit to the `with` block. `key` identifies the piece that it works on; None: no piece."""
        if key is not None:
            write_json(self._folder / AT_WORK, dict(key))
        if self._limits.timeout_s is not None:
            write_text(self._folder / END, str(time.time() + self._limits.timeout_s))
        try:
            yield
        finally:
            for name in (END, AT_WORK):
                (self._folder / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Stop watching, and remove the files."""
        if self._watcher is not None:
            self._watcher.kill()
            self._watcher.wait()
        self._clean()

    def _clean(self) -> None:
        for name in (AT_WORK, END, LOG):
            (self._folder / name).unlink(missing_ok=True)


@dataclass(frozen=True)
class Death:
    """The death of a process.

    Attributes:
        piece: Key fields of the piece of work, such as the id of a query, that the process worked on; None if it worked
            on none.
        reason: Why the process died.
        by_limit: Whether the process was killed because it exceeded a limit.
    """

    piece: dict[str, Any] | None
    reason: str
    by_limit: bool = False

    @classmethod
    def of(cls, folder: Path, limits: Limits, error: WorkerDied) -> Death:
        """Return the death of a process, from the error of the engine and the files in the folder of the process."""
        piece = read_json(folder / AT_WORK) if (folder / AT_WORK).exists() else None
        log = (folder / LOG).read_text(encoding="utf-8", errors="replace") if (folder / LOG).exists() else ""
        if log:
            from salframe.evaluation.runs import limit_watch

            return cls(piece, limit_watch.reason(log, limits.timeout_s, limits.memory_mb), by_limit=True)
        return cls(piece, str(error))
