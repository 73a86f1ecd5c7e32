"""Worker processes that need nothing of the caller's main module, and do not outlive who started them."""

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
"""What is worked on has so long to leave nothing unfinished behind when its process is ended."""

KEPT = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e18"}
"""What a worker keeps from item to item is no leak, for which loky would replace it."""


class ProcessPool(ProcessPoolExecutor):
    """So many processes that work; leaving its `with` block by an exception ends them at once.

    They do not import the caller's main module, as those of multiprocessing do: a plain script, a notebook or a shell
    may start them. Where one dies, the results that are still awaited raise BrokenProcessPool. `env`: environment
    variables that they have besides.
    """

    def __init__(self, workers: int, env: dict[str, str] | None = None) -> None:
        parent, self._lifeline = multiprocessing.Pipe(duplex=False)
        env = {**KEPT, **(env or {})}
        super().__init__(workers, initializer=_begin_work, initargs=(parent,), env=env)

    def stop(self) -> None:
        """End the processes, whatever they do: what they work on gets a KeyboardInterrupt, and no answer."""
        processes = list(self._processes.values())  # Python 3.14 is the first whose pools have terminate_workers()
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
    """An interrupt from the terminal is for the parent, which ends its workers; and a killed parent must not leave a
    worker that goes on writing files. A fault in a library is the parent's to tell, in a line, not loky's."""
    become_worker()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, end_work)
    faulthandler.enable(os.open(os.devnull, os.O_WRONLY))
    threading.Thread(target=_die_with, args=(parent,), daemon=True).start()


def _die_with(parent: Connection) -> None:
    with suppress(EOFError, OSError):
        parent.recv()  # nothing is ever sent: this returns when the parent's end is closed
    os._exit(1)
