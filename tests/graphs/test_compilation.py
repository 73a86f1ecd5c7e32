"""Where nothing can be compiled, numpy does it."""

import importlib.util
import os
import subprocess
import sys

import pytest
from salframe_graphs import compilation


def test_without_numba_nothing_is_compiled(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert compilation.compiled.__wrapped__("salframe_graphs.compiled") is None


def test_without_a_folder_to_keep_it_in_nothing_is_compiled():
    """Of the folders where numba looks the user's alone, which is none."""
    pytest.importorskip("numba")
    code = "from salframe_graphs.compilation import compiled; print(compiled('salframe_graphs.compiled'))"
    nowhere = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserWideCacheLocator", "HOME": os.devnull, "XDG_CACHE_HOME": os.devnull}
    done = subprocess.run([sys.executable, "-c", code], env={**os.environ, **nowhere}, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("None\n", "")
