from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.components.registry import registry

TESTS = Path(__file__).parent.parent

PRESETS = """
from pathlib import Path
import salframe
from salframe.framework.hookspecs import Presets

@salframe.hookimpl
def salframe_provides():
    return [Presets(Path(__file__).parent / "presets")]
"""


@pytest.fixture
def plugins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Has the modules given, which lie in folders of tests/ or in tmp_path, as the only plugins, with an empty cache,
    tmp_path as the working directory."""

    def use(*modules: str, folders: tuple[str, ...] = (".",)) -> None:
        paths = [str(TESTS / folder) for folder in folders] + [str(tmp_path)]
        for path in paths:
            monkeypatch.syspath_prepend(path)
        monkeypatch.setenv("SALFRAME_PLUGINS", ",".join(modules))
        monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*paths, os.environ.get("PYTHONPATH", "")]))
        monkeypatch.chdir(tmp_path)
        registry.cache_clear()

    yield use
    registry.cache_clear()


@pytest.fixture
def presets(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., None]:
    """Adds a plugin that ships presets of methods: their settings by name."""

    def add(methods: Mapping[str, Mapping[str, Any]]) -> None:
        folder = tmp_path / "shipped" / "presets" / "methods"
        folder.mkdir(parents=True)
        for name, content in methods.items():
            (folder / f"{name}.yaml").write_text(yaml.safe_dump(dict(content)))
        (tmp_path / "shipped" / "preset_plugin.py").write_text(PRESETS)
        monkeypatch.syspath_prepend(tmp_path / "shipped")
        monkeypatch.delitem(sys.modules, "preset_plugin", raising=False)
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "shipped"), os.environ["PYTHONPATH"]]))
        monkeypatch.setenv("SALFRAME_PLUGINS", f"{os.environ['SALFRAME_PLUGINS']},preset_plugin")
        registry.cache_clear()

    return add


@pytest.fixture
def faults(plugins):
    """The components of fake_plugin and faulty_plugin, and the engines."""
    plugins("fake_plugin", "faulty_plugin", "salframe_engines")


@pytest.fixture
def furnished(plugins):
    """The components of matching_plugin, the detector of annotations, and the engines."""
    plugins("matching_plugin", "salframe_annotations", "salframe_engines")


@pytest.fixture
def apartment(plugins):
    """The components of navigation/apartment_plugin, the engines and the planners."""
    plugins("apartment_plugin", "salframe_engines", "salframe_planners", "salframe_trackers", folders=("navigation",))


@pytest.fixture
def read():
    """The content of a page, and its islands as text."""

    def of(path):
        page = path.read_text(encoding="utf-8")
        content = re.search(r'<script type="application/json" id="content">(.*?)</script>', page, re.DOTALL)[1]
        islands = re.findall(r'<script type="text/plain" class="island" id="([^"]+)">(.*?)</script>', page, re.DOTALL)
        return json.loads(content), dict(islands)

    return of


@pytest.fixture
def odd(plugins):
    """The run of `weigher` on `odd`, twice: as it comes, and taking no room for another."""
    plugins("odd_plugin", "salframe_engines", folders=("evaluation",))
    return [
        compare(Request(("weigher",), "odd", settings=(f"mistaken={room}",), name=name, engine="inline")).run
        for name, room in (("first", 1), ("second", 9))
    ]
