from __future__ import annotations

import pytest
from plain_room import PlainRoom


@pytest.fixture(scope="session")
def rooms() -> list[PlainRoom]:
    return [PlainRoom(seed) for seed in range(3)]
