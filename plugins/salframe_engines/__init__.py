"""Ways to run independent pieces of work: in this process, or each in a process of its own."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from pydantic import Field

import salframe
from salframe.evaluation.engine import Engine
from salframe.framework.component import Component
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import SalframeError, describe_error
from salframe.framework.processes import die_with_parent


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

    class Config(ComponentConfig):
        workers: int = Field(
            1, ge=1, description="how many at a time; more than 1 makes the measured times compete for the machine"
        )

    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        running = _Running()
        with ThreadPoolExecutor(self.config.workers) as threads:
            try:
                yield from threads.map(partial(running.answer, function), items)
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
        self._processes: set[SpawnProcess] = set()

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        """function(item) in a process of its own, or the exception that it raised there."""
        spawn = multiprocessing.get_context("spawn")
        receiver, sender = spawn.Pipe(duplex=False)
        process = spawn.Process(target=_work, args=(sender, function, item))
        with receiver:
            try:
                with sender:  # the process has an end of its own: once that is closed too, no answer comes
                    self._start(process)
            except Exception as error:  # an item that cannot be pickled
                return error
            answer = _receive(receiver)
        process.join()
        with self._lock:
            self._processes.discard(process)
        if isinstance(answer, KeyboardInterrupt):
            raise answer
        return answer

    def stop(self) -> None:
        """Start no further process, and end those that run."""
        with self._lock:
            self._stopped = True
            for process in self._processes:
                process.terminate()

    def _start(self, process: SpawnProcess) -> None:
        with self._lock:  # so that `stop` finds every process started, or keeps it from starting
            if self._stopped:
                raise SalframeError("the map was interrupted")
            process.start()
            self._processes.add(process)


def _work(answers: Connection, function: Callable[[Any], Any], item: Any) -> None:
    """What the process of an item does."""
    die_with_parent()
    answer: Any
    try:
        answer = function(item)
    except BaseException as error:  # SystemExit too: it is the item's, not ours
        answer = error
    try:
        answers.send(answer)
    except Exception as error:  # an answer that cannot be pickled
        answers.send(SalframeError(f"its answer cannot be sent: {describe_error(error)}"))


def _receive(receiver: Connection) -> Any:
    """What the process sent, or the exception that tells why nothing came."""
    try:
        return receiver.recv()
    except (EOFError, OSError):
        return SalframeError("its process died: killed, out of memory, or a fault in a library")
    except Exception as error:  # an answer that cannot be unpickled
        return error


@salframe.hookimpl
def salframe_provides() -> list[type[Component]]:
    return [Inline, Processes]
