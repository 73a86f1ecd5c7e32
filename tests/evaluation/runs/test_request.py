"""From names to configurations, and which method runs in the place of one that cannot."""

from __future__ import annotations

import csv
import html
import io
from pathlib import Path

import pytest
import yaml
from command_line import run as salframe

from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.studies.study import ablate
from salframe.evaluation.tasks.detection.task import measure_detection
from salframe.evaluation.tasks.localization.task import compare
from salframe.evaluation.tasks.matching.task import measure_matching
from salframe.evaluation.tasks.navigation.options import Positioning
from salframe.evaluation.tasks.navigation.task import navigate
from salframe.framework.errors import ConfigError, UnknownName

MISSING = "weightless.pth is not at hand: salframe weights fetch weightless"


def request(*methods, data="rooms", settings=(), **given):
    return Request(methods, data, settings=settings, engine="inline", **given)


def test_names_become_configurations(fakes):
    found = resolve(request("reader", "greedy", settings=("greedy.offset=2", "wrong_from=3", "data.rooms=4")))
    assert list(found.methods) == ["reader", "greedy"]
    assert [config.offset for config in found.methods.values()] == [0, 2]
    assert [config.wrong_from for config in found.methods.values()] == [3, 3]
    assert (found.name, found.data.rooms, found.engine.kind, found.notes) == ("rooms", 4, "inline", ())


def test_methods_and_data_may_be_files(fakes):
    Path("shifted.yaml").write_text("kind: reader\noffset: 1\n")
    Path("small.yaml").write_text("kind: rooms\nrooms: 2\n")
    found = resolve(request("shifted.yaml", "reader", data="small.yaml", settings=("shifted.refuse_in=1",)))
    assert {name: config.offset for name, config in found.methods.items()} == {"shifted": 1, "reader": 0}
    assert found.methods["shifted"].refuse_in == 1
    assert (found.name, found.data.rooms) == ("small", 2)


def test_two_methods_of_the_same_name_are_an_error(fakes):
    Path("other").mkdir()
    for file in ("mine.yaml", "other/mine.yaml"):
        Path(file).write_text("kind: reader\n")
    with pytest.raises(ConfigError, match=r"the methods mine\.yaml and other/mine\.yaml have the same label 'mine'"):
        resolve(request("mine.yaml", "other/mine.yaml"))
    assert list(resolve(request("reader", "reader")).methods) == ["reader"]


def test_one_name_alone_is_no_list_of_names():
    with pytest.raises(ConfigError, match="methods is 'reader', expected a list of names"):
        Request("reader")


def test_methods_are_of_the_role_that_is_asked(fakes):
    with pytest.raises(UnknownName, match="unknown detector 'reader'"):
        measure_detection(request("reader"))


@pytest.fixture
def stand_ins(faults, presets):
    """`fancy` cannot run here and names `plain`, `lost` names one that cannot run either."""
    presets(
        {
            "fancy": {"kind": "weightless", "offset": 1, "otherwise": "plain"},
            "plain": {"kind": "greedy"},
            "lost": {"kind": "weightless", "otherwise": "fancy"},
        }
    )


def test_another_method_stands_in_and_is_set_alike(stand_ins):
    found = resolve(request("fancy", "reader", settings=("fancy.refuse_in=2", "wrong_from=4")))
    assert list(found.methods) == ["plain", "reader"]
    plain = found.methods["plain"]
    assert (plain.kind, plain.offset, plain.refuse_in, plain.wrong_from) == ("greedy", 0, 2, 4)
    assert found.notes == (f"plain is used instead of fancy: {MISSING}",)


def test_a_stand_in_that_cannot_run_either_leaves_the_method_and_its_reason(stand_ins):
    found = resolve(request("lost"))
    assert (list(found.methods), found.notes) == (["lost"], ())
    (row,) = compare(request("lost")).rows
    assert (row.method, row.available, row.reason) == ("lost", False, MISSING)


def test_settings_that_the_stand_in_cannot_take_leave_it_as_it_is(faults, presets):
    presets({"fancy": {"kind": "narrow", "otherwise": "plain"}, "plain": {"kind": "reader", "refuse_in": 4}})
    found = resolve(request("fancy", settings=("fancy.depth=3",)))
    assert found.methods["plain"].refuse_in == 4
    (note,) = found.notes
    assert note.startswith(
        "plain is used instead of fancy: narrow needs the Python package no_such_package, which is not installed; "
        "plain runs with its default "
    )
    assert "does not have the requested ones: unknown setting fancy.depth (known settings: offset," in note


def test_a_stand_in_that_cannot_run_as_it_is_set_leaves_the_method(faults, presets):
    presets({"fancy": {"kind": "weightless", "otherwise": "plain"}, "plain": {"kind": "picky"}})
    found = resolve(request("fancy", "reader", settings=("fancy.offset=-1",)))
    assert (list(found.methods), found.notes) == (["fancy", "reader"], ())
    assert list(resolve(request("fancy")).methods) == ["plain"]


@pytest.mark.parametrize("offset", [100, 101])
def test_a_stand_in_that_cannot_be_built_as_it_is_set(faults, presets, offset):
    """By its own fault it runs as it is; what else is wrong with it costs its row alone."""
    presets({"fancy": {"kind": "weightless", "otherwise": "plain"}, "plain": {"kind": "picky"}})
    result = compare(request("fancy", "reader", settings=(f"fancy.offset={offset}",)))
    if offset == 100:
        assert "it does not have the requested ones: an offset of 100 is too far" in result.notes[0]
        assert [row.accuracy.value for row in result.rows] == [1.0, 1.0]
    else:
        assert (result.rows[0].reason, result.rows[0].accuracy) == ("SystemExit: 101", None)
        assert result.rows[1].accuracy.value == 1.0


