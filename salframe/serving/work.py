"""A pool of threads with a limited queue, in which requests are processed."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from http import HTTPStatus
from typing import TypeVar

from salframe.serving.limits import ServiceLimits
from salframe.serving.problems import Problem

_Result = TypeVar("_Result")
_WEIGHT = 0.1
"""Weight of the latest duration in the moving mean of the durations of requests."""


class WorkPool:
    """Runs calls in threads. If the queue is full, further calls are rejected.

    If a call takes too long, the client receives an error, and the call occupies its thread until it ends. It does end,
    because the size of its inputs is limited.
    """

    def __init__(self, limits: ServiceLimits) -> None:
        self._limits = limits
        self._threads = ThreadPoolExecutor(limits.workers, thread_name_prefix="localize")
        self._num_pending = 0
        self._mean_s = 0.1

    @property
    def num_pending(self) -> int:
        """Number of calls that run or wait."""
        return self._num_pending

    def check_room(self) -> None:
        """Raise Problem 503 if the queue is full."""
        if self._num_pending >= self._limits.workers + self._limits.max_queue:
            raise Problem(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"{self._num_pending} requests are running or waiting, the maximum number: try again later",
                retry_after_s=max(1, math.ceil(self._mean_s * self._num_pending / self._limits.workers)),
            )

    async def run(self, call: Callable[[], _Result]) -> _Result:
        """Run a call in a thread, and return its result.

        Raises:
            Problem: 503 if the queue is full, or if the call did not end in time.
        """
        self.check_room()
        self._num_pending += 1
        future = self._threads.submit(self._timed, call)
        loop = asyncio.get_running_loop()
        future.add_done_callback(lambda done: loop.call_soon_threadsafe(self._finish, done))
        try:
            result, _ = await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(future)), self._limits.work_s)
        except TimeoutError:
            future.cancel()  # has no effect on a call that has started
            raise Problem(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"the request took longer than {self._limits.work_s:g} s: send a smaller image, or try again later",
                retry_after_s=max(1, math.ceil(self._mean_s * self._num_pending / self._limits.workers)),
            ) from None
        return result

    def close(self) -> None:
        """Wait for running calls, and end the threads."""
        self._threads.shutdown(wait=True, cancel_futures=True)

    @staticmethod
    def _timed(call: Callable[[], _Result]) -> tuple[_Result, float]:
        start = time.perf_counter()
        return call(), time.perf_counter() - start

    def _finish(self, done: Future[tuple[_Result, float]]) -> None:
        self._num_pending -= 1
        if not done.cancelled() and done.exception() is None:
            self._mean_s += _WEIGHT * (done.result()[1] - self._mean_s)
