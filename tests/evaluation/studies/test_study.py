"""Every combination of settings as a method of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.runner import pool
from salframe.evaluation.studies.study import ablate, read_study
from salframe.evaluation.tasks.localization.task import LocalizationTask
from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, UnknownName

INLINE = Request((), engine="inline")


def write(**content: object) -> Path:
    Path("sweep.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return Path("sweep.yaml")


def test_every_combination_of_every_method_is_a_row(fakes):
    vary = {"offset": [0, -1], "wrong_from": [99, 2]}
    file = write(methods=["reader", "greedy"], data="rooms", set={"data.rooms": 4}, vary=vary)
    result = ablate(file, Request((), engine="inline"))
    accuracy = {row.method: row.accuracy.value for row in result.rows}
    # one too few is right in room 0 alone; from room 2 on one too many is right in the last room alone
    by_choice = {"0,wrong_from=99": 1.0, "0,wrong_from=2": 0.75, "-1,wrong_from=99": 0.25, "-1,wrong_from=2": 0.5}
    expected = {
        f"{name}[offset={choice}]": share for name in ("reader", "greedy") for choice, share in by_choice.items()
    }
    assert accuracy == expected
    assert result.rows[0].p_value is None
    assert result.runs[0].name.startswith("sweep-")


def test_the_request_overrules_the_file(fakes):
    file = write(method="reader", data="rooms", set={"data.rooms": 4, "refuse_in": 0}, vary={"offset": [0]})
    given = Request((), settings=("data.rooms=2", "refuse_in=1"), name="mine", engine="inline")
    result = ablate(file, given)
    assert (result.rows[0].queries, result.rows[0].accuracy.value) == (4, 0.5)
    assert read_yaml(result.runs[0] / "request.yaml")["methods"]["reader[offset=0]"]["refuse_in"] == 1
    assert result.runs[0].name.startswith("mine-")


def test_values_that_look_like_paths_stay_inside_the_run(faults):
    vary = {"note": ["../../elsewhere", "/etc/elsewhere", "..", "deep/" * 60]}
    result = ablate(write(method="noted", data="rooms", vary=vary), Request((), engine="inline"))
    assert [row.accuracy.value for row in result.rows] == [1.0] * 4
    folders = {path.parent.resolve() for path in Path().rglob("outcome.json")}
    assert len(folders) == 4
    assert all(folder.parent == result.runs[0].resolve() / "methods" for folder in folders)


def test_a_variant_that_crashes_costs_its_own_row(faults):
    file = write(method="faulty", data="rooms", set={"what": "exit"}, vary={"where": ["nowhere", "match", "init"]})
    result = ablate(file, Request((), engine="inline"))
    assert [row.accuracy and row.accuracy.value for row in result.rows] == [1.0, None, None]
    assert [row.reason for row in result.rows[1:]] == ["SystemExit: the network wants to leave"] * 2
    assert result.crashed


def test_data_varies_too_and_every_row_says_how(fakes):
    """One off, a reader is right in the first room alone; a key of one method's is not varied of the other."""
    file = write(methods=["reader", "greedy"], data="rooms", vary={"data.rooms": [2, 4], "reader.offset": [0, -1]})
    result = ablate(file, INLINE)
    told = [(row.method, row.queries, row.accuracy.value) for row in result.rows]
    assert told == [
        (label, 2 * rooms, share)
        for rooms in (2, 4)
        for label, share in (("reader[reader.offset=0]", 1.0), ("reader[reader.offset=-1]", 1 / rooms), ("greedy", 1.0))
    ]
    assert len(result.runs) == 2
    assert result.settings[1:3] == ({"data.rooms": 2, "reader.offset": -1}, {"data.rooms": 2})
    (table,) = result.tables()
    assert table.headings[:3] == ("data.rooms", "method", "reader.offset")
    assert [row[:3] for row in table.rows][1:3] == [["2", "reader", "-1"], ["2", "greedy", ""]]


def test_runs_of_several_data_sets_are_pooled(fakes):
    """One off, a reader is right in the first room alone: in half of two rooms, in a quarter of four."""
    alone = [ablate(write(method="reader", data="rooms", set={"data.rooms": n, "offset": -1}), INLINE) for n in (2, 4)]
    (row,) = pool(LocalizationTask(), [result.runs[0] for result in alone])
    assert (row.queries, row.accuracy.value, row.by_part) == (12, pytest.approx(1 / 3), (0.5, 0.25))


def test_seeds_are_one_row_with_their_spread(fakes):
    file = write(method="reader", data="rooms", seeds=[3, 4], set={"data.rooms": 2, "offset": -1})
    result = ablate(file, INLINE)
    assert (len(result.runs), result.rows[0].queries, result.rows[0].by_part) == (2, 8, (0.5, 0.5))
    assert result.tables()[0].rows[0][3] == "50-50"


def test_methods_by_name_have_settings_of_their_own(fakes):
    methods = {"right": "reader", "one off": {"method": "reader", "set": {"offset": -1}}}
    result = ablate(write(methods=methods, data="rooms", set={"data.rooms": 4}), INLINE)
    assert {row.method: row.accuracy.value for row in result.rows} == {"right": 1.0, "one off": 0.25}


def test_a_shipped_ablation_is_read_by_its_name():
    assert read_study(Path("positioners")).vary["positioner"] == ("robust", "least-squares", None)
    with pytest.raises(UnknownName, match="unknown ablation 'position', did you mean 'positioners'"):
        read_study(Path("position"))


def test_values_that_are_spelt_alike_are_told_apart_or_refused(fakes):
    file = write(method="reader", data="rooms", vary={"offset": [1, 1]})
    with pytest.raises(
        ConfigError, match=r"sweep\.yaml: two combinations of settings have the same label reader\[offset=1\]"
    ):
        ablate(file, Request((), engine="inline"))


def test_settings_of_an_arm_go_together(fakes):
    arms = {"small": {"data.rooms": 2, "data.queries": 1}, "large": {"data.rooms": 4, "data.queries": 3}}
    result = ablate(write(method="reader", data="rooms", arms=arms), INLINE)
    assert [(given["arm"], row.queries) for given, row in zip(result.settings, result.rows, strict=True)] == [
        ("small", 2),
        ("large", 12),
    ]
    assert result.tables()[0].headings[:2] == ("condition", "method")
