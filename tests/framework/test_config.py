"""Settings as written by users: YAML files with a base, and overrides."""

from __future__ import annotations

import pytest

from salframe.framework.config import merge, parse_override, read_yaml
from salframe.framework.errors import ConfigError
from salframe.framework.overrides import nest


@pytest.mark.parametrize(
    ("base", "over", "expected"),
    [
        ({"a": {"b": 1, "c": 2}}, {"a": {"c": 3}}, {"a": {"b": 1, "c": 3}}),
        ({"a": 1}, {"a": {"b": 2}}, {"a": {"b": 2}}),
        ({"m": {"kind": "x", "s": 1}}, {"m": {"s": 2}}, {"m": {"kind": "x", "s": 2}}),
        ({"m": {"kind": "x", "s": 1}}, {"m": {"kind": "y"}}, {"m": {"kind": "y"}}),
        ({"m": {"kind": "x", "s": 1}}, {"m": "x"}, {"m": {"kind": "x", "s": 1}}),
        ({"m": {"kind": "x", "s": 1}}, {"m": "y"}, {"m": {"kind": "y"}}),
        ({"m": "x"}, {"m": {"s": 2}}, {"m": {"kind": "x", "s": 2}}),
        ({"m": {"s": 1}}, {"m": "y"}, {"m": {"s": 1, "kind": "y"}}),
        ({"kind": "x", "a": 1}, {"kind": "y", "b": 2}, {"kind": "y", "b": 2}),
    ],
)
def test_settings_are_laid_on_top_of_one_another(base, over, expected):
    assert merge(base, over) == expected


def test_a_yaml_file_stands_on_its_base(tmp_path):
    (tmp_path / "base.yaml").write_text("kind: outer\nmodel: {kind: inner, share: 0.1}\ngrid: {size_m: 2}\n")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "mine.yaml").write_text("base: ../base.yaml\nmodel: {share: 0.2}\n")
    assert read_yaml(tmp_path / "in" / "mine.yaml") == {
        "kind": "outer",
        "model": {"kind": "inner", "share": 0.2},
        "grid": {"size_m": 2},
    }


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("a=1", ("a",), 1),
        ("a.b-c.d=x=y", ("a", "b-c", "d"), "x=y"),
        ("a=[1, b]", ("a",), [1, "b"]),
        ("a=", ("a",), None),
        ("a=true", ("a",), True),
    ],
)
def test_an_override_is_a_path_and_a_yaml_value(text, path, value):
    assert parse_override(text) == (path, value)
    expected = value
    for key in reversed(path):
        expected = {key: expected}
    assert nest(path, value) == expected


@pytest.mark.parametrize("text", ["a", "=1", "a..b=1", ".a=1", "a=[1"])
def test_an_override_that_is_none_is_one_line(text):
    with pytest.raises(ConfigError, match="--set") as caught:
        parse_override(text)
    assert "\n" not in str(caught.value)
