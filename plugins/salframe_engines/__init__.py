"""Engines that run independent work items in this process, or in worker processes of this machine."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from loky import cpu_count

import salframe
from salframe.framework.component import Component
from salframe.framework.engines.engine import Engine
from salframe.framework.engines.process_pool import ProcessPool
from salframe.framework.engines.worker import ONE_THREAD, work
from salframe.framework.engines.worker_engine import WorkerEngine, WorkerProcess
from salframe.framework.errors import WorkerDied


class Inline(Engine):
    """Runs jobs one after the other in this process, for debugging. Peak memory is not measured."""

    name = "inline"
    version = "1"

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        for item in items:
            yield _attempt(function, item)


class Processes(WorkerEngine):
    """Runs jobs in worker processes on this machine."""

    name = "processes"
    version = "1"

    def prepare(self) -> int:
        return self.workers or cpu_count()

    def start(self, is_only_worker: bool) -> WorkerProcess:
        return _Local(None if is_only_worker else ONE_THREAD)


def _attempt(function: Callable[[Any], Any], item: Any) -> Any:
    """Return function(item), or the exception that it raised. SystemExit is returned too; KeyboardInterrupt is not."""
    try:
        return function(item)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return error


class _Local(WorkerProcess):
    """A worker process on this machine."""

    def __init__(self, env: dict[str, str] | None) -> None:
        """Start the process.

        Args:
            env: Additional environment variables; None: no additional ones.
        """
        self._pool = ProcessPool(1, env)
        self._pool.submit(os.getpid)  # starts the process now, so that it can be stopped from now on

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        try:
            return self._pool.submit(work, function, item).result()
        except BrokenProcessPool:
            return WorkerDied()
        except BaseException as error:  # includes SystemExit, which concerns the item only
            return error

    def stop(self) -> None:
        self._pool.stop()

    def close(self) -> None:
        self._pool.shutdown()


@salframe.hookimpl
def salframe_provides() -> list[type[Component]]:
    return [Inline, Processes]
