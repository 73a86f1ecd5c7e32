"""Script that kills a process that exceeds a limit of memory: a busy process cannot watch itself.

Arguments: id of the process, which started this one; maximum resident memory in megabytes (1e6 bytes); the log file.
"""

import os
import signal
import sys
import time

GLANCE_S = 0.1
TOO_LARGE = "resident memory"
"""Start of the log of a process that was killed."""


def resident_mb(process: int) -> float | None:
    """Return the memory of a process (1e6 bytes); None where it has ended or the system does not report it."""
    try:
        with open(f"/proc/{process}/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, IndexError):
        return None


def watch(process: int, max_mb: float, log: str) -> None:
    """Poll the process until it ends; kill it where it exceeds the limit."""
    while os.getppid() == process and (used_mb := resident_mb(process)) is not None:
        if used_mb > max_mb:
            with open(log, "w", encoding="utf-8") as file:
                file.write(f"{TOO_LARGE} {used_mb:.0f} MB\n")
            os.kill(process, signal.SIGKILL)
            return
        time.sleep(GLANCE_S)


if __name__ == "__main__":
    watch(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3])
