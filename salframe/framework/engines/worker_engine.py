"""Base of the engines that have workers: processes that take item after item, on this machine or on others."""

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

GLANCE_S = 0.5
"""So often a wait is broken off to look for an interrupt: one that comes just before a wait is not seen within it."""


class WorkerProcess(ABC):
    """A process that works for this one."""

    @abstractmethod
    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        """function(item), or the exception that it raised there: WorkerDied where the process ended first, which is
        then not asked again."""

    @abstractmethod
    def stop(self) -> None:
        """End it at once, whatever it does."""

    def close(self) -> None:
        """End it when it has nothing to do."""
        self.stop()


class WorkerEngine(Engine):
    """An engine that has items worked on in processes of their own; a subclass says how one starts."""

    isolates = True

    class Config(ComponentConfig):
        workers: int | None = Field(
            None,
            ge=1,
            description="how many pieces of work at a time, by processes whose native libraries have a thread each; "
            "null: as many as there are processors, and one of those whose time is measured, which more would make "
            "compete, with all processors to itself",
        )

    @abstractmethod
    def ready(self) -> int:
        """Get ready to start workers; how many work at a time."""

    @abstractmethod
    def start(self, alone: bool) -> WorkerProcess:
        """Start a worker, whose native libraries have a thread each, or one that has all processors to itself."""

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        if not items:
            return
        count = min(self.ready(), len(items))
        crew = _Crew(partial(self.start, alone=self.workers is None and count == 1))
        with ThreadPoolExecutor(count) as threads:
            try:
                for answer in [threads.submit(crew.answer, function, item) for item in items]:
                    while not wait([answer], GLANCE_S).done:
                        pass
                    yield answer.result()
                crew.close()
            except BaseException:  # interrupted: the threads would otherwise wait for their workers to finish
                crew.stop()
                threads.shutdown(wait=False, cancel_futures=True)
                raise


class _Crew:
    """The workers of one map: those at work, those that wait for an item, and whether any more may start."""

    def __init__(self, start: Callable[[], WorkerProcess]) -> None:
        self._start, self._lock, self._stopped = start, threading.Lock(), False
        self._idle: list[WorkerProcess] = []
        self._busy: set[WorkerProcess] = set()

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        """What a worker answers. One that died is replaced by who comes next."""
        worker = self._take()
        answer = worker.answer(function, item)
        died = isinstance(answer, WorkerDied)
        with self._lock:
            if self._stopped:
                return answer
            self._busy.discard(worker)
            if not died:
                self._idle.append(worker)
        if died:
            worker.stop()
        return answer

    def close(self) -> None:
        """End the workers, none of which works."""
        for worker in self._idle:
            worker.close()

    def stop(self) -> None:
        """Start no further worker, and end those that there are."""
        with self._lock:
            self._stopped = True
            workers = [*self._idle, *self._busy]
        with ThreadPoolExecutor(len(workers) or 1) as threads:  # each takes its time to end
            for worker in workers:
                threads.submit(worker.stop)

    def _take(self) -> WorkerProcess:
        with self._lock:  # so that `stop` finds every worker started, or keeps it from starting
            if self._stopped:
                raise SalframeError("the map was interrupted")
            worker = self._idle.pop() if self._idle else self._start()
            self._busy.add(worker)
            return worker
