"""The rules of the role `evidence`: what keeps them, and what breaks one."""

from __future__ import annotations

import pytest
from conformance import breaks, conforms
from evidence_plugin import BROKEN, Paint

from salframe.framework.components.registry import registry


@pytest.fixture
def plugins(monkeypatch):
    """The components of evidence_plugin and of salframe_graphs."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "salframe_graphs,salframe_annotations,evidence_plugin")
    registry.cache_clear()
    yield
    registry.cache_clear()


@pytest.mark.parametrize("name", ["likelihood", "outline", "panorama", "labels", "paint"])
def test_evidence_keeps_the_rules(plugins, name):
    assert conforms(registry().get("evidence", name))


@pytest.mark.parametrize(("component", "message"), BROKEN, ids=lambda value: getattr(value, "name", ""))
def test_a_broken_rule_is_named(plugins, component, message):
    breaks(message, component)


def test_evidence_of_no_plugin_cannot_be_checked():
    registry.cache_clear()
    breaks("no registered evidence of this name, expected one that a plugin provides", Paint)
