"""The harness tells another answer from the same one, and damage from another sound content."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from answers import CommandOutput, has_new_remark, has_other_answer, is_plausible


def located(place="kitchen", x_m=1.0, **more):
    return {"places": [{"place": place}], "pose": {"x_m": x_m, "y_m": 2.0}, "status": "ok", "notes": [], **more}


def table(**row):
    return {"rows": [{"method": "m", "accuracy": 1.0, "status": {"ok": 3}, "reason": None, **row}], "notes": ["a"]}


@pytest.mark.parametrize(
    ("sound", "output", "expected"),
    [
        (located(), located(x_m=1.2), False),
        (located(), located(x_m=1.3), True),
        (located(), located("lounge"), True),
        (located(), located(pose=None), True),
        (table(), table(bytes_per_scene=9.0), False),
        (table(), table(accuracy=0.5), True),
        (table(median_translation_m=0.1), table(median_translation_m=0.4), True),
        (located(route=None), located(route={"nodes": ["here", "a"], "length_m": 2.0}), True),
        (table(success_rate=1.0, path_m=4.0), table(success_rate=1.0, path_m=4.2), False),
        (table(success_rate=1.0, path_m=4.0), table(success_rate=1.0, path_m=4.3), True),
        (table(success_rate=1.0, path_m=4.0), table(success_rate=0.5, path_m=4.0), True),
        ({"tables": {"a": table()}}, {"tables": {"a": table(accuracy=0.5)}}, True),
        ({"queries": 3, "mapped_places": 2}, {"queries": 3, "mapped_places": 1}, True),
        ({"nodes": ["a", "b"], "length_m": 2.0}, {"nodes": ["a", "c", "b"], "length_m": 2.0}, True),
    ],
)
def test_other_answers(sound, output, expected):
    assert has_other_answer(CommandOutput(sound, ""), CommandOutput(output, "")) == expected


@pytest.mark.parametrize(
    ("output", "err", "expected"),
    [
        (table(), "", False),
        (table(accuracy=0.5), "", False),
        (table(status={"ok": 2}), "", False),
        ({**table(), "notes": []}, "", False),
        (table(), "a line", True),
        (table(status={"error": 3}), "", True),
        (table(reason="1 failed"), "", True),
        ({**table(), "notes": ["a", "b"]}, "", True),
    ],
)
def test_new_remarks(output, err, expected):
    assert has_new_remark(CommandOutput(table(), ""), CommandOutput(output, err)) == expected


@pytest.mark.parametrize(
    ("content", "plausible"),
    [
        ('{"a": [4, "y"]}', True),
        ('{"a": [1.5, "x"]}', True),
        ('{"a": [1', False),
        ('{"a": ["1", "x"]}', False),
        ('{"a": [1e300, "x"]}', False),
        ('{"a": [NaN, "x"]}', False),
        ('{"a": [1, ""]}', False),
        ('{"a": [1, "x", "x"]}', False),
        ('{"b": [1, "x"]}', False),
        (None, False),
    ],
)
def test_damage_and_another_content(tmp_path, content, plausible):
    sound, damaged = tmp_path / "a.json", tmp_path / "b.json"
    sound.write_text(json.dumps({"a": [1, "x"]}))
    if content is not None:
        damaged.write_text(content)
    assert is_plausible(sound, damaged) == plausible


@pytest.mark.parametrize(
    ("content", "plausible"), [("t,x\n0,2\n", True), ("t,x\n0,nan\n", False), ("t,x\n0,\n", False), ("t,x\n0\n", False)]
)
def test_damage_of_words(tmp_path, content, plausible):
    sound, damaged = tmp_path / "a.csv", tmp_path / "b.csv"
    sound.write_text("t,x\n0,1\n")
    damaged.write_text(content)
    assert is_plausible(sound, damaged) == plausible


@pytest.mark.parametrize(
    ("content", "plausible"),
    [
        ([{"start": "a", "yaw_deg": 2.0}], True),
        ([{"start": "a", "yaw_deg": 1.0}, {"start": "b", "yaw_deg": 1.0}], True),
        ([], False),
        ([{"start": "a"}], False),
        ([{"start": "a", "yaw_deg": "1"}], False),
    ],
)
def test_damage_of_records(tmp_path, content, plausible):
    sound, damaged = tmp_path / "a" / "viewpoints" / "episodes.json", tmp_path / "b" / "viewpoints" / "episodes.json"
    for path, records in ((sound, [{"start": "a", "yaw_deg": 1.0}]), (damaged, content)):
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps(records))
    assert is_plausible(sound, damaged) == plausible


def test_damage_of_arrays(tmp_path):
    sound, damaged = tmp_path / "a.npy", tmp_path / "b.npy"
    np.save(sound, np.arange(3.0))
    for array, plausible in ((np.arange(3.0) - 7, True), (np.arange(3), False), (np.full(3, np.nan), False)):
        np.save(damaged, array)
        assert is_plausible(sound, damaged) == plausible
