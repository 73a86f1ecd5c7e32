"""Worker processes that do not import the main module of the caller and end with their parent."""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import signal
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType

from loky import ProcessPoolExecutor

from salframe.framework.engines.worker import become_worker, end_work

GRACE_S = 1.0
"""Time in seconds that a stopped process has to clean up its current item."""

LOKY_ENV = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e18"}
"""Environment variables of workers. They keep loky from restarting workers whose cached data looks like a leak."""


class ProcessPool(ProcessPoolExecutor):
    """A pool of worker processes. An exception in its `with` block ends them at once.

    The workers do not import the main module of the caller, unlike workers of multiprocessing. A script, a notebook or
    a shell can therefore start them. If a worker dies, the pending results raise BrokenProcessPool.

    Args:
        workers: Number of worker processes.
        env: Additional environment variables of the workers.
    """

    def __init__(self, workers: int, env: dict[str, str] | None = None) -> None:
        parent, self._lifeline = multiprocessing.Pipe(duplex=False)
        env = {**LOKY_ENV, **(env or {})}
        super().__init__(workers, initializer=_begin_work, initargs=(parent,), env=env)

    def shutdown(self, wait: bool = True, kill_workers: bool = False) -> None:
        """End the processes, after their work or at once, and the threads of the pool.

        loky does not wait for its thread that sends the items. If Python exits while this thread releases a semaphore,
        loky prints a warning about a leaked semaphore.
        """
        sender = getattr(self._call_queue, "_thread", None)
        super().shutdown(wait, kill_workers)
        if wait and sender is not None:
            sender.join(GRACE_S)

    def stop(self) -> None:
        """End the processes at once. The functions that run are interrupted, and their items have no result."""
        processes = list(self._processes.values())  # Python 3.14 adds terminate_workers()
        for process in processes:
            process.terminate()
        for process in processes:
            process.join(GRACE_S)
        self.shutdown(kill_workers=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.stop()


def _begin_work(parent: Connection) -> None:
    """Initialize a worker process.

    A worker ignores an interrupt from the terminal, because the parent handles it and ends its workers. A worker exits
    when its parent is killed, so that it does not continue to write files. The traceback of a crash in a native library
    is discarded, because the parent reports the crash in one line.
    """
    become_worker()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, end_work)
    faulthandler.enable(os.open(os.devnull, os.O_WRONLY))
    threading.Thread(target=_die_with, args=(parent,), daemon=True).start()


def _die_with(parent: Connection) -> None:
    """Wait for the end of the parent process, then exit this process."""
    with suppress(EOFError, OSError):
        parent.recv()  # nothing is sent; this returns when the parent closes its end
    os._exit(1)
