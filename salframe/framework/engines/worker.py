"""What a process knows of itself that works for another one."""

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
"""The environment of a worker that has not all processors to itself, from which native libraries know how many threads
they may have."""
_is_worker, _at_work = False, False


def threads_allowed() -> int | None:
    """How many threads a native library may have that does not read the environment itself; None: as it likes."""
    told = os.environ.get("OMP_NUM_THREADS", "")
    return int(told) if told.isdecimal() and int(told) else None


def become_worker() -> None:
    """Say that this process works for another one and does nothing else."""
    global _is_worker
    _is_worker = True


def in_worker() -> bool:
    """Whether this process works for another one and does nothing else."""
    return _is_worker


def work(function: Callable[[Any], Any], item: Any) -> Any:
    """function(item); the process ends where it is told to meanwhile, after what it works on has cleaned up."""
    global _at_work
    _at_work = True
    try:
        return function(item)
    except KeyboardInterrupt:
        os._exit(1)
    finally:
        _at_work = False


def end_work(signal: int, frame: FrameType | None) -> None:
    """What a worker does at a signal to end."""
    if _at_work:
        raise KeyboardInterrupt
    os._exit(1)
