"""Every combination of settings as a method of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from salframe.evaluation.ablation import ablate, read_ablation
from salframe.evaluation.request import Request
from salframe.framework.errors import ConfigError


def write(**content: object) -> Path:
    Path("sweep.yaml").write_text(yaml.safe_dump(content))
    return Path("sweep.yaml")


def test_every_combination_of_every_method_is_a_row(fakes):
    vary = {"offset": [0, -1], "wrong_from": [99, 2]}
    file = write(methods=["reader", "greedy"], data="rooms", set={"data.rooms": 4}, vary=vary)
    result = ablate(file, Request((), engine="inline"))
    accuracy = {row.method: row.accuracy for row in result.rows}
    # one too few is right in room 0 alone; from room 2 on one too many is right in the last room alone
    by_choice = {"0,wrong_from=99": 1.0, "0,wrong_from=2": 0.75, "-1,wrong_from=99": 0.25, "-1,wrong_from=2": 0.5}
    expected = {
        f"{name}[offset={choice}]": share for name in ("reader", "greedy") for choice, share in by_choice.items()
    }
    assert accuracy == expected
    assert result.rows[0].p_value is None
    assert result.run.name.startswith("sweep-")


def test_the_request_overrules_the_file(fakes):
    file = write(method="reader", data="rooms", set={"data.rooms": 4, "refuse_in": 0}, vary={"offset": [0]})
    given = Request((), settings=("data.rooms=2", "refuse_in=1"), name="mine", engine="inline")
    result = ablate(file, given)
    assert (result.rows[0].queries, result.rows[0].accuracy) == (4, 0.5)
    assert result.request["methods"]["reader[offset=0]"]["refuse_in"] == 1
    assert result.run.name.startswith("mine-")


def test_values_that_look_like_paths_stay_inside_the_run(faults):
    vary = {"note": ["../../elsewhere", "/etc/elsewhere", "..", "deep/" * 60]}
    result = ablate(write(method="noted", data="rooms", vary=vary), Request((), engine="inline"))
    assert [row.accuracy for row in result.rows] == [1.0] * 4
    folders = {path.parent.resolve() for path in Path().rglob("outcome.json")}
    assert len(folders) == 4
    assert all(folder.parent == result.run.resolve() / "methods" for folder in folders)


def test_a_variant_that_crashes_costs_its_own_row(faults):
    file = write(method="faulty", data="rooms", set={"what": "exit"}, vary={"where": ["nowhere", "match", "init"]})
    result = ablate(file, Request((), engine="inline"))
    assert [row.accuracy for row in result.rows] == [1.0, None, None]
    assert [row.reason for row in result.rows[1:]] == ["SystemExit: the network wants to leave"] * 2
    assert result.crashed


def test_what_data_to_run_on_is_not_varied(fakes):
    with pytest.raises(ConfigError, match=r"sweep\.yaml: vary holds data\.rooms, expected settings of methods"):
        ablate(write(method="reader", data="rooms", vary={"data.rooms": [1, 2]}), Request((), engine="inline"))


def test_a_shipped_ablation_is_read_by_its_name():
    assert read_ablation(Path("positioners")).vary["positioner"] == ("robust", "least-squares")
    with pytest.raises(ConfigError, match="cannot read position"):
        read_ablation(Path("position"))


def test_values_that_are_spelt_alike_are_told_apart_or_refused(fakes):
    file = write(method="reader", data="rooms", vary={"offset": [1, 1]})
    with pytest.raises(ConfigError, match=r"sweep\.yaml: vary gives reader\[offset=1\] twice"):
        ablate(file, Request((), engine="inline"))
