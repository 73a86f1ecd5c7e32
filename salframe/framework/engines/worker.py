"""State of a worker process: its thread limit, its role as a worker, and its reaction to signals."""

from __future__ import annotations

import os
from collections.abc import Callable
from types import FrameType
from typing import Any

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMBA_NUM_THREADS",
        "OPENCV_FOR_THREADS_NUM",
    ),
    "1",
)
"""Environment variables of a worker that shares the processors. They limit native libraries to one thread."""
_is_worker, _at_work = False, False


def threads_allowed() -> int | None:
    """Return the number of threads for libraries that do not read the environment. None: no limit."""
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return int(limit) if limit.isdecimal() and int(limit) else None


def become_worker() -> None:
    """Mark this process as a worker process."""
    global _is_worker
    _is_worker = True


def in_worker() -> bool:
    """Return whether this process is a worker process."""
    return _is_worker


def work(function: Callable[[Any], Any], item: Any) -> Any:
    """Return function(item). If a signal interrupts the function, exit the process after its cleanup."""
    global _at_work
    _at_work = True
    try:
        return function(item)
    except KeyboardInterrupt:
        os._exit(1)
    finally:
        _at_work = False


def end_work(signal: int, frame: FrameType | None) -> None:
    """Handle a signal to end: interrupt the current item, or exit if there is none."""
    if _at_work:
        raise KeyboardInterrupt
    os._exit(1)
