"""The page of each role: its example is a whole plugin, and keeps the rules of the role."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from conformance import conforms

from salframe.framework.components.registry import registry

PAGES = Path(__file__).parent.parent / "docs" / "how-to" / "roles"
ROLES = sorted(page.stem for page in PAGES.glob("*.md") if page.stem != "index")
OURS = "annotations engines graphs house keypoints detectors image trackers".split()  # noqa: SIM905


def test_every_role_has_a_page_and_is_listed():
    assert set(registry().roles) == set(ROLES)
    listed = re.findall(r"\]\(([\w-]+)\.md\) \|", (PAGES / "index.md").read_text())
    assert sorted(listed) == ROLES


@pytest.mark.parametrize("role", ROLES)
def test_the_example_is_a_plugin_that_conforms(role, tmp_path, monkeypatch):
    example, *_ = re.findall(r"```python\n(.*?)```", (PAGES / f"{role}.md").read_text(), re.DOTALL)
    module = f"page_{role.replace('-', '_')}"
    (tmp_path / f"{module}.py").write_text(example)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setenv("SALFRAME_PLUGINS", ",".join([*(f"salframe_{name}" for name in OURS), module]))
    registry.cache_clear()
    try:
        assert registry().failures == []
        (component,) = (component for component, _ in registry() if component.__module__ == module)
        assert component.role == role
        assert conforms(component)
    finally:
        registry.cache_clear()
