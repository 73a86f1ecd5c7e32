"""Script that kills a process and its children if they exceed a limit. A busy process cannot watch itself.

Arguments: id of the process, which started this one; maximum resident memory of the process and its children in
megabytes (1e6 bytes), or `inf`; the file with the time at which the current piece of work must have ended, in seconds
since the epoch; the log file.
"""

import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil

POLL_S = 0.1
TOO_LARGE, TOO_LONG = "resident memory", "time"
"""Start of the log of a process that was killed."""


def children(process: psutil.Process) -> list[psutil.Process]:
    """Return all descendants of a process, without this process."""
    return [child for child in process.children(recursive=True) if child.pid != os.getpid()]


def resident_mb(process: psutil.Process) -> float:
    """Return the memory of a process and its children (1e6 bytes). Pages that children share count once."""
    used = process.memory_info().rss
    for child in children(process):
        with suppress(psutil.Error):
            used += child.memory_full_info().uss
    return used / 1e6


def is_late(end: Path) -> bool:
    """Return whether the current piece of work, such as a query, has exceeded its time limit. `end` is the file with
    the time at which it must have ended, in seconds since the epoch."""
    try:
        return time.time() > float(end.read_text(encoding="ascii"))
    except (OSError, ValueError):  # no piece of work, or one that starts now
        return False


def reason(log: str, timeout_s: float | None, memory_mb: float | None) -> str:
    """Return why a process was killed, from the log that `watch` wrote and the limits."""
    if log.startswith(TOO_LARGE):
        return f"the worker process used more than {memory_mb:g} MB, the limit of --memory"
    return f"the worker process took more than {timeout_s:g} s, the limit of --timeout"


def watch(process: psutil.Process, max_mb: float, end: Path, log: Path) -> None:
    """Poll the process until it ends. Kill it and its children if they exceed a limit.

    Args:
        process: The process.
        max_mb: Maximum memory of the process and its children in MB.
        end: File with the time limit, see `is_late`.
        log: File to write the reason of the kill to.
    """
    while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
        used_mb = resident_mb(process)
        if used_mb > max_mb or is_late(end):
            log.write_text(f"{TOO_LARGE} {used_mb:.0f} MB\n" if used_mb > max_mb else TOO_LONG, encoding="ascii")
            for member in [process, *children(process)]:
                with suppress(psutil.Error):
                    member.kill()
            return
        time.sleep(POLL_S)


if __name__ == "__main__":
    with suppress(psutil.Error):  # the process has ended
        watch(psutil.Process(int(sys.argv[1])), float(sys.argv[2]), Path(sys.argv[3]), Path(sys.argv[4]))
