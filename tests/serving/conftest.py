from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from salframe.framework.components.registry import registry

for _name in ("fastapi", "uvicorn", "httpx", "websockets", "prometheus_client"):
    pytest.importorskip(_name)
HERE = Path(__file__).parent


@pytest.fixture(scope="package", autouse=True)
def plugins():
    """The components that the map of the rooms needs."""
    from serving.rooms_service import PLUGINS

    before = os.environ.get("SALFRAME_PLUGINS")
    sys.path.insert(0, str(HERE))
    os.environ["SALFRAME_PLUGINS"] = PLUGINS
    registry.cache_clear()
    yield
    sys.path.remove(str(HERE))
    del os.environ["SALFRAME_PLUGINS"]
    if before is not None:
        os.environ["SALFRAME_PLUGINS"] = before
    registry.cache_clear()


@pytest.fixture(scope="package")
def rooms_map(plugins, tmp_path_factory) -> Path:
    """The map of the rooms, which tests do not change."""
    from serving.rooms_service import build

    return build(tmp_path_factory.mktemp("rooms") / "rooms.map")


@pytest.fixture(scope="package")
def service(rooms_map):
    """A service on the map of the rooms."""
    from serving.rooms_service import serving

    with serving(rooms_map) as running:
        yield running
