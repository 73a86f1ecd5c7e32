"""Commands that plugins add to the command line."""

from __future__ import annotations

import pytest

from salframe.framework.components.registry import load_commands

COMMAND = """
@salframe.hookimpl
def salframe_commands():
    return {}
"""


def commands(monkeypatch, plugin, **modules: str):
    for name, given in modules.items():
        plugin(name, COMMAND.format(given))
    monkeypatch.setenv("SALFRAME_PLUGINS", ",".join(modules))
    return load_commands()


def test_commands_come_with_their_package(monkeypatch, plugin):
    loaded, failures = commands(monkeypatch, plugin, first="{'greet': print}", second="{'leave': len}", third="{}")
    assert loaded == {"greet": (print, "first"), "leave": (len, "second")}
    assert failures == []


def test_a_plugin_without_commands_is_no_failure(monkeypatch, plugin):
    plugin("silent")
    monkeypatch.setenv("SALFRAME_PLUGINS", "silent")
    assert load_commands() == ({}, [])


def test_commands_that_fail_cost_only_their_plugin(monkeypatch, plugin):
    loaded, failures = commands(
        monkeypatch,
        plugin,
        first="{'greet': print}",
        again="{'greet': len}",
        leaving="exit(4)",
        listing="['greet']",
        loud="{'Greet all': print}",
        hollow="{'wave': None}",
        last="{'wave': print}",
    )
    assert loaded == {"greet": (print, "first"), "wave": (print, "last")}
    reasons = {failure.package: failure.reason for failure in failures}
    assert reasons.keys() == {"again", "leaving", "listing", "loud", "hollow"}
    assert (
        reasons["again"]
        == "the package again registers the command 'greet', a name that first already uses: choose another name"
    )
    assert reasons["leaving"] == "SystemExit: 4"
    assert "expected a name of lower-case words joined by hyphens, and a function" in reasons["loud"]
    assert reasons["hollow"].startswith("the package hollow registers the command 'wave' as None")


def test_an_interrupt_passes_while_commands_are_loaded(monkeypatch, plugin):
    plugin("interrupted", "raise KeyboardInterrupt\n")
    monkeypatch.setenv("SALFRAME_PLUGINS", "interrupted")
    with pytest.raises(KeyboardInterrupt):
        load_commands()
