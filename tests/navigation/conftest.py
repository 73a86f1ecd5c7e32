from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from salframe.framework.components.registry import registry
from salframe.navigation.world import open_worlds

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))


@pytest.fixture(autouse=True)
def apartment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """The components of apartment_plugin, the engines, the planners and the trackers alone, an empty cache, and
    tmp_path as the working directory."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "apartment_plugin,salframe_engines,salframe_planners,salframe_trackers")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    yield
    registry.cache_clear()


@pytest.fixture
def world():
    """The apartment as its only world."""
    from apartment_plugin import Apartment

    (world,) = open_worlds(Apartment())
    return world


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
