"""Loads the kernels of `compiled-lists`, and stores their compiled code in salframe's cache folder."""

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
    """Return the folder for the compiled code of a source file.

    Its name is the SHA-256 of the file's text, so that an edited file never runs old code.
    """
    return cache_home() / "kernels" / file_sha256(source)


@cache
def load_kernels() -> ModuleType:
    """Import the kernels.

    They are compiled at the first call, or read from the cache folder. Where that folder is not writable, each process
    compiles them in memory.
    """
    kernels = importlib.import_module(_MODULE)
    folder = _folder_of(kernels)
    if _is_writable(folder):
        _store_compiled(kernels, folder)
    return kernels


def compile_kernels(call: Callable[[], object]) -> None:
    """Compile the kernels with a call that uses all of them, regardless of the state of the cache folder.

    numba raises OSError once for each kernel that it cannot write, for instance on a full disk. If the folder is
    damaged, numba may raise any error. The folder is then removed.
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


def _store_compiled(kernels: ModuleType, folder: Path) -> None:
    """Let numba store the compiled kernels in a folder.

    numba reads its global setting CACHE_DIR when the caching of a function is enabled. This function changes the
    setting for that moment and then restores it for other users of numba.
    """
    numba_config: Any = importlib.import_module("numba.core.config")
    previous, numba_config.CACHE_DIR = numba_config.CACHE_DIR, str(folder)
    try:
        for name in _ENTRY_POINTS:
            getattr(kernels, name).enable_caching()
    except RuntimeError:  # $NUMBA_CACHE_LOCATOR_CLASSES excludes the folder: compile in memory
        pass
    finally:
        numba_config.CACHE_DIR = previous
