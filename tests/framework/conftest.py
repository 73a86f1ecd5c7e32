from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from salframe.framework.components.entry_points import GROUP

HEAD = """
from pathlib import Path
import salframe
from salframe.framework.component import Role
from salframe.framework.component import ComponentConfig
from salframe.framework.hookspecs import Presets
from salframe.graphs.saliency import SaliencyModel

class Even(SaliencyModel):
    '''Equal shares.'''
    name, version = "even", "1"
    def score(self, detections):
        return detections.scores
"""


HOOK = """
@salframe.hookimpl
def salframe_provides():
    return [{}]
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., EntryPoint]:
    """Makes a module and its entry point: the imports of a plugin and a saliency model `even`, the code given, and the
    hook that brings `items`."""
    monkeypatch.syspath_prepend(tmp_path)

    def make(name: str, code: str = "", items: str = "") -> EntryPoint:
        (tmp_path / f"{name}.py").write_text(HEAD + code + HOOK.format(items))
        monkeypatch.delitem(sys.modules, name, raising=False)
        return EntryPoint(name, name, GROUP)

    return make
