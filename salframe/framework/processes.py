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


class ProcessPool(ProcessPoolExecutor):
    """So many processes that work; leaving its `with` block by an exception ends them at once.

    They do not import the caller's main module, as those of multiprocessing do: a plain script, a notebook or a shell
    may start them. Where one dies, the results that are still awaited raise BrokenProcessPool.
    """

    def __init__(self, workers: int) -> None:
        parent, self._lifeline = multiprocessing.Pipe(duplex=False)
        super().__init__(workers, initializer=_begin_work, initargs=(parent,))

    def stop(self) -> list[int]:
        """End the processes, whatever they do, and give their ids."""
        processes = dict(self._processes)  # Python 3.14 is the first whose pools have terminate_workers()
        for process in processes.values():
            process.terminate()
        for process in processes.values():
            process.join()
        self.shutdown()
        return list(processes)

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
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    faulthandler.enable(os.open(os.devnull, os.O_WRONLY))
    threading.Thread(target=_die_with, args=(parent,), daemon=True).start()


def _die_with(parent: Connection) -> None:
    with suppress(EOFError, OSError):
        parent.recv()  # nothing is ever sent: this returns when the parent's end is closed
    os._exit(1)
