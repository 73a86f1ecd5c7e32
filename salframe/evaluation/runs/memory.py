"""Memory of this process."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from salframe.framework.engines.worker import in_worker


def memory_mb(field: Literal["VmRSS", "VmHWM"]) -> float | None:
    """Return the resident memory of this process (1e6 bytes), or its peak so far; None on systems other than Linux."""
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    lines = status.read_text(encoding="utf-8").splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith(field))) * 1024 / 1e6


def peak_memory_mb() -> float | None:
    """Return the peak memory of this process (1e6 bytes). None if it is not a worker process, and on Windows."""
    if not in_worker():
        return None
    if (peak_mb := memory_mb("VmHWM")) is not None:  # ru_maxrss of a started process begins at its parent's peak
        return peak_mb
    try:
        import resource
    except ImportError:  # Windows has none
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6
