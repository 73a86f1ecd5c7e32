"""Where what is written twice, in numpy and for numba, runs compiled: on maps of some hundred panoramas or more, whose
queries are worth the second that it takes to import numba.

numba keeps what it compiled until the file of the function that was called changes: who edits one that another file
calls removes `__pycache__`."""

from __future__ import annotations

import importlib
import importlib.util
from functools import cache
from typing import Any

WORTH = 100
"""Places are searched compiled where a map has more panoramas."""


@cache
def compiled(module: str) -> Any:
    """A module of functions that numba compiles, None where that is not installed (`salframe[fast]`) or finds no folder
    to keep what it compiles."""
    if importlib.util.find_spec("numba") is None:
        return None
    try:
        return importlib.import_module(module)
    except RuntimeError:
        return None
