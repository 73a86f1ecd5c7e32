"""Ends a process that holds too much memory: run as a script beside it, for a process at work cannot watch itself.

Arguments: the process, which started this one; megabytes (1e6 bytes) of resident memory; the file that is told of it.
"""

import os
import signal
import sys
import time

GLANCE_S = 0.1
TOO_LARGE = "resident memory"
"""What the log says of a process that was ended."""


def resident_mb(process: int) -> float | None:
    """Memory (1e6 bytes) that a process holds now; None where it has ended, or the system does not tell."""
    try:
        with open(f"/proc/{process}/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, IndexError):
        return None


def watch(process: int, most_mb: float, log: str) -> None:
    """Look until the process ends, or holds too much and is killed."""
    while os.getppid() == process and (held_mb := resident_mb(process)) is not None:
        if held_mb > most_mb:
            with open(log, "w", encoding="utf-8") as file:
                file.write(f"{TOO_LARGE} {held_mb:.0f} MB\n")
            os.kill(process, signal.SIGKILL)
            return
        time.sleep(GLANCE_S)


if __name__ == "__main__":
    watch(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3])
