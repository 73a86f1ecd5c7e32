"""Where what is written twice, in numpy and for numba, runs compiled: on maps large enough for a scene index, whose
queries are worth the second that it takes to import numba.

numba keeps what it compiled until the file of the function that was called changes: who edits one that another file
calls removes `__pycache__`."""

from __future__ import annotations

import importlib
import importlib.util
from functools import cache
from typing import Any


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
