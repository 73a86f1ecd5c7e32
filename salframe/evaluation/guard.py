"""Pieces of work that hang, take all memory or end the process: each costs its own answer, and the rest goes on."""

from __future__ import annotations

import faulthandler
import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.framework.files import read_json, write_json

AT_WORK, LOG = "at-work.json", "watch.log"
"""In a method's folder: the piece that is being worked on, and what ended the process."""
GLANCE_S = 0.1
TOO_LONG, TOO_LARGE = "Timeout (", "resident memory"
"""What the log says of a process that was ended: the first are the words of faulthandler."""


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

    A process that hangs in a library cannot raise: it is ended from outside Python, and `what_ended` tells why.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self._folder, self._limits = folder, limits
        (folder / AT_WORK).unlink(missing_ok=True)
        self._log = (folder / LOG).open("w", encoding="utf-8")
        if limits.memory_mb is not None:
            threading.Thread(target=self._watch_memory, args=(limits.memory_mb,), daemon=True).start()

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

    def close(self) -> None:
        """Nothing is being worked on any more."""
        self._log.close()
        for name in (AT_WORK, LOG):
            (self._folder / name).unlink(missing_ok=True)

    def _watch_memory(self, most_mb: float) -> None:
        while True:
            held_mb = resident_mb()
            if held_mb is not None and held_mb > most_mb:
                self._log.write(f"{TOO_LARGE} {held_mb:.0f} MB\n")
                self._log.flush()
                os._exit(1)
            time.sleep(GLANCE_S)


def what_ended(folder: Path, limits: Limits) -> tuple[dict[str, Any], str] | None:
    """The piece that the process which died was at work on, and why it was ended; None where it was at none."""
    if not (folder / AT_WORK).exists():
        return None
    log = (folder / LOG).read_text(encoding="utf-8", errors="replace")
    reason = "its process died: killed, out of memory, or a fault in a library"
    if log.startswith(TOO_LONG):
        reason = f"took over {limits.timeout_s:g} s, the limit of --timeout"
    elif log.startswith(TOO_LARGE):
        reason = f"took over {limits.memory_mb:g} MB, the limit of --memory"
    return read_json(folder / AT_WORK), reason


def resident_mb() -> float | None:
    """Memory (1e6 bytes) that this process holds now; None where the system does not tell."""
    path = Path("/proc/self/statm")
    if not path.exists():
        return None
    return int(path.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
