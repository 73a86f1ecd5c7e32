"""compare and ablate: tables, exit statuses, wrong files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import run
from rich.console import Console

from salframe.cli import tables
from salframe.evaluation.tasks.localization.table import COLUMNS, DEFAULT_COLUMNS
from salframe.framework.components.registry import registry


def test_compare_prints_a_table(fakes):
    done = run(
        "compare",
        "--methods",
        "reader,greedy,weightless",
        "--data",
        "rooms",
        "--set",
        "greedy.offset=1",
        "--engine",
        "inline",
    )
    assert done.code == 0
    lines = done.out.splitlines()
    assert max(map(len, lines[:8])) <= 100
    assert any(line.strip().startswith("reader") and "100.0 (72-100)" in line for line in lines)
    assert any(line.strip().startswith("greedy") and "20.0 (3-64)" in line for line in lines)
    assert "weightless: weightless.pth is not at hand: salframe weights fetch weightless" in done.out
    assert lines[-1].startswith("report: runs/rooms-")


def test_a_narrow_terminal_cuts_no_column(fakes, monkeypatch):
    monkeypatch.setattr(tables, "_console", lambda: Console(width=80))
    lines = run("compare", "--methods", "reader,greedy", "--data", "rooms", "--engine", "inline").out.splitlines()
    assert max(map(len, lines[:-1])) <= 80
    assert not any("…" in line for line in lines)
    headings = " ".join(lines).split()
    usual = [COLUMNS[name].heading for name in DEFAULT_COLUMNS if name != "seed_range"]
    assert all(word in headings for heading in usual for word in heading.split())
    assert sum(line.strip().startswith("reader") for line in lines) == 2  # accuracy, and costs


def test_compare_prints_json_and_nothing_else(fakes):
    done = run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--json")
    assert done.err == ""
    parts = {"format", "task", "run", "report", "request", "data_fingerprint", "versions", "rows", "notes"}
    assert set(done.json) == parts
    assert [row["method"] for row in done.json["rows"]] == ["reader"]


@pytest.mark.parametrize(
    ("methods", "code"), [("reader", 0), ("weightless", 1), ("weightless,reader", 0), ("reader,unbuildable", 1)]
)
def test_exit_status_says_whether_something_was_measured_and_nothing_crashed(fakes, methods, code):
    assert run("compare", "--methods", methods, "--data", "rooms", "--engine", "inline").code == code


def test_ablate_runs_every_combination(fakes, tmp_path):
    (tmp_path / "offsets.yaml").write_text(
        "method: reader\ndata: rooms\nset: {data.rooms: 4}\nvary:\n  offset: [0, -1]\n  refuse_in: [-1, 2]\n"
    )
    done = run("ablate", "offsets.yaml", "--engine", "inline", "--json")
    assert done.code == 0
    assert "/offsets-" in done.json["runs"][0]
    accuracy = {row["method"]: row["accuracy"] for row in done.json["rows"]}
    assert accuracy == {
        "reader[offset=0,refuse_in=-1]": 1.0,
        "reader[offset=0,refuse_in=2]": 0.75,
        "reader[offset=-1,refuse_in=-1]": 0.25,
        "reader[offset=-1,refuse_in=2]": 0.25,  # only room 0 is the nearest to one too few
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            {"method": "reader", "vary": {"offset": [1]}, "sets": {}},
            "unknown key sets, did you mean 'set' (known keys: ",
        ),
        ({"method": "reader", "varry": {"offset": [1]}}, "unknown key varry, did you mean 'vary' (known keys: "),
        ({"method": "reader", "tsk": "localization"}, "unknown key tsk, did you mean 'task' (known keys: "),
        (
            {"methods": {"a": {"method": "reader", "sett": {}}}},
            "wrong.yaml: unknown key methods.a.sett, did you mean 'set' (known keys: method, set)\n",
        ),
        (
            {"method": "reader", "methods": ["greedy"], "vary": {"offset": [1]}},
            "`method` and `methods`, expected exactly one",
        ),
        ({"method": "reader", "vary": {"offset": []}}, "`vary` has no values for offset"),
        ({"method": "reader", "vary": {"offset": 1}}, "vary.offset"),
        (
            {"method": "reader", "vary": {"data.romms": [1, 2]}},
            "wrong.yaml: unknown setting data.romms, did you mean 'rooms'",
        ),
        (
            {"method": "reader", "vary": {"ofset": [1]}},
            "unknown setting ofset, did you mean 'offset' (known settings: ",
        ),
    ],
)
def test_a_wrong_ablation_file_is_one_line(fakes, tmp_path, content, message):
    (tmp_path / "wrong.yaml").write_text(json.dumps(content))
    done = run("ablate", "wrong.yaml", "--data", "rooms")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert message in done.err


def test_columns_are_chosen_and_checked_before_the_run(fakes, tmp_path):
    options = ("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline")
    refused = run(*options, "--columns", "acuracy")
    assert refused.code == 2
    assert refused.err.startswith("error: unknown column 'acuracy', did you mean 'accuracy'?")
    assert not (tmp_path / "runs").exists()
    table = run(*options, "--columns", "accuracy,bytes", "--format", "md").out.splitlines()
    assert table[0] == "| method | accuracy % (95 % CI) | bytes /panorama |"
    latex = run(*options, "--columns", "accuracy", "--format", "latex").out.splitlines()
    assert latex[0] == r"\begin{table}"
    assert latex[3] == r"\caption{Localization on rooms}"
    assert latex[4] == r"\label{tab:localization-rooms}"
    assert latex[5] == r"\begin{tabular}{lr}"


def test_latex_fits_a_page_unless_columns_are_selected(fakes):
    options = ("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--format", "latex")
    note, *lines = run(*options, "--name", "50%_a").out.splitlines()
    assert note.startswith("% columns left out, which --columns can select: input, ")
    assert r"\caption{Localization on 50\%\_a}" in lines
    assert r"\label{tab:localization-50-a}" in lines
    assert r"\begin{tabular}{lrrrrr}" in lines
    selected = run(*options, "--columns", "input,accuracy,recall_at_2,recall_at_5,bytes,query,memory").out.splitlines()
    assert selected[0] == r"\begin{table}"
    assert r"\begin{tabular}{lrrrrrrr}" in selected


def test_the_latex_caption_of_an_ablation_names_it(fakes):
    Path("two.yaml").write_text("method: reader\ndata: rooms\nvary: {offset: [0, 1]}\n")
    lines = run("ablate", "two.yaml", "--engine", "inline", "--format", "latex").out.splitlines()
    assert r"\caption{Localization: study two}" in lines
    assert r"\label{tab:localization-study-two}" in lines


@pytest.mark.parametrize("as_json", [False, True])
def test_columns_help_lists_the_columns_and_runs_nothing(fakes, tmp_path, as_json):
    (tmp_path / "offsets.yaml").write_text("method: reader\ndata: rooms\nvary: {offset: [0, 1]}\n")
    more = ("--json",) if as_json else ()
    for command in (("compare", "--methods", "reader", "--data", "rooms"), ("ablate", "offsets.yaml")):
        done = run(*command, "--columns", "help", *more)
        assert (done.code, done.err) == (0, "")
        if as_json:
            (listed,) = done.json.values()
            assert [one["name"] for one in listed] == list(COLUMNS)
            assert [one["name"] for one in listed if one["main"]] == list(DEFAULT_COLUMNS)
            assert {"name": "recall_at_2", "heading": "R@2 %", "main": False} in listed
        else:
            rows = [line.split("  ") for line in done.out.splitlines()]
            assert ["recall_at_2", "R@2 %"] in [[part.strip() for part in row if part.strip()] for row in rows]
    assert not (tmp_path / "runs").exists()


def test_columns_help_of_a_run_lists_the_columns_of_its_task(fakes, tmp_path):
    run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline")
    (folder,) = (tmp_path / "runs").iterdir()
    for command in ("evaluate", "report"):
        done = run(command, folder, "--columns", "help")
        assert (done.code, done.err) == (0, "")
        assert "accuracy % (95 % CI)" in done.out
    assert not (tmp_path / "report.html").exists()
    refused = run("evaluate", folder, "--columns", "acuracy")
    assert refused.err.startswith("error: unknown column 'acuracy', did you mean 'accuracy'?")


def test_an_unknown_ablation_is_an_unknown_name(fakes, monkeypatch):
    monkeypatch.setattr(registry(), "list_presets", lambda folder: ["keep", "saliency"])
    done = run("ablate", "keeep")
    assert (done.code, done.err) == (
        2,
        "error: unknown ablation 'keeep', did you mean 'keep'? Known: keep, saliency. "
        "A path of a YAML file is accepted too.\n",
    )
