"""Ways to run independent pieces of work: in this process, or each in a process of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pydantic import Field

import salframe
from salframe.evaluation.engine import Engine
from salframe.framework.component import Component
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import SalframeError, WorkerDied
from salframe.framework.processes import ProcessPool

GLANCE_S = 0.5
"""So often a wait is broken off to look for an interrupt: one that comes just before a wait is not seen within it."""


class Inline(Engine):
    """In this process, one after the other; for debuggers. Peak memory is not measured."""

    name = "inline"
    version = "1"

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        for item in items:
            yield _attempt(function, item)


class Processes(Engine):
    """Each piece of work in a fresh process."""

    name = "processes"
    version = "1"
    isolates = True

    class Config(ComponentConfig):
        workers: int = Field(
            1, ge=1, description="how many at a time; more than 1 makes the measured times compete for the machine"
        )

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        running = _Running()
        with ThreadPoolExecutor(self.config.workers) as threads:
            try:
                for answer in [threads.submit(running.answer, function, item) for item in items]:
                    while not wait([answer], GLANCE_S).done:
                        pass
                    yield answer.result()
            except BaseException:  # interrupted: the threads would otherwise wait for their processes to finish
                running.stop()
                raise


def _attempt(function: Callable[[Any], Any], item: Any) -> Any:
    """function(item), or what it raised: SystemExit too, which is the item's, not ours."""
    try:
        return function(item)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return error


class _Running:
    """The processes of one map: those that run, and whether any more may start."""

    def __init__(self) -> None:
        self._lock, self._stopped = threading.Lock(), False
        self._pools: set[ProcessPool] = set()

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        """function(item) in a process of its own, or the exception that it raised there."""
        pool = ProcessPool(1)
        try:
            return self._submit(pool, function, item).result()
        except BrokenProcessPool:
            return WorkerDied("its process died: killed, out of memory, or a fault in a library")
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit too: it is the item's, not ours
            return error
        finally:
            with self._lock:
                self._pools.discard(pool)
            pool.shutdown()

    def stop(self) -> None:
        """Start no further process, and end those that run."""
        with self._lock:
            self._stopped, pools = True, list(self._pools)
        for pool in pools:
            pool.stop()

    def _submit(self, pool: ProcessPool, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        with self._lock:  # so that `stop` finds every process started, or keeps it from starting
            if self._stopped:
                raise SalframeError("the map was interrupted")
            self._pools.add(pool)
            return pool.submit(function, item)


@salframe.hookimpl
def salframe_provides() -> list[type[Component]]:
    return [Inline, Processes]
