from __future__ import annotations

import pytest

from salframe.evaluation.localization import compare
from salframe.evaluation.request import Request


@pytest.fixture
def odd(plugins):
    """The run of `weigher` on `odd`, twice: as it comes, and taking no room for another."""
    plugins("odd_plugin", "salframe_engines", folders=("evaluation/report",))
    return [
        compare(Request(("weigher",), "odd", settings=(f"mistaken={room}",), name=name, engine="inline")).run
        for name, room in (("first", 1), ("second", 9))
    ]
