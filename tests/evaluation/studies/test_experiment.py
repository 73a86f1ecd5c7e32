"""Experiments: measured once, kept, shown again."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from command_line import run

from salframe.evaluation.runs.request import Request
from salframe.evaluation.studies.experiment import (
    experiment_names,
    in_quick,
    read_experiment,
    reported_in,
    run_experiment,
)
from salframe.framework.errors import ConfigError, UnknownName

ROOMS = {
    "title": "Which room",
    "data": "rooms",
    "methods": {"right": "reader", "one off": {"method": "reader", "set": {"offset": -1}}},
    "set": {"data.rooms": 4},
    "columns": ["accuracy", "p"],
    "quick": {"methods": ["one off"], "set": {"data.rooms": 2}},
}
REQUEST = Request(engine="inline")


@pytest.fixture
def rooms(plugins):
    """Fake components, and the presets and reported tables that are shipped."""
    plugins("fake_plugin", "salframe_engines", "salframe.configs")


def write(**tables: object) -> Path:
    content = {"title": "Rooms", "question": "Which?", "reported": ["Rooms in the building"], "tables": tables}
    Path("rooms.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return Path("rooms.yaml")


def test_an_experiment_is_measured_once_and_kept(rooms):
    file = write(first=ROOMS)
    result = run_experiment(file, REQUEST, results="results")
    (table,) = result.tables
    assert table.fresh is not None
    stored = json.loads(Path("results/rooms.json").read_text())["whole"]["first"]
    assert [(row["method"], row["accuracy"]) for row in stored["rows"]] == [("right", 1.0), ("one off", 0.25)]
    assert stored["rows"][1]["p_value"] == table.fresh.rows[1].p_value
    assert 0 < stored["seconds"] < 600
    again = run_experiment(file, REQUEST, results="results")
    assert again.tables[0].fresh is None
    assert again.tables[0].stored == table.stored
    assert list(map(list, again.tables[0].tables()[0].rows)) == list(map(list, table.tables()[0].rows))


def test_settings_of_all_rows_are_in_the_title_and_not_in_the_rows(rooms):
    methods = {"reader": "reader", "late": {"method": "reader", "set": {"wrong_from": 3}}}
    file = write(first={**ROOMS, "methods": methods, "set": {"data.rooms": 4, "offset": 1}})
    (table,) = run_experiment(file, REQUEST, results="results").tables
    (shown, *_) = table.tables()
    assert shown.title == "Which room, all rows: offset=1"
    assert [row[0] for row in shown.rows] == ["reader", "late"]


def test_what_is_there_is_measured_again_by_force(rooms):
    file = write(first=ROOMS)
    (measured,) = run_experiment(file, REQUEST, results="results").tables
    rows = {path: path.read_text() for path in Path("runs").glob("*/methods/*/rows.jsonl")}
    for path, text in rows.items():
        path.write_text(text.replace('"status": "ok"', '"status": "no-match"'))
    (forced,) = run_experiment(file, REQUEST, results="results", force=True).tables
    assert (
        [row["accuracy"] for row in forced.stored.rows]
        == [row["accuracy"] for row in measured.stored.rows]
        == [1.0, 0.25]
    )
    assert {path: len(path.read_text().splitlines()) for path in Path("runs").rglob("rows.jsonl")} == {
        path: len(text.splitlines()) for path, text in rows.items()
    }
    assert all(run.is_dir() for run in forced.fresh.runs)


def test_what_was_cut_off_when_measured_again_goes_on(rooms, monkeypatch):
    file = write(first=ROOMS)
    run_experiment(file, REQUEST, results="results")
    from fake_plugin import Reader

    calls, match = [], Reader.match

    def cut_off(self, description):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return match(self, description)

    monkeypatch.setattr(Reader, "match", cut_off)
    with pytest.raises(KeyboardInterrupt):
        run_experiment(file, REQUEST, results="results", force=True)
    (table,) = run_experiment(file, REQUEST, results="results", force=True).tables
    assert len(calls) == 17  # the fourth of 16 was asked twice
    assert [row["accuracy"] for row in table.stored.rows] == [1.0, 0.25]


def test_another_setting_or_version_is_measured_again(rooms, monkeypatch):
    run_experiment(write(first=ROOMS), REQUEST, results="results")
    changed = write(first={**ROOMS, "set": {"data.rooms": 5}}, second=ROOMS)
    first, second = run_experiment(changed, REQUEST, results="results").tables
    assert first.fresh is not None
    assert second.fresh is not None
    assert first.stored.rows[0]["queries"] == 10
    from fake_plugin import Reader

    monkeypatch.setattr(Reader, "version", "another")
    assert all(table.fresh is not None for table in run_experiment(changed, REQUEST, results="results").tables)


def test_the_quick_measurement_stands_beside_the_whole(rooms):
    file = write(first=ROOMS, second={**ROOMS, "quick": False})
    run_experiment(file, REQUEST, results="results", quick=True)
    run_experiment(file, REQUEST, results="results")
    stored = json.loads(Path("results/rooms.json").read_text())
    assert [row["method"] for row in stored["quick"]["first"]["rows"]] == ["one off"]
    assert stored["quick"]["first"]["rows"][0]["accuracy"] == 0.5
    assert set(stored["quick"]) == {"first"}
    assert set(stored["whole"]) == {"first", "second"}


def test_a_table_that_quick_does_not_change_is_measured_once(rooms):
    file = write(first={**ROOMS, "quick": {}})
    assert run_experiment(file, REQUEST, results="results", quick=True).tables[0].fresh is not None
    assert run_experiment(file, REQUEST, results="results").tables[0].fresh is None
    stored = json.loads(Path("results/rooms.json").read_text())
    assert stored["whole"] == stored["quick"]


def test_a_table_of_which_a_method_crashed_is_measured_again(rooms):
    file = write(first={**ROOMS, "quick": {}})
    run_experiment(file, REQUEST, results="results")
    content = json.loads(Path("results/rooms.json").read_text())
    for row in content["whole"]["first"]["rows"]:
        row["status"]["crashed"] = 1
    Path("results/rooms.json").write_text(json.dumps(content))
    assert run_experiment(file, REQUEST, results="results").tables[0].fresh is not None
    assert run_experiment(file, REQUEST, results="results").tables[0].fresh is None


def test_what_is_kept_names_nothing_of_the_data(rooms):
    broken = {**ROOMS, "methods": ["reader"], "set": {"data.rooms": 4, "data.broken": ["map-1", "query-2-0"]}}
    run_experiment(write(first=broken), REQUEST, results="results")
    text = Path("results/rooms.json").read_text()
    assert "query-2" not in text.replace(json.dumps(["map-1", "query-2-0"]), "")
    assert "map-1" not in text


def test_a_table_that_is_wrong_costs_itself(rooms):
    wrong = {**ROOMS, "vary": {"ofset": [1]}}
    first, second = run_experiment(write(first=wrong, second=ROOMS), REQUEST, results="results").tables
    assert "unknown setting ofset, did you mean 'offset'" in first.skipped
    assert second.fresh is not None


def test_wrong_experiments_are_told(rooms):
    with pytest.raises(UnknownName, match="unknown experiment 'roms', did you mean 'rooms'"):
        read_experiment("roms")
    with pytest.raises(
        ConfigError, match="first: the key `quick` has an unknown method 'one of', did you mean 'one off'"
    ):
        run_experiment(write(first={**ROOMS, "quick": {"methods": ["one of"]}}), REQUEST, results="results", quick=True)
    with pytest.raises(ConfigError, match="unknown column 'acuracy'"):
        read_experiment(write(first={**ROOMS, "columns": ["acuracy"]}))


@pytest.mark.parametrize("name", experiment_names())
def test_a_shipped_experiment_is_sound(name):
    experiment = read_experiment(name)
    reported_in(experiment)
    for table, study in experiment.tables.items():
        study.variants()
        quick = in_quick(study, table)
        if quick is not None:
            quick.variants()
    assert any(study.quick is not False for study in experiment.tables.values())


def test_the_command_prints_measured_and_reported_apart(rooms):
    done = run("experiment", str(write(first=ROOMS)), "--engine", "inline", "--results", "results")
    assert done.code == 0
    measured, reported = done.out.split("reported, not measured")
    assert "100.0 (68-100)" in measured
    assert "106 rooms" in reported
    assert done.out.rstrip().endswith("stored in results/rooms.json")
    answer = run("experiment", "rooms.yaml", "--engine", "inline", "--results", "results", "--json").json
    assert answer[0]["tables"]["first"]["rows"][0]["accuracy"] == 1.0


@pytest.mark.parametrize(
    ("style", "first", "row", "last"),
    [
        ("md", "**Which room**\n\n| method |", "| right | **100.0 (68-100)** | ", "**reported, not measured: Rooms"),
        (
            "latex",
            "\\begin{table}\n\\centering\n\\small\n\\caption{Which room}\n\\label{tab:rooms-which-room}",
            "right & \\textbf{100.0 (68-100)} & ",
            "\\caption{reported, not measured: Rooms",
        ),
        ("csv", "table,method,", "first,one off,", "0.25"),
    ],
)
def test_the_command_prints_what_papers_take(rooms, style, first, row, last):
    done = run("experiment", str(write(first=ROOMS)), "--engine", "inline", "--results", "results", "--format", style)
    assert done.code == 0
    assert done.out.startswith(first)
    assert row in done.out
    assert last in done.out.partition(row)[2]


def test_the_latex_labels_of_tables_with_one_title_differ(rooms):
    options = ("--engine", "inline", "--results", "results", "--format", "latex")
    done = run("experiment", str(write(first=ROOMS, second=ROOMS)), *options)
    first, second, *_ = re.findall(r"\\label{(.*?)}", done.out)
    assert (first, second) == ("tab:rooms-which-room", "tab:rooms-which-room-2")


def test_columns_of_an_experiment_are_listed_and_selected(rooms):
    listed = run("experiment", str(write(first=ROOMS)), "--columns", "help")
    assert (listed.code, Path("runs").exists()) == (0, False)
    assert "pose recall % .25/.5/1 m" in listed.out
    refused = run("experiment", "rooms.yaml", "--columns", "acuracy")
    assert refused.err.startswith("error: unknown column 'acuracy', did you mean 'accuracy'?")
    options = ("--engine", "inline", "--results", "results", "--format", "md")
    shown = run("experiment", "rooms.yaml", "--columns", "macro_recall,accuracy", *options).out
    assert "| method | macro recall % | accuracy % (95 % CI) |" in shown


def test_the_command_lists_experiments():
    listed = run("experiment").out
    assert all(name in listed for name in experiment_names())
