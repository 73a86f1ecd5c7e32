"""The kernels of `compiled-lists`, with what numba compiles of them kept in salframe's cache folder."""

from __future__ import annotations

import importlib
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import file_sha256

_MODULE = "salframe_graphs.retrieval.kernels"
_ENTRY_POINTS = ("scan_lists", "verify_scenes")


def kernel_folder(source: Path) -> Path:
    """Return the folder for what is compiled of a source file. Its name is the sha256 of the text, so that an edited
    file never runs old code."""
    return cache_home() / "kernels" / file_sha256(source)


@cache
def load_kernels() -> ModuleType:
    """Import the kernels. They are compiled at their first call, or read from the cache folder; where that cannot be
    written, each process compiles them in memory."""
    kernels = importlib.import_module(_MODULE)
    folder = _folder_of(kernels)
    if _is_writable(folder):
        _keep_compiled(kernels, folder)
    return kernels


def compile_kernels(call: Callable[[], object]) -> None:
    """Compile the kernels by a call that uses all of them, whatever the state of the cache folder.

    numba raises OSError once for each kernel that it compiled and cannot write, as on a full disk; and any error where
    the folder is damaged, which is then removed.
    """
    for _ in _ENTRY_POINTS:
        try:
            call()
            return
        except OSError:
            continue
        except Exception:
            shutil.rmtree(_folder_of(load_kernels()), ignore_errors=True)
    call()


def _folder_of(kernels: ModuleType) -> Path:
    return kernel_folder(Path(str(kernels.__file__)))


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _keep_compiled(kernels: ModuleType, folder: Path) -> None:
    """Have numba keep the compiled kernels in a folder. Each function takes its folder from numba's global setting when
    caching is enabled; the setting is restored for other users of numba."""
    numba_config: Any = importlib.import_module("numba.core.config")
    before, numba_config.CACHE_DIR = numba_config.CACHE_DIR, str(folder)
    try:
        for name in _ENTRY_POINTS:
            getattr(kernels, name).enable_caching()
    except RuntimeError:  # $NUMBA_CACHE_LOCATOR_CLASSES rules the folder out: compile in memory
        pass
    finally:
        numba_config.CACHE_DIR = before
