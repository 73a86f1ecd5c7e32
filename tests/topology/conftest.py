"""Fixtures of the tests of maps with a topology."""

from __future__ import annotations

import pytest

from salframe.framework.components.registry import registry


@pytest.fixture
def doored(fakes, monkeypatch):
    """The fake components, with doors between rooms."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,doored_plugin")
    registry.cache_clear()
