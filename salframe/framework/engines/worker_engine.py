"""Base class of engines with worker processes, on this machine or on others."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from typing import Any

from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.engines.engine import Engine
from salframe.framework.errors import SalframeError, WorkerDied

POLL_S = 0.5
"""Interval in seconds at which `map` checks for interrupts. An interrupt just before a wait does not end the wait."""


class WorkerProcess(ABC):
    """A worker process, which calls functions for an engine."""

    @abstractmethod
    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        """Return function(item), or the exception that it raised in the worker.

        The result is WorkerDied if the process ended. The engine then does not use this worker again.
        """

    @abstractmethod
    def stop(self) -> None:
        """End the process at once."""

    def close(self) -> None:
        """End the process when it is idle."""
        self.stop()


class WorkerEngine(Engine):
    """Base class of engines that run items in worker processes. Subclasses start the processes."""

    isolates = True

    class Config(ComponentConfig):
        workers: int | None = Field(
            None,
            ge=1,
            le=1024,
            description="number of worker processes, with one thread each; null: one worker per core to render the "
            "images of a dataset, and a single worker for all other jobs. This single worker has one thread per core "
            "in the engine `processes`, and one thread in other engines",
        )

    @abstractmethod
    def prepare(self) -> int:
        """Prepare the engine, and return the number of processes to start."""

    @abstractmethod
    def start(self, is_only_worker: bool) -> WorkerProcess:
        """Start a worker. If it is the only one, its native libraries use all processors, else one thread."""

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        if not items:
            return
        count = min(self.prepare(), len(items))
        workers = _Workers(partial(self.start, is_only_worker=self.workers is None and count == 1))
        with ThreadPoolExecutor(count) as threads:
            try:
                for answer in [threads.submit(workers.answer, function, item) for item in items]:
                    while not wait([answer], POLL_S).done:
                        pass
                    yield answer.result()
                workers.close()
            except BaseException:  # an interrupt: do not wait for the workers to finish
                workers.stop()
                threads.shutdown(wait=False, cancel_futures=True)
                raise


class _Workers:
    """The busy and idle workers of one call of `map`."""

    def __init__(self, start: Callable[[], WorkerProcess]) -> None:
        self._start, self._lock, self._stopped = start, threading.Lock(), False
        self._idle: list[WorkerProcess] = []
        self._busy: set[WorkerProcess] = set()

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        """Return the result of a worker. A worker that died is replaced when the next item needs one."""
        worker = self._take()
        answer = worker.answer(function, item)
        has_died = isinstance(answer, WorkerDied)
        with self._lock:
            if self._stopped:
                return answer
            self._busy.discard(worker)
            if not has_died:
                self._idle.append(worker)
        if has_died:
            worker.stop()
        return answer

    def close(self) -> None:
        """End the workers, which are all idle."""
        for worker in self._idle:
            worker.close()

    def stop(self) -> None:
        """End all workers and start no more."""
        with self._lock:
            self._stopped = True
            workers = [*self._idle, *self._busy]
        with ThreadPoolExecutor(len(workers) or 1) as threads:  # ending a worker takes time
            for worker in workers:
                threads.submit(worker.stop)

    def _take(self) -> WorkerProcess:
        with self._lock:  # `stop` ends every worker that was started and prevents new ones
            if self._stopped:
                raise SalframeError("the worker processes were stopped before all work was done: run the command again")
            worker = self._idle.pop() if self._idle else self._start()
            self._busy.add(worker)
            return worker
