from __future__ import annotations

import pytest

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare


@pytest.fixture
def odd(plugins):
    """The run of `weigher` on `odd`, twice: as it comes, and taking no room for another."""
    plugins("odd_plugin", "salframe_engines", folders=("evaluation/report",))
    return [
        compare(Request(("weigher",), "odd", settings=(f"mistaken={room}",), name=name, engine="inline")).run
        for name, room in (("first", 1), ("second", 9))
    ]