def test_a_stand_in_that_was_asked_for_too_stays_as_it_was_asked_for(stand_ins):
    for methods in (("fancy", "plain"), ("plain", "fancy")):
        found = resolve(request(*methods, settings=("fancy.refuse_in=2", "plain.refuse_in=3")))
        assert list(found.methods) == ["plain"]
        assert found.methods["plain"].refuse_in == 3
        assert found.notes == (f"plain is used instead of fancy: {MISSING}",)


def test_a_stand_in_is_told_in_the_table_in_json_and_in_the_report(stand_ins):
    note = f"plain is used instead of fancy: {MISSING}"
    asked = ("compare", "--methods", "fancy,reader", "--data", "rooms", "--engine", "inline")
    printed = salframe(*asked)
    assert printed.code == 0
    assert note in printed.err.splitlines()
    assert note not in printed.out
    given = salframe(*asked, "--json").json
    assert given["notes"] == [note]
    assert [row["method"] for row in given["rows"]] == ["plain", "reader"]
    assert note in html.unescape(Path(given["report"]).read_text())
    measured = salframe("evaluate", given["run"], "--json").json  # writes the report anew
    assert measured["notes"] == [note]
    assert note in html.unescape(Path(given["report"]).read_text())


@pytest.mark.parametrize("style", ["table", "md", "latex", "csv"])
def test_every_table_names_the_method_that_a_stand_in_replaces(stand_ins, style):
    arguments = ("compare", "--methods", "fancy", "--data", "rooms", "--engine", "inline", "--format", style)
    printed = salframe(*arguments).out
    if style == "csv":
        (row,) = csv.DictReader(io.StringIO(printed))
        assert (row["method"], row["substitution"]) == ("plain", "for fancy")
    else:
        assert "plain (for fancy)" in printed


def test_the_report_names_the_method_that_a_stand_in_replaces(stand_ins, read):
    result = compare(request("fancy"))
    assert [(row.method, row.title) for row in result.rows] == [("plain", "plain (for fancy)")]
    content, _ = read(result.report)
    assert [(arm["name"], arm["label"]) for arm in content["arms"]] == [("plain (for fancy)", "plain")]
    assert content["tables"]["usual"][0]["rows"][0][0] == "plain (for fancy)"


def test_a_method_requested_directly_replaces_none_in_the_same_run_folder(stand_ins):
    titles = [(result.run, result.rows[0].title) for result in map(compare, map(request, ("fancy", "plain", "fancy")))]
    runs, names = zip(*titles, strict=True)
    assert len(set(runs)) == 1
    assert names == ("plain (for fancy)", "plain", "plain (for fancy)")


def test_a_stand_in_is_ablated(stand_ins):
    Path("offsets.yaml").write_text(yaml.safe_dump({"method": "fancy", "data": "rooms", "vary": {"offset": [0, 1]}}))
    result = ablate(Path("offsets.yaml"), Request((), engine="inline"))
    assert {row.method: row.accuracy.value for row in result.rows} == {"plain[offset=0]": 1.0, "plain[offset=1]": 0.2}
    assert [given["offset"] for given in result.settings] == [0, 1]
    assert result.notes == (f"plain is used instead of fancy: {MISSING}",)


def test_methods_that_users_named_keep_their_names_where_another_stands_in(stand_ins):
    """One table: the settings that vary belong to the rows that have them."""
    methods = {"one": "fancy", "other": {"method": "fancy", "set": {"wrong_from": 3}}, "mine": "reader"}
    study = {"methods": methods, "data": "rooms", "vary": {"one.offset": [0, 1]}}
    Path("named.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    result = ablate(Path("named.yaml"), Request((), engine="inline"))
    assert [row.method for row in result.rows] == ["one[one.offset=0]", "one[one.offset=1]", "other", "mine"]
    (table,) = result.tables()
    names = [row[0] for row in table.rows]
    assert names[0] == "one (plain for fancy)"
    assert names[2:] == ["other (plain for fancy)", "mine"]
    assert [dict(given) for given in result.settings] == [{"one.offset": 0}, {"one.offset": 1}, {}, {}]
    assert result.notes == (f"plain is used instead of fancy: {MISSING}",)


def test_a_stand_in_matches(furnished, presets):
    presets({"fancy": {"kind": "weightless", "otherwise": "plain"}, "plain": {"kind": "points"}})
    result = measure_matching(request("fancy", data="furnished"))
    assert [(row.method, row.mma_1.value) for row in result.rows] == [("plain", 1.0)]
    assert result.notes == (f"plain is used instead of fancy: {MISSING}",)


def test_a_stand_in_is_logged_before_the_run(stand_ins, caplog):
    caplog.set_level("INFO", "salframe")
    compare(request("fancy"))
    assert [record.getMessage() for record in caplog.records] == [f"plain is used instead of fancy: {MISSING}"]


def test_a_stand_in_walks(apartment, presets):
    presets({"fancy": {"kind": "weightless", "otherwise": "plain"}, "plain": {"kind": "seer"}})
    asked = request("fancy", data="apartment")
    result = navigate(asked, episodes=2, positioning=Positioning.BOTH)
    assert [row.method for row in result.rows] == ["plain", "plain without positioning"]
    assert [row.title for row in result.rows] == ["plain (for fancy)", "plain without positioning (for fancy)"]
    assert result.rows[0].success_rate.value == 1.0
    note = f"plain is used instead of fancy: {MISSING}"
    assert result.notes == (note,)
    assert note in html.unescape(result.report.read_text())
