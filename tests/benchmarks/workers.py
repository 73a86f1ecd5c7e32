"""What a second worker brings: `python tests/benchmarks/workers.py [ENGINE ...]`, on a machine that does nothing else.

Renders panoramas of a building into an empty cache and describes them with a network, by one worker and by two in turn,
each side twice in one run: seconds a panorama, and how many times as fast two are. The first pieces, in which processes
start and read networks, are left out: on a large building they weigh nothing.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from salframe.evaluation.runs.request import Request, resolve
from salframe.framework.engines.engine import Engine, open_engine
from salframe.localization.describing import describe_frames
from salframe.panoramas.opening import configure_dataset, open_dataset, reference_frames

DATA, METHOD, DETECTOR = "house-12", "proposed", "detector.kind=panoseg"
ROUNDS, GOAL = 2, 1.7


def pace(stamps: list[float], workers: int) -> float:
    """Seconds a piece, by when each was done: after the first of each worker."""
    return (stamps[-1] - stamps[workers - 1]) / (len(stamps) - workers)


def render_s(engine: str, workers: int) -> float:
    """Seconds a panorama."""
    _, config = configure_dataset(DATA, None)
    stamps: list[float] = []
    open_dataset(config, lambda done, total: stamps.append(time.perf_counter()), made(engine, workers))
    return pace(stamps[1:], workers)  # the first call tells that nothing is done yet


def describe_s(engine: str, workers: int) -> float:
    """Seconds a description."""
    resolved = resolve(Request([METHOD], DATA, settings=(DETECTOR,)))
    frames = [frame.id for frame in reference_frames(open_dataset(resolved.data))]
    (method,) = resolved.methods.values()
    return pace(
        [time.perf_counter() for _ in describe_frames(method, resolved.data, frames, made(engine, workers))], workers
    )


def made(engine: str, workers: int) -> Engine:
    return open_engine(engine, [{"workers": workers}])


def compare(what: str, engine: str, measure: Callable[[str, int], float], keep: str | None = None) -> None:
    """Print the best of each side; each time with an empty cache, but for the folder `keep` of the one at hand."""
    best = {1: float("inf"), 2: float("inf")}
    home = Path(os.environ["SALFRAME_CACHE"]) if keep else None
    for _ in range(ROUNDS):
        for workers in best:
            with TemporaryDirectory() as cache:
                if home and keep:
                    (Path(cache) / keep).symlink_to(home / keep)
                os.environ["SALFRAME_CACHE"] = cache
                best[workers] = min(best[workers], measure(engine, workers))
            if home:
                os.environ["SALFRAME_CACHE"] = str(home)
    ratio = best[1] / best[2]
    print(f"{engine}, {what}: {best[1]:.3f} s by one, {best[2]:.3f} s by two, {ratio:.2f} times (goal {GOAL})")


def main(engines: list[str]) -> None:
    with TemporaryDirectory() as home:
        for engine in engines:
            os.environ["SALFRAME_CACHE"] = home
            compare("rendering", engine, render_s)
        os.environ["SALFRAME_CACHE"] = home
        open_dataset(configure_dataset(DATA, None)[1])
        for engine in engines:
            compare("describing", engine, describe_s, keep="house")


if __name__ == "__main__":
    main(sys.argv[1:] or ["processes", "ray"])
