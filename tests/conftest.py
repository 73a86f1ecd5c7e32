from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from salframe.framework.registry import registry


@pytest.fixture
def interruptible():
    """SIGINT raises KeyboardInterrupt here, even where a shell has started the tests in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """The components of fake_plugin and the engines alone, an empty cache, and tmp_path as the working directory."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,salframe_engines")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    yield
    registry.cache_clear()
