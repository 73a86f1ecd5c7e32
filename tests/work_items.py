"""Work for engines: items that answer, and items that end their worker."""

from __future__ import annotations

import os
import threading


def answer(item: str) -> object:
    """The item itself; "lock": what cannot be pickled."""
    if item == "die":
        os._exit(3)
    if item == "leave":
        raise SystemExit("leaving")
    return threading.Lock() if item == "lock" else item
