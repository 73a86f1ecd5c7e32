"""What an open map costs in a running program: `python tests/benchmarks/open_map.py DATA METHOD [KEY=VALUE ...]`.

Builds the map of a data set, opens it in a fresh process and asks it queries by their arrays: seconds to open, resident
memory, milliseconds a question, and questions a second from one to four threads. Linux only.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import salframe

QUESTIONS = 36


def resident_mb() -> float:
    """Resident memory of this process, 1e6 bytes (Linux)."""
    status = Path("/proc/self/status").read_text().splitlines()
    return int(next(line.split()[1] for line in status if line.startswith("VmRSS"))) * 1024 / 1e6


def measure(directory: str, data: str, settings: list[str]) -> None:
    """Print what an open map costs."""
    dataset = salframe.find_dataset(data, overrides=settings)
    panoramas = [query.load() for query in dataset.folds()[0].queries[:QUESTIONS]]
    before_mb, start = resident_mb(), time.perf_counter()
    opened = salframe.open_map(directory)
    print(f"open: {time.perf_counter() - start:.2f} s, {resident_mb() - before_mb:.0f} MB more")
    opened.localize(panoramas[0])
    print(f"after the first question: {resident_mb() - before_mb:.0f} MB more")
    took_ms, used_ms = [], []
    for panorama in panoramas:
        start, begun = time.perf_counter(), time.process_time()
        opened.localize(panorama)
        took_ms.append(1e3 * (time.perf_counter() - start))
        used_ms.append(1e3 * (time.process_time() - begun))
    took, used = statistics.median(took_ms), statistics.median(used_ms)
    print(f"a question: median {took:.0f} ms, {used:.0f} ms of processor time")
    alone = [opened.localize(panorama) for panorama in panoramas]
    for count in (1, 2, 4):
        start = time.perf_counter()
        with ThreadPoolExecutor(count) as threads:
            answers = list(threads.map(opened.localize, panoramas))
        took_s = time.perf_counter() - start
        same = all(
            one.places == other.places and np.array_equal(one.T_world_query, other.T_world_query)
            for one, other in zip(alone, answers, strict=True)
        )
        rate, more_mb = len(panoramas) / took_s, resident_mb() - before_mb
        print(f"{count} thread(s): {rate:.1f} questions a second, {more_mb:.0f} MB more, the same answers: {same}")


if __name__ == "__main__":
    if sys.argv[1] == "--measure":
        _, _, directory, data, *settings = sys.argv
        measure(directory, data, [setting for setting in settings if setting.startswith("data.")])
    else:
        _, data, method, *settings = sys.argv
        with TemporaryDirectory() as folder:
            directory = str(Path(folder) / "map")
            salframe.build_map(data, directory, method, overrides=settings)
            subprocess.run([sys.executable, __file__, "--measure", directory, data, *settings], check=True)
