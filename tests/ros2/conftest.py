from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from salframe.framework.components.registry import registry

for _name in ("fastapi", "uvicorn", "httpx", "websockets", "prometheus_client", "rosbags"):
    pytest.importorskip(_name)
TESTS = Path(__file__).parent.parent
FOLDERS = (TESTS / "serving", TESTS / "importers", TESTS.parent / "examples" / "ros2_node")


@pytest.fixture(scope="package", autouse=True)
def folders():
    """The node, the writer of bags, and the detector of the rooms can be imported."""
    sys.path[:0] = map(str, FOLDERS)
    yield
    for folder in FOLDERS:
        sys.path.remove(str(folder))


@pytest.fixture(scope="module")
def rooms_map(folders, tmp_path_factory):
    """A map of the rooms of the conformance suite."""
    from serving.rooms_service import PLUGINS, build

    before = os.environ.get("SALFRAME_PLUGINS")
    os.environ["SALFRAME_PLUGINS"] = f"{PLUGINS},salframe_import"
    registry.cache_clear()
    yield build(tmp_path_factory.mktemp("rooms") / "rooms.map")
    del os.environ["SALFRAME_PLUGINS"]
    if before is not None:
        os.environ["SALFRAME_PLUGINS"] = before
    registry.cache_clear()
