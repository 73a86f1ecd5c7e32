"""Ways to run independent pieces of work: in this process, or each in a process of its own."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any

from pydantic import Field

import salframe
from salframe.evaluation.engine import Engine
from salframe.framework.component import Component
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import SalframeError
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
        with ThreadPoolExecutor(self.config.workers) as threads:
            try:
                yield from threads.map(partial(_alone, function), items)
            except BaseException:  # interrupted: the threads would otherwise wait for their processes to finish
                for child in multiprocessing.active_children():
                    child.terminate()
                raise


def _attempt(function: Callable[[Any], Any], item: Any) -> Any:
    """function(item), or what it raised: SystemExit too, which is the item's, not ours."""
    try:
        return function(item)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return error


def _alone(function: Callable[[Any], Any], item: Any) -> Any:
    """function(item) in a pool of one: a pool that breaks takes no other item with it."""
    try:
        with ProcessPoolExecutor(
            1, mp_context=multiprocessing.get_context("spawn"), initializer=die_with_parent
        ) as pool:
            return pool.submit(function, item).result()
    except BrokenProcessPool:
        return SalframeError("its process died: killed, out of memory, or a fault in a library")
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit too: it is the item's, not ours
        return error


@salframe.hookimpl
def salframe_provides() -> list[type[Component]]:
    return [Inline, Processes]
